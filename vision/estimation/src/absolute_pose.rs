//! Camera pose from 2D–3D correspondences.

mod focal;
mod refinement;
mod sampling;

use nalgebra::{Isometry3, Matrix6, Point2, Point3};
use volery_geometry::{Camera, Rng};

use crate::ransac::{RansacOptions, lo_ransac};
pub use focal::estimate_absolute_pose_and_focal;
pub use refinement::{RefinedPose, refine_absolute_pose};
use sampling::PoseEstimator;

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
    /// Camera axes x right, y down, z forward.
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
/// * `pixels[i]` (distorted, as detected) sees `points[i]` (world); correspondences past the shorter
///   list are ignored.
/// * Deterministic for equal arguments.
///
/// # Errors
///
/// [`AbsolutePoseError`] for fewer than four correspondences, for values that are not finite, and
/// where no pose has the support that `options` demand.
pub fn estimate_absolute_pose(
    pixels: &[Point2<f64>],
    points: &[Point3<f64>],
    camera: &Camera,
    options: &AbsolutePoseOptions,
    seed: u64,
) -> Result<AbsolutePose, AbsolutePoseError> {
    let total = check(pixels, points)?;
    let (pixels, points) = (&pixels[..total], &points[..total]);
    let needed = options.min_inliers.max(MIN_CORRESPONDENCES);
    let too_few = |num_inliers| AbsolutePoseError::TooFewInliers { num_inliers, total, needed };

    let estimator = PoseEstimator::new(pixels, points, camera, options.max_error_px);
    let ransac = RansacOptions {
        failure_probability: options.failure_probability,
        min_iterations: MIN_ITERATIONS,
        max_iterations: options.max_iterations,
    };
    let found = lo_ransac(&estimator, &[], &ransac, &mut Rng::new(seed)).ok_or(too_few(0))?;
    if found.score.num_inliers < MIN_CORRESPONDENCES {
        return Err(too_few(found.score.num_inliers));
    }
    let initial = estimator.to_world(&found.model);
    let refined = refine_absolute_pose(pixels, points, camera, &initial, options.max_error_px)
        .ok_or(too_few(found.score.num_inliers))?;
    if refined.num_inliers < needed {
        return Err(too_few(refined.num_inliers));
    }
    Ok(AbsolutePose {
        cam_from_world: refined.cam_from_world,
        inliers: refined.inliers,
        num_inliers: refined.num_inliers,
        rms_px: refined.rms_px,
        covariance: refined.covariance,
        num_iterations: found.num_iterations,
    })
}

/// Three points give up to four poses; the fourth chooses among them.
const MIN_CORRESPONDENCES: usize = 4;
const MIN_ITERATIONS: usize = 20;

fn check(pixels: &[Point2<f64>], points: &[Point3<f64>]) -> Result<usize, AbsolutePoseError> {
    let total = pixels.len().min(points.len());
    if total < MIN_CORRESPONDENCES {
        return Err(AbsolutePoseError::TooFewCorrespondences {
            got: total,
            needed: MIN_CORRESPONDENCES,
        });
    }
    let finite = pixels[..total].iter().all(|p| p.coords.iter().all(|v| v.is_finite()))
        && points[..total].iter().all(|p| p.coords.iter().all(|v| v.is_finite()));
    if finite { Ok(total) } else { Err(AbsolutePoseError::NotFinite) }
}

#[cfg(test)]
mod tests;
