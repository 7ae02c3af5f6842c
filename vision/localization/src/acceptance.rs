//! When a pose is believed. A confident wrong pose moves a drone into a wall, so every test must
//! pass.

use nalgebra::{Isometry3, Matrix3, Matrix6, Point2};
use volery_geometry::Camera;

use crate::localize::NotFoundReason;

/// Fewest inliers of a pose that is believed.
pub(crate) const MIN_INLIERS: usize = 15;
/// Cells of the image along each side, to judge how the support spreads.
const GRID: usize = 6;
/// Fewest cells that hold an inlier.
const MIN_CELLS: usize = 6;
/// Fewest inliers per map point that should be in view.
const MIN_CONFIRMED: f64 = 0.06;
/// Greatest standard deviation of the position relative to the median depth of the support.
const MAX_RELATIVE_SIGMA: f64 = 0.03;
/// Greatest standard deviation of the rotation, degrees.
const MAX_SIGMA_DEG: f64 = 1.0;

/// What is known of a pose before it is believed.
pub(crate) struct Evidence<'a> {
    /// Pixels of the inliers.
    pub(crate) inliers: &'a [Point2<f64>],
    /// Map points that should be in view.
    pub(crate) num_visible: usize,
    /// Median depth of the inliers.
    pub(crate) median_depth: f64,
    /// As in [`crate::PoseEstimate`].
    pub(crate) covariance: &'a Matrix6<f64>,
}

/// Whether a pose is believed, and if not, why.
pub(crate) fn judge(evidence: &Evidence, camera: &Camera) -> Result<(), NotFoundReason> {
    let num_inliers = evidence.inliers.len();
    if num_inliers < MIN_INLIERS
        || (num_inliers as f64) < MIN_CONFIRMED * evidence.num_visible as f64
    {
        return Err(NotFoundReason::TooFewInliers);
    }
    if num_cells(evidence.inliers, camera) < MIN_CELLS {
        return Err(NotFoundReason::PoorSpread);
    }
    let largest_sigma = |row: usize| {
        let block: Matrix3<f64> = evidence.covariance.fixed_view::<3, 3>(row, row).into_owned();
        block.symmetric_eigenvalues().max().max(0.0).sqrt()
    };
    let (position, rotation) = (largest_sigma(0), largest_sigma(3));
    if position < MAX_RELATIVE_SIGMA * evidence.median_depth
        && rotation < MAX_SIGMA_DEG.to_radians()
    {
        Ok(())
    } else {
        Err(NotFoundReason::Uncertain)
    }
}

/// Cells of the image that hold a pixel.
pub(crate) fn num_cells(pixels: &[Point2<f64>], camera: &Camera) -> usize {
    let mut is_filled = [false; GRID * GRID];
    for pixel in pixels {
        let cell = |v: f64, size: u32| {
            ((v / f64::from(size) * GRID as f64).max(0.0) as usize).min(GRID - 1)
        };
        is_filled[cell(pixel.y, camera.height) * GRID + cell(pixel.x, camera.width)] = true;
    }
    is_filled.iter().filter(|filled| **filled).count()
}

/// From the covariance of a left perturbation of `cam_from_world`, ξ = (ω, τ), to that of the
/// camera's position and of its rotation about the map's axes:
///
/// ```text
/// p' = −R'ᵀ t' ≈ p − Rᵀ τ,     R'ᵀ ≈ exp(−Rᵀ ω) Rᵀ
/// ```
pub(crate) fn covariance_in_map(
    cam_from_world: &Isometry3<f64>,
    perturbation: &Matrix6<f64>,
) -> Matrix6<f64> {
    let minus_r_t = -cam_from_world.rotation.inverse().to_rotation_matrix().into_inner();
    let mut jacobian = Matrix6::zeros();
    jacobian.fixed_view_mut::<3, 3>(0, 3).copy_from(&minus_r_t);
    jacobian.fixed_view_mut::<3, 3>(3, 0).copy_from(&minus_r_t);
    let covariance = jacobian * perturbation * jacobian.transpose();
    (covariance + covariance.transpose()) * 0.5
}
