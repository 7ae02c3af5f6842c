//! Posed images to depth maps and a dense cloud: PatchMatch multi-view stereo.
//!
//! A depth map is a field of small planes, one per pixel. Good planes spread to their neighbors, are
//! perturbed at random and are judged by how well the image, warped through them, agrees with other
//! images. Coarse images come first, then the other images' depth maps have a say, then planes
//! through trusted depths fill what has no texture, and at last all maps are fused.

mod checkerboard;
mod clusters;
mod delaunay;
pub mod dense;
mod depth;
mod depth_pyramid;
mod dice;
mod filter;
mod free_space;
mod fusion;
mod infer;
mod passes;
mod patch;
mod patch_match;
mod planar_prior;
mod plane;
mod related;
mod selection;
pub mod shelf;
mod simd;
mod source;
mod thinning;
mod unseen;
mod working_image;

pub use dense::{Dense, DenseError, DenseOptions, depth_map, reconstruct_dense, small_photo};
pub use filter::filter_depth_maps;
pub use free_space::SpaceCarver;
pub use fusion::fuse_depth_maps;
pub use shelf::{Item, MemoryShelf, NotKept, Shelf};
pub use thinning::thin_cloud;
pub use unseen::{UnseenArea, unseen_areas};
