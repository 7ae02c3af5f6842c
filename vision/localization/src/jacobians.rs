//! A projection and how it moves.

use nalgebra::{Isometry3, Matrix2x3, Matrix2x6, Point2, Point3};
use volery_geometry::Camera;

/// A projected point with its derivatives.
pub(crate) struct Linearized {
    /// Pixels.
    pub(crate) pixel: Point2<f64>,
    /// By the left perturbation (ω, τ) of the pose: `exp(ξ) p ≈ p + ω × p + τ`.
    pub(crate) by_pose: Matrix2x6<f64>,
    /// By the point in the map.
    pub(crate) by_point: Matrix2x3<f64>,
}

/// `None` for points that have no pixel.
pub(crate) fn linearize(
    camera: &Camera,
    cam_from_world: &Isometry3<f64>,
    point: &Point3<f64>,
) -> Option<Linearized> {
    let in_cam = cam_from_world * point;
    let projection = camera.project_with_jacobians(&in_cam)?;
    let d_point = projection.d_point;
    let mut by_pose = Matrix2x6::zeros();
    by_pose.fixed_view_mut::<2, 3>(0, 0).copy_from(&(d_point * -in_cam.coords.cross_matrix()));
    by_pose.fixed_view_mut::<2, 3>(0, 3).copy_from(&d_point);
    let by_point = d_point * cam_from_world.rotation.to_rotation_matrix().into_inner();
    Some(Linearized { pixel: projection.pixel, by_pose, by_point })
}
