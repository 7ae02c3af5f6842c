//! Transforms, cameras, epipolar geometry, triangulation, frames, and the numerics that several
//! crates share.
//!
//! Camera axes: x right, y down, z forward. Pixels: corners at integers, the center of the first
//! pixel is (0.5, 0.5). Transforms are named `b_from_a`: `x_in_b = b_from_a * x_in_a`.

pub mod alignment;
pub mod camera;
pub mod camera_model;
mod distortion;
pub mod epipolar;
pub mod frames;
pub mod homography;
pub mod kd_tree;
pub mod linearization;
pub mod perturbation;
pub mod rng;
pub mod simd_level;
pub mod statistics;
pub mod triangulation;

pub use alignment::{AlignError, isometry_from_points, similarity_from_points};
pub use camera::{Camera, CameraError, CameraModel, MAX_CAMERA_PARAMS, Projection};
pub use kd_tree::{KdTree, Neighbor};
pub use linearization::{Linearized, linearize};
pub use nalgebra::{
    Isometry3, Matrix3, Point2, Point3, Rotation3, Similarity3, Translation3, Unit, UnitQuaternion,
    Vector2, Vector3,
};
pub use perturbation::perturbed;
pub use rng::Rng;
pub use simd_level::SimdLevel;
pub use statistics::median;
