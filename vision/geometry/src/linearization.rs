//! A projection and how it moves with the pose and the point.

use nalgebra::{Isometry3, Matrix2x3, Matrix2x6, Point2, Point3};

use crate::Camera;

/// A projected point with its derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Linearized {
    /// Pixels.
    pub pixel: Point2<f64>,
    /// By the left perturbation ξ = (ω, τ) of the pose, as [`perturbed`](crate::perturbed) moves it.
    pub by_pose: Matrix2x6<f64>,
    /// By the point in the world.
    pub by_point: Matrix2x3<f64>,
}

/// The pixel of a point of the world in a posed camera, with its derivatives; `None` for points that
/// have no pixel.
pub fn linearize(
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

#[cfg(test)]
mod tests {
    use nalgebra::{Translation3, UnitQuaternion, Vector3, Vector6};

    use super::*;
    use crate::{CameraModel, perturbed};

    /// Central differences, axis by axis.
    #[test]
    fn derivatives_are_those_of_the_pixel() {
        let parameters = [500.0, 510.0, 320.0, 240.0, -0.2, 0.05, 0.001, -0.002];
        let camera = Camera::new(CameraModel::OpenCv, 640, 480, &parameters).unwrap();
        let pose = Isometry3::from_parts(
            Translation3::new(0.2, -0.3, 4.0),
            UnitQuaternion::from_euler_angles(0.1, -0.2, 0.3),
        );
        let point = Point3::new(0.4, 0.3, 0.5);
        let at = linearize(&camera, &pose, &point).unwrap();
        let pixel = |pose: &Isometry3<f64>, point: &Point3<f64>| {
            linearize(&camera, pose, point).unwrap().pixel
        };
        let step = 1e-6;
        for axis in 0..6 {
            let mut xi = Vector6::zeros();
            xi[axis] = step;
            let change =
                pixel(&perturbed(&pose, &xi), &point) - pixel(&perturbed(&pose, &-xi), &point);
            assert!((change / (2.0 * step) - at.by_pose.column(axis)).norm() < 1e-4, "{axis}");
        }
        for axis in 0..3 {
            let mut d = Vector3::zeros();
            d[axis] = step;
            let change = pixel(&pose, &(point + d)) - pixel(&pose, &(point - d));
            assert!((change / (2.0 * step) - at.by_point.column(axis)).norm() < 1e-4, "{axis}");
        }
    }
}
