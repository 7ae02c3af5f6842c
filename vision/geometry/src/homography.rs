//! Poses behind a homography.

use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};

/// A motion and the plane that together make a homography `H ~ R + t nᵀ/d`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanarMotion {
    /// Translation in units of the plane's distance d from camera 1.
    pub cam2_from_cam1: Isometry3<f64>,
    /// Unit normal of the plane in camera 1, away from the camera: points seen satisfy
    /// `n·x₁ > 0`.
    pub normal_in_cam1: Vector3<f64>,
}

/// The four motions behind a homography of normalized coordinates, `x₂ ~ H x₁`: two solutions,
/// each with both signs of normal and translation. Points that are seen have `n·x₁ > 0`, which
/// leaves two, and sometimes one.
///
/// * Returns `None` for a singular matrix, and for a rotation, which has no translation.
///
/// Source: Ma, Soatto, Košecká & Sastry, An Invitation to 3-D Vision, theorem 5.19.
pub fn poses_from_homography(homography: &Matrix3<f64>) -> Option<[PlanarMotion; 4]> {
    let svd = homography.try_svd(false, true, f64::EPSILON, 100)?;
    let (s, v_t) = (svd.singular_values, svd.v_t?);
    if s[2].is_nan() || s[2] <= 1e-12 * s[0] {
        return None;
    }
    // Middle singular value one; points stay in front of camera 2.
    let mut h = homography / s[1];
    if h.determinant() < 0.0 {
        h = -h;
    }
    let (s1, s3) = ((s[0] / s[1]).powi(2), (s[2] / s[1]).powi(2));
    if s1 - s3 < 1e-12 {
        return None;
    }
    let (v1, v2, v3) = (v_t.row(0).transpose(), v_t.row(1).transpose(), v_t.row(2).transpose());
    let (a, b) = ((1.0 - s3).max(0.0).sqrt(), (s1 - 1.0).max(0.0).sqrt());
    let root = (s1 - s3).sqrt();
    let motion = |u: Vector3<f64>| {
        let normal = v2.cross(&u);
        let (h_v2, h_u) = (h * v2, h * u);
        let w = Matrix3::from_columns(&[h_v2, h_u, h_v2.cross(&h_u)]);
        let r = w * Matrix3::from_columns(&[v2, u, normal]).transpose();
        let t = (h - r) * normal;
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(r));
        let signed = |sign: f64| PlanarMotion {
            cam2_from_cam1: Isometry3::from_parts((t * sign).into(), rotation),
            normal_in_cam1: normal * sign,
        };
        [signed(1.0), signed(-1.0)]
    };
    let [p, q] = motion((v1 * a + v3 * b) / root);
    let [r, s] = motion((v1 * a - v3 * b) / root);
    Some([p, q, r, s])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn truth() -> (Isometry3<f64>, Vector3<f64>) {
        let pose = Isometry3::new(Vector3::new(0.3, -0.1, 0.2), Vector3::new(0.1, -0.2, 0.05));
        (pose, Vector3::new(0.2, -0.3, 0.9).normalize())
    }

    /// Whatever the scale and sign of H, the true motion is among the four.
    #[test]
    fn true_motion_is_among_the_four() {
        let (pose, normal) = truth();
        let r = pose.rotation.to_rotation_matrix().into_inner();
        let h = r + pose.translation.vector * normal.transpose();
        for scale in [1.0, -2.5, 1e-3] {
            let motions = poses_from_homography(&(h * scale)).unwrap();
            let found = motions.iter().any(|m| {
                (m.normal_in_cam1 - normal).norm() < 1e-9
                    && (m.cam2_from_cam1.to_homogeneous() - pose.to_homogeneous()).norm() < 1e-9
            });
            assert!(found, "{motions:?}");
        }
    }

    /// Every one of the four reproduces H.
    #[test]
    fn all_four_explain_the_homography() {
        let (pose, normal) = truth();
        let h = pose.rotation.to_rotation_matrix().into_inner()
            + pose.translation.vector * normal.transpose();
        for m in poses_from_homography(&h).unwrap() {
            let r = m.cam2_from_cam1.rotation.to_rotation_matrix().into_inner();
            let again = r + m.cam2_from_cam1.translation.vector * m.normal_in_cam1.transpose();
            assert!((again - h).norm() < 1e-9);
        }
    }

    #[test]
    fn rotations_and_singular_matrices_have_none() {
        let (pose, _) = truth();
        let r = pose.rotation.to_rotation_matrix().into_inner();
        assert_eq!(poses_from_homography(&r), None);
        assert_eq!(poses_from_homography(&Matrix3::zeros()), None);
    }
}
