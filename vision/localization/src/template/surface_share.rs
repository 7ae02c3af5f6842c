//! What a pose takes over from the surface that it was compared with.

use std::collections::BTreeMap;

use nalgebra::{Matrix6, Matrix6x3};
use volery_geometry::{Camera, linearize};

use crate::refine::{Sight, WeightedPose};

/// Standard deviation of a surface along each axis, per distance: 0.2 pixels of disparity between
/// views a fifth of the distance apart, at 500 pixels of focal length.
const RELATIVE_SIGMA: f64 = 0.002;
/// What lies within a cell of this size is off together, of an image 640 pixels wide.
const CELL_PX: f64 = 128.0;

/// Covariance of the left perturbation of the pose by the errors of the surface. A wall that stands a
/// centimeter off moves the pose and leaves no residual. With displacements of `zᵢ e_g` for the
/// sights `i` of a cell `g`, `e_g ~ N(0, σ² I)`,
///
/// ```text
/// σ² Σ_g (N⁻¹ A_g)(N⁻¹ A_g)ᵀ,   A_g = Σ_{i ∈ g} Jᵢᵀ Pᵢ zᵢ / s²
/// ```
///
/// `Jᵢ` = ∂pixel/∂pose, `Pᵢ` = ∂pixel/∂point, `s²` the variance of a pixel, `N` = Σ JᵢᵀJᵢ / s².
pub(super) fn surface_share(
    sights: &[Sight],
    camera: &Camera,
    pose: &WeightedPose,
) -> Matrix6<f64> {
    let cell_px = CELL_PX * f64::from(camera.width.max(camera.height)) / 640.0;
    let cell = |v: f64| (v / cell_px).floor() as i64;
    let mut pulls: BTreeMap<(i64, i64), Matrix6x3<f64>> = BTreeMap::new();
    for sight in sights {
        let Some(at) = linearize(camera, &pose.cam_from_world, &sight.point) else { continue };
        let z = (pose.cam_from_world * sight.point).z;
        *pulls.entry((cell(sight.pixel.x), cell(sight.pixel.y))).or_default() +=
            at.by_pose.tr_mul(&at.by_point) * z;
    }
    let moved = |pull: &Matrix6x3<f64>| {
        let moved = pose.inverse_information * pull * (RELATIVE_SIGMA / pose.squared_sigma);
        moved * moved.transpose()
    };
    pulls.values().map(moved).sum()
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, Matrix3, Point2, Point3, Vector6};
    use volery_geometry::{CameraModel, Rng};

    use super::*;
    use crate::refine::refine_weighted;

    /// Mean normalized squared error of 100 poses before surfaces whose parts are off as they may be,
    /// by the share of the surface alone.
    #[test]
    fn it_is_how_far_parts_that_are_off_move_a_pose() {
        let camera =
            Camera::new(CameraModel::Pinhole, 320, 240, &[228.0, 228.0, 160.0, 120.0]).unwrap();
        let mut rng = Rng::new(5);
        let mut mean = 0.0;
        for _ in 0..100 {
            let parts: Vec<_> = (0..20).map(|_| (rng.normal3(), rng.range(2.0, 8.0))).collect();
            let sight = |index: u32| {
                let (u, v) = (rng.range(0.0, 320.0), rng.range(0.0, 240.0));
                let (off, z) = parts[(u / 64.0) as usize + 5 * (v / 64.0) as usize];
                let z = z + rng.range(0.0, 0.5);
                let seen = Point3::new((u - 160.0) / 228.0 * z, (v - 120.0) / 228.0 * z, z);
                Sight {
                    pixel: Point2::new(u, v),
                    relative_sigma: 1.0,
                    point: seen + off * (RELATIVE_SIGMA * z),
                    point_index: index,
                    covariance: Matrix3::zeros(),
                }
            };
            let sights: Vec<Sight> = (0..300).map(sight).collect();
            let found = refine_weighted(&sights, &camera, &Isometry3::identity()).unwrap();
            let turn = found.cam_from_world.rotation.scaled_axis();
            let shift = found.cam_from_world.translation.vector;
            let error = Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z);
            let share = surface_share(&sights, &camera, &found);
            mean += error.dot(&(share.try_inverse().unwrap() * error)) / 100.0;
        }
        // A robust loss is not of the least variance.
        assert!((6.0 / 2.0..6.0 * 2.0).contains(&mean), "{mean}");
    }
}
