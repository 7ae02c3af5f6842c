//! Failures.

use volery_scene::Cancelled;

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
}
