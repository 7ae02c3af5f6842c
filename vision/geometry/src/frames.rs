//! Changes of frame by name. The rules are in `docs/frames-and-units.md`.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

/// Camera (x right, y down, z forward) from body FLU (x forward, y left, z up), camera looking
/// along the nose.
pub fn camera_from_body_flu() -> UnitQuaternion<f64> {
    let r = Matrix3::new(0.0, -1.0, 0.0, 0.0, 0.0, -1.0, 1.0, 0.0, 0.0);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(r))
}

/// A vector of the map (x forward, y left, z up) in a north-east-down frame whose north is the
/// map's x.
pub fn ned_from_map(v: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(v.x, -v.y, -v.z)
}

/// A vector of the map (z up) in glTF axes (y up, z forward, x left).
pub fn gltf_from_map(v: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(v.y, v.z, v.x)
}

/// A vector of the map in Unity's left-handed axes (y up, z forward, x right), as the paper
/// prints them.
pub fn unity_from_map(v: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(-v.y, v.z, v.x)
}

/// Rotation of a camera that looks along the drone's nose, in a local frame with x east, y
/// north, z up, from what an autopilot reports.
///
/// * `yaw`: heading, radians clockwise from +y; `pitch`: nose up; `roll`: right side down.
/// * Returns `enu_from_camera`.
pub fn enu_from_camera(yaw: f64, pitch: f64, roll: f64) -> UnitQuaternion<f64> {
    // Aerospace order on north-east-down: Rz(yaw) Ry(pitch) Rx(roll) is ned_from_frd.
    let ned_from_frd = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
    let enu_from_ned = Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0);
    let frd_from_camera = Matrix3::new(0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0);
    let r = enu_from_ned * ned_from_frd.to_rotation_matrix().into_inner() * frd_from_camera;
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(r))
}

/// Yaw, pitch and roll of a camera that looks along the drone's nose: the inverse of
/// [`enu_from_camera`]. Yaw in (−π, π]; yaw and roll are not told apart straight up and down.
pub fn yaw_pitch_roll(enu_from_camera: &UnitQuaternion<f64>) -> [f64; 3] {
    let right = enu_from_camera * Vector3::x();
    let down = enu_from_camera * Vector3::y();
    let forward = enu_from_camera * Vector3::z();
    let pitch = forward.z.atan2(forward.xy().norm());
    [forward.x.atan2(forward.y), pitch, (-right.z).atan2(-down.z)]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The paper's start (-0.66, 1.149, 6.425) is map (6.425, 0.66, 1.149) (P84).
    #[test]
    fn unity_is_the_papers() {
        let map = Vector3::new(6.425, 0.66, 1.149);
        assert_eq!(unity_from_map(&map), Vector3::new(-0.66, 1.149, 6.425));
    }

    #[test]
    fn level_camera_heading_north_looks_along_y() {
        let q = enu_from_camera(0.0, 0.0, 0.0);
        assert!((q * Vector3::z() - Vector3::y()).norm() < 1e-12, "looks north");
        assert!((q * Vector3::y() + Vector3::z()).norm() < 1e-12, "its down is down");
        assert!((q * Vector3::x() - Vector3::x()).norm() < 1e-12, "its right is east");
    }

    /// Signs: clockwise yaw turns north to east, positive pitch lifts the view, positive roll
    /// lowers the right side.
    #[test]
    fn yaw_pitch_roll_signs() {
        let east = enu_from_camera(std::f64::consts::FRAC_PI_2, 0.0, 0.0) * Vector3::z();
        assert!((east - Vector3::x()).norm() < 1e-12);
        assert!((enu_from_camera(0.3, 0.1, 0.0) * Vector3::z()).z > 0.09);
        assert!((enu_from_camera(0.3, 0.0, 0.1) * Vector3::x()).z < -0.09);
    }

    #[test]
    fn yaw_pitch_roll_come_back() {
        for yaw in [-3.0, -1.2, 0.0, 0.7, 2.9] {
            for pitch in [-1.4, -0.3, 0.0, 1.2] {
                for roll in [-2.5, -0.2, 0.0, 0.4] {
                    let found = yaw_pitch_roll(&enu_from_camera(yaw, pitch, roll));
                    for (a, b) in found.into_iter().zip([yaw, pitch, roll]) {
                        assert!((a - b).abs() < 1e-9, "{found:?}");
                    }
                }
            }
        }
    }
}
