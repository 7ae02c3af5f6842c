//! Image pairs to a metric sparse model.

pub mod pairs;
pub mod reconstruct;
pub mod align;

pub use align::{AlignOptions, environment_map};
pub use pairs::{PairOptions, select_pairs};
pub use reconstruct::{
    MapperOptions, Reconstruction, ReconstructError, SfmCamera, SfmImage, reconstruct,
};
