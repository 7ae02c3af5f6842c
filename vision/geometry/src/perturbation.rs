//! Small moves of poses.

use nalgebra::{Isometry3, UnitQuaternion, Vector3, Vector6};

/// The left perturbation `x ↦ Exp(ω) (R x + t) + τ` of `cam_from_world = (R, t)`: the exponential
/// map of SE(3) to first order, with an exact rotation.
///
/// * `xi`: `(ω, τ)` in the camera frame, radians and the unit of the world.
/// * Returns the moved `cam_from_world`; its quaternion has unit length however often it was moved.
pub fn perturbed(cam_from_world: &Isometry3<f64>, xi: &Vector6<f64>) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(xi[0], xi[1], xi[2]));
    let tau = Vector3::new(xi[3], xi[4], xi[5]);
    let translation = turn * cam_from_world.translation.vector + tau;
    let rotation = UnitQuaternion::new_normalize((turn * cam_from_world.rotation).into_inner());
    Isometry3::from_parts(translation.into(), rotation)
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Translation3};

    use super::*;

    /// A small ω moves a point of the camera frame by `ω × x + τ`.
    #[test]
    fn first_order_motion_is_the_twist() {
        let cam_from_world = Isometry3::from_parts(
            Translation3::new(1.0, -2.0, 0.5),
            UnitQuaternion::from_euler_angles(0.3, -0.8, 2.0),
        );
        let point_in_world = Point3::new(2.0, 1.0, 4.0);
        let xi = Vector6::new(1e-6, -2e-6, 3e-6, 4e-6, 5e-6, -6e-6);
        let before = cam_from_world * point_in_world;
        let moved = perturbed(&cam_from_world, &xi) * point_in_world - before;
        let omega = Vector3::new(xi[0], xi[1], xi[2]);
        let expected = omega.cross(&before.coords) + Vector3::new(xi[3], xi[4], xi[5]);
        assert!((moved - expected).norm() < 1e-10);
    }

    #[test]
    fn rotations_stay_rotations() {
        let mut pose = Isometry3::identity();
        let xi = Vector6::new(0.1, -0.2, 0.3, 0.0, 0.0, 0.0);
        for _ in 0..10_000 {
            pose = perturbed(&pose, &xi);
        }
        assert!((pose.rotation.norm() - 1.0).abs() < 1e-15);
    }
}
