//! When a pose is believed. A confident wrong pose moves a drone into a wall, so every test must
//! pass.

use nalgebra::{Isometry3, Matrix3, Matrix6, Point2};
use volery_geometry::Camera;

use crate::localize::NotFoundReason;

/// Fewest inliers of a pose that is believed.
pub(crate) const MIN_INLIERS: usize = 15;
/// Cells of the image along each side, to judge how the support spreads.
const GRID: usize = 6;
/// Fewest cells that hold an inlier: a wrong rack, seen for the right one, gave 75 inliers in 4.
const MIN_CELLS: usize = 6;
/// Fewest inliers per map point that should be in view. Wrong poses in the rendered warehouse, with
/// its equal racks and cartons, confirm 0.016 with up to 66 inliers, right ones 0.08 and more.
pub(crate) const MIN_CONFIRMED: f64 = 0.06;
/// The same where the pose was known before, so that less speaks for a wrong one: small images, which
/// do not show the fine points of a map, confirm 0.03 and more.
pub(crate) const MIN_CONFIRMED_NEAR: f64 = 0.02;
/// Greatest standard deviation of the position relative to the median depth of the support.
const MAX_RELATIVE_SIGMA: f64 = 0.03;
/// Greatest standard deviation of the rotation, degrees. Right poses have 0.2 at most.
const MAX_SIGMA_DEG: f64 = 0.5;

/// What is known of a pose before it is believed.
pub(crate) struct Evidence<'a> {
    /// Pixels of the inliers.
    pub(crate) inliers: &'a [Point2<f64>],
    /// Map points that should be in view.
    pub(crate) num_visible: usize,
    /// Fewest inliers per such point.
    pub(crate) min_confirmed: f64,
    /// Median depth of the inliers.
    pub(crate) median_depth: f64,
    /// As in [`crate::PoseEstimate`].
    pub(crate) covariance: &'a Matrix6<f64>,
}

/// Whether a pose is believed, and if not, why.
pub(crate) fn judge(evidence: &Evidence, camera: &Camera) -> Result<(), NotFoundReason> {
    let num_inliers = evidence.inliers.len();
    let confirmed = num_inliers as f64 / evidence.num_visible.max(1) as f64;
    if num_inliers < MIN_INLIERS || confirmed < evidence.min_confirmed {
        return Err(NotFoundReason::TooFewInliers);
    }
    if num_cells(evidence.inliers, camera) < MIN_CELLS {
        return Err(NotFoundReason::PoorSpread);
    }
    let largest_sigma = |row: usize| {
        let block: Matrix3<f64> = evidence.covariance.fixed_view::<3, 3>(row, row).into_owned();
        if block.iter().any(|v| !v.is_finite()) {
            return f64::INFINITY;
        }
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

#[cfg(test)]
mod tests {
    use nalgebra::{Translation3, UnitQuaternion, Vector6};
    use volery_geometry::CameraModel;
    use volery_geometry::perturbed;
    use volery_geometry::triangulation::camera_center;

    use super::*;

    fn camera() -> Camera {
        Camera::new(CameraModel::Pinhole, 640, 480, &[500.0, 500.0, 320.0, 240.0]).unwrap()
    }

    fn pose() -> Isometry3<f64> {
        Isometry3::from_parts(
            Translation3::new(1.0, -2.0, 3.0),
            UnitQuaternion::from_euler_angles(0.4, -1.0, 2.0),
        )
    }

    fn verdict(inliers: &[Point2<f64>], visible: usize, sigma: f64) -> Result<(), NotFoundReason> {
        let covariance = Matrix6::identity() * (sigma * sigma);
        let evidence = Evidence {
            inliers,
            num_visible: visible,
            min_confirmed: MIN_CONFIRMED,
            median_depth: 4.0,
            covariance: &covariance,
        };
        judge(&evidence, &camera())
    }

    fn spread(count: usize) -> Vec<Point2<f64>> {
        (0..count).map(|i| Point2::new((i * 97 % 640) as f64, (i * 71 % 480) as f64)).collect()
    }

    /// Each test refuses alone what the others would let pass.
    #[test]
    fn every_test_counts() {
        assert_eq!(verdict(&spread(40), 100, 0.001), Ok(()));
        assert_eq!(verdict(&spread(10), 20, 0.001), Err(NotFoundReason::TooFewInliers));
        assert_eq!(verdict(&spread(40), 4000, 0.001), Err(NotFoundReason::TooFewInliers));
        let bunched: Vec<_> = (0..40).map(|i| Point2::new(300.0 + f64::from(i), 200.0)).collect();
        assert_eq!(verdict(&bunched, 100, 0.001), Err(NotFoundReason::PoorSpread));
        assert_eq!(verdict(&spread(40), 100, 0.5), Err(NotFoundReason::Uncertain));
        assert_eq!(verdict(&spread(40), 100, f64::NAN), Err(NotFoundReason::Uncertain));
    }

    /// The Jacobian of [`covariance_in_map`] against perturbed poses, axis by axis.
    #[test]
    fn covariance_moves_to_the_map() {
        for axis in 0..6 {
            let mut xi = Vector6::zeros();
            xi[axis] = 1e-6;
            let moved = perturbed(&pose(), &xi);
            let position = camera_center(&moved) - camera_center(&pose());
            let turn = (moved.inverse().rotation * pose().rotation).scaled_axis();
            let change =
                Vector6::new(position.x, position.y, position.z, turn.x, turn.y, turn.z) / 1e-6;
            let mut variance = Matrix6::zeros();
            variance[(axis, axis)] = 1.0;
            let covariance = covariance_in_map(&pose(), &variance);
            assert!((covariance - change * change.transpose()).amax() < 1e-5, "axis {axis}");
        }
    }
}
