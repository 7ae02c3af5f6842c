//! Image pairs to a metric sparse model.

pub mod align;
pub mod global;
pub mod incremental;
mod input;
mod keypoint_grid;
pub mod pairs;
pub mod quality;
pub mod reconstruct;
pub mod self_calibration;
pub mod tracks;
mod triangulation;
mod view_graph;

pub use align::{AlignOptions, environment_map};
pub use global::map_globally;
pub use incremental::map_incrementally;
pub use input::{MapperOptions, SfmCamera, SfmImage};
pub use pairs::{PairOptions, select_pairs};
pub use reconstruct::{ReconstructError, Reconstruction, reconstruct};
