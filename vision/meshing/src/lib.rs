//! Oriented points to a triangle mesh.

pub mod colors;
pub mod decimation;
mod disjoint_sets;
mod error;
mod fans;
pub mod normals;
pub mod poisson;
pub mod sight;
pub mod texture;
pub mod trim;

pub use colors::color_vertices;
pub use decimation::decimate;
pub use error::MeshingError;
pub use normals::{estimate_normals, statistical_inliers};
pub use poisson::{PoissonOptions, Surface, reconstruct_surface};
pub use sight::SightVotes;
pub use texture::{TextureOptions, texture_mesh};
pub use trim::{TrimOptions, trim};

#[cfg(test)]
mod test_shapes;
