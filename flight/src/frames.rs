//! Between the map and the frames of an autopilot.
//!
//! The fleet's local frame is the map turned half about its x axis: forward, right, down. One
//! local frame serves all vehicles, because every estimator is fed with poses of the same map.
//! `T = D = diag(1, −1, −1)` is its own inverse, `R_LB = T R_MB D`.

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};

use crate::Setpoint;

/// A vector of the map (FLU) in the local frame (FRD), and back: the turn is its own inverse.
pub fn local_from_map_vector(v: &Vector3<f64>) -> Vector3<f64> {
    // A difference, so that zero stays without a sign: zeros at the end of a message are cut.
    Vector3::new(v.x, 0.0 - v.y, 0.0 - v.z)
}

/// A point of the map in the local frame, and back.
pub fn local_from_map_point(p: &Point3<f64>) -> Point3<f64> {
    Point3::from(local_from_map_vector(&p.coords))
}

/// A yaw about the map's z axis as a yaw about the local z axis, and back. In (−π, π].
pub fn local_from_map_yaw(yaw: f64) -> f64 {
    wrap(-yaw)
}

/// A vehicle's pose in the map (body FLU) as its pose in the local frame (body FRD), and back.
pub fn local_from_map_pose(map_from_body: &Isometry3<f64>) -> Isometry3<f64> {
    let q = map_from_body.rotation.quaternion();
    // q_T ⊗ q ⊗ q_D with q_T = q_D = (0, 1, 0, 0); the sign of a quaternion is free.
    let turned = nalgebra::Quaternion::new(q.w, q.i, -q.j, -q.k);
    Isometry3::from_parts(
        local_from_map_vector(&map_from_body.translation.vector).into(),
        UnitQuaternion::new_unchecked(turned),
    )
}

/// Roll, pitch and yaw of an attitude, in aerospace order (yaw first).
pub fn roll_pitch_yaw(attitude: &UnitQuaternion<f64>) -> [f64; 3] {
    let r = attitude.to_rotation_matrix();
    let pitch = (0.0 - r[(2, 0)]).clamp(-1.0, 1.0).asin();
    [r[(2, 1)].atan2(r[(2, 2)]), pitch, r[(1, 0)].atan2(r[(0, 0)])]
}

/// Yaw of a pose in the map, counter-clockwise from x.
pub fn map_yaw(map_from_body: &UnitQuaternion<f64>) -> f64 {
    roll_pitch_yaw(map_from_body)[2]
}

/// Where a camera sits on a vehicle and where it looks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraMount {
    /// Its place in the body frame (FRD), meters.
    pub lever: Vector3<f64>,
    /// `body_from_camera`: camera axes x right, y down, z ahead; body FRD.
    pub body_from_camera: UnitQuaternion<f64>,
}

impl CameraMount {
    /// Looks along the nose, tilted down by `tilt` radians, from `lever`.
    pub fn forward(lever: Vector3<f64>, tilt: f64) -> Self {
        // Camera z ahead is body x, camera x is body y, camera y is body z.
        let level = Matrix3::new(0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0);
        let level = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(level));
        let tilted = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -tilt);
        Self { lever, body_from_camera: tilted * level }
    }

    /// The vehicle's pose (body FLU) from the pose of its camera.
    pub fn map_from_body(&self, map_from_camera: &Isometry3<f64>) -> Isometry3<f64> {
        let body_frd_from_camera = Isometry3::from_parts(self.lever.into(), self.body_from_camera);
        let map_from_body_frd = map_from_camera * body_frd_from_camera.inverse();
        map_from_body_frd * half_turn_about_x()
    }

    /// The camera's pose from the pose of its vehicle (body FLU).
    pub fn map_from_camera(&self, map_from_body: &Isometry3<f64>) -> Isometry3<f64> {
        let body_frd_from_camera = Isometry3::from_parts(self.lever.into(), self.body_from_camera);
        map_from_body * half_turn_about_x() * body_frd_from_camera
    }
}

fn half_turn_about_x() -> Isometry3<f64> {
    let turn = nalgebra::Quaternion::new(0.0, 1.0, 0.0, 0.0);
    Isometry3::from_parts(nalgebra::Translation3::identity(), UnitQuaternion::new_unchecked(turn))
}

/// A setpoint of the map in the local frame.
pub fn local_from_map_setpoint(setpoint: &Setpoint) -> (Point3<f64>, Vector3<f64>, f64) {
    (
        local_from_map_point(&setpoint.position),
        local_from_map_vector(&setpoint.velocity),
        local_from_map_yaw(setpoint.yaw),
    )
}

