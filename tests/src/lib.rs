//! Tests that cross crates, and the way to the shared data.

pub mod evaluation;
pub mod halls;
pub mod repository;
pub mod scans;
pub mod shared;
pub mod source;
pub mod trials;

pub use evaluation::{Alignment, Evaluation, Poses, evaluate};
pub use halls::{MappedHall, map_photos};
pub use repository::repository_root;
pub use shared::{SharedSet, shared_data};
