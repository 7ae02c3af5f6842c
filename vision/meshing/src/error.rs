//! Failures.

use volery_scene::{Cancelled, ImageId};

/// Why there is no surface.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum MeshingError {
    /// Asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// Three points are the least.
    #[error("a surface needs at least 3 points, got {got}")]
    TooFewPoints {
        /// What came.
        got: usize,
    },
    /// A coordinate or a component of a normal that is no finite number.
    #[error("point {index} or its normal is not finite")]
    NotFinite {
        /// Which point.
        index: usize,
    },
    /// A normal without direction: of no length, or of one that cannot be squared.
    #[error("the normal of point {index} has no direction")]
    NotANormal {
        /// Which point.
        index: usize,
    },
    /// The points have no extent.
    #[error("all points lie in one place")]
    SamePlace,
    /// Points are numbered with 32 bits.
    #[error("{got} points are too many")]
    TooManyPoints {
        /// What came.
        got: usize,
    },
    /// A depth out of range.
    #[error("the depth of the octree must be from {least} to {most}, got {got}")]
    Depth {
        /// What came.
        got: u32,
        /// Least.
        least: u32,
        /// Most.
        most: u32,
    },
    /// An option out of range.
    #[error("{name} must not be {got}")]
    Option {
        /// Its name.
        name: &'static str,
        /// What came.
        got: f64,
    },
    /// A mesh without triangles.
    #[error("the mesh has no triangles")]
    NoTriangles,
    /// A corner that the mesh does not have.
    #[error("triangle {triangle} has a corner that is no vertex")]
    NoSuchVertex {
        /// Which triangle.
        triangle: usize,
    },
    /// Colors that are not as many as the vertices.
    #[error("the colors are not as many as the vertices")]
    WrongColors,
    /// No image shows a triangle of the mesh.
    #[error("no image sees the mesh")]
    NothingSeen,
    /// A photo is not there.
    #[error("image {} has no photo", image.0)]
    NoPhoto {
        /// Which image.
        image: ImageId,
    },
    /// A photo is not of the camera's size.
    #[error("photo of image {} is not of its camera's size", image.0)]
    WrongSize {
        /// Which image.
        image: ImageId,
    },
    /// Not even a texel for each.
    #[error("{num_charts} parts do not fit into the texture")]
    TextureTooSmall {
        /// Parts of the surface.
        num_charts: usize,
    },
}