/// An angle in (−π, π].
pub fn wrap(angle: f64) -> f64 {
    let turned = angle.rem_euclid(std::f64::consts::TAU);
    if turned > std::f64::consts::PI { turned - std::f64::consts::TAU } else { turned }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, FRAC_PI_6};

    use approx::assert_relative_eq;
    use volery_geometry::Rng;

    use super::*;

    /// The map pose of a camera at `center` that looks along the map direction of `yaw`, `tilt`
    /// down: columns are its axes in the map.
    fn camera_at(center: [f64; 3], yaw: f64, tilt: f64) -> Isometry3<f64> {
        let ahead = Vector3::new(yaw.cos() * tilt.cos(), yaw.sin() * tilt.cos(), -tilt.sin());
        let right = Vector3::new(yaw.sin(), -yaw.cos(), 0.0);
        let rotation = Matrix3::from_columns(&[right, ahead.cross(&right), ahead]);
        let rotation = Rotation3::from_matrix_unchecked(rotation);
        Isometry3::from_parts(Vector3::from(center).into(), rotation.into())
    }

    fn local_rpy(mount: &CameraMount, map_from_camera: &Isometry3<f64>) -> [f64; 3] {
        roll_pitch_yaw(&local_from_map_pose(&mount.map_from_body(map_from_camera)).rotation)
    }

    #[test]
    fn a_level_camera_along_x_is_zero_and_along_y_is_minus_ninety_degrees() {
        let mount = CameraMount::forward(Vector3::zeros(), 0.0);
        let ahead = local_rpy(&mount, &camera_at([0.0; 3], 0.0, 0.0));
        assert_relative_eq!(ahead[..], [0.0; 3][..], epsilon = 1e-12);
        let left = local_rpy(&mount, &camera_at([0.0; 3], FRAC_PI_2, 0.0));
        assert_relative_eq!(left[..], [0.0, 0.0, -FRAC_PI_2][..], epsilon = 1e-12);
    }

    #[test]
    fn counter_clockwise_in_the_map_is_clockwise_seen_from_below() {
        let turned = Isometry3::rotation(Vector3::z() * FRAC_PI_6);
        let rpy = roll_pitch_yaw(&local_from_map_pose(&turned).rotation);
        assert_relative_eq!(rpy[..], [0.0, 0.0, -FRAC_PI_6][..], epsilon = 1e-12);
    }

    /// Camera at (2, 3, 1.5) looking along x and 30° down, mounted 30° down at (0.1, 0, −0.02).
    #[test]
    fn tilt_and_lever_of_a_mount_are_taken_out() {
        let mount = CameraMount::forward(Vector3::new(0.1, 0.0, -0.02), FRAC_PI_6);
        let camera = camera_at([2.0, 3.0, 1.5], 0.0, FRAC_PI_6);
        let local = local_from_map_pose(&mount.map_from_body(&camera));
        let expected = Vector3::new(1.9, -3.0, -1.48);
        assert_relative_eq!(local.translation.vector, expected, epsilon = 1e-12);
        assert_relative_eq!(local_rpy(&mount, &camera)[..], [0.0; 3][..], epsilon = 1e-12);
        let back = mount.map_from_camera(&mount.map_from_body(&camera));
        assert_relative_eq!(back, camera, epsilon = 1e-12);
    }

    /// R_LB = T R_MB D as matrices, and the change of frame undoes itself.
    #[test]
    fn quaternions_turn_as_the_matrices_do() {
        let mut rng = Rng::new(3);
        let t = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
        for _ in 0..1000 {
            let map_from_body = Isometry3::new(rng.normal3(), rng.normal3() * 2.0);
            let local = local_from_map_pose(&map_from_body);
            let turned = t * map_from_body.rotation.to_rotation_matrix().matrix() * t;
            assert_relative_eq!(
                *local.rotation.to_rotation_matrix().matrix(),
                turned,
                epsilon = 1e-12
            );
            assert_relative_eq!(local_from_map_pose(&local), map_from_body, epsilon = 1e-12);
        }
    }

    #[test]
    fn angles_wrap_into_one_turn() {
        let pi = std::f64::consts::PI;
        for (angle, wrapped) in [(0.0, 0.0), (pi, pi), (-pi, pi), (3.5 * pi, -0.5 * pi)] {
            assert_relative_eq!(wrap(angle), wrapped, epsilon = 1e-12);
        }
    }
}
