//! Camera pose from 2D–3D correspondences.

use nalgebra::{Isometry3, Matrix6, Point2, Point3};
use volery_geometry::Camera;

/// Options of [`estimate_absolute_pose`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AbsolutePoseOptions {
    /// Inlier threshold on the reprojection error, pixels.
    pub max_error_px: f64,
    /// Fewest inliers of an answer.
    pub min_inliers: usize,
    /// Chance of never having drawn an all-inlier sample.
    pub failure_probability: f64,
    /// Bound on the number of hypotheses.
    pub max_iterations: usize,
}

impl Default for AbsolutePoseOptions {
    fn default() -> Self {
        Self {
            max_error_px: 8.0,
            min_inliers: 12,
            failure_probability: 1e-4,
            max_iterations: 20_000,
        }
    }
}

/// Why there is no pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum AbsolutePoseError {
    /// Fewer correspondences than a pose needs.
    #[error("a pose needs at least {needed} correspondences, got {got}")]
    TooFewCorrespondences {
        /// What came.
        got: usize,
        /// What it takes.
        needed: usize,
    },
    /// The best hypothesis has too little support.
    #[error("best pose has {num_inliers} inliers of {total}, {needed} needed")]
    TooFewInliers {
        /// Support of the best hypothesis.
        num_inliers: usize,
        /// Correspondences.
        total: usize,
        /// What it takes.
        needed: usize,
    },
    /// An input is not finite.
    #[error("a correspondence is not finite")]
    NotFinite,
}

/// A pose with its support.
#[derive(Debug, Clone, PartialEq)]
pub struct AbsolutePose {
    /// The pose.
    pub cam_from_world: Isometry3<f64>,
    /// Per correspondence.
    pub inliers: Vec<bool>,
    /// Number of inliers.
    pub num_inliers: usize,
    /// Root mean square reprojection error of the inliers, pixels.
    pub rms_px: f64,
    /// Covariance of a left perturbation `exp(ξ) · cam_from_world`, ξ = (rotation, translation),
    /// radians and model units; from the inliers' residuals.
    pub covariance: Matrix6<f64>,
    /// Hypotheses drawn.
    pub num_iterations: usize,
}

/// Pose of a camera by P3P in LO-RANSAC with a robust nonlinear refinement over all inliers.
///
/// * `pixels[i]` (distorted, as detected) sees `points[i]` (world).
/// * Deterministic for equal arguments.
pub fn estimate_absolute_pose(
    pixels: &[Point2<f64>],
    points: &[Point3<f64>],
    camera: &Camera,
    options: &AbsolutePoseOptions,
    seed: u64,
) -> Result<AbsolutePose, AbsolutePoseError> {
    let _ = (pixels, points, camera, options, seed);
    todo!()
}
