//! A virtual camera: meshes and points to color and depth images, on the processor.
//!
//! A pixel shows a surface if the ray through its center does; rays come from the camera model, so
//! that pictures of every model are exact without warping.

pub mod mesh;
pub mod points;
pub mod rendering;
pub mod virtual_camera;

mod clip;
mod finder;
mod frame;
mod raster;
mod shade;
mod simd;
mod texture;
mod triangle;

pub use mesh::{DrawableMesh, MeshError};
pub use points::DrawablePoints;
pub use rendering::Rendering;
pub use virtual_camera::VirtualCamera;
