//! Essential and fundamental matrices of known poses, Sampson error, decompositions.

use nalgebra::{Isometry3, Matrix3, Point2, UnitQuaternion, Vector3};

use crate::camera::Camera;

/// `[v]ₓ`, the matrix of the cross product by `v`.
pub fn cross_matrix(v: &Vector3<f64>) -> Matrix3<f64> {
    v.cross_matrix()
}

/// `E = [t]ₓ R` of `cam2_from_cam1 = (R, t)`: `x₂ᵀ E x₁ = 0` in normalized coordinates.
pub fn essential_from_pose(cam2_from_cam1: &Isometry3<f64>) -> Matrix3<f64> {
    cam2_from_cam1.translation.vector.cross_matrix()
        * cam2_from_cam1.rotation.to_rotation_matrix().into_inner()
}

/// `F = K₂⁻ᵀ E K₁⁻¹` (P22 corrected); distortion is not part of it.
pub fn fundamental_from_essential(
    essential: &Matrix3<f64>,
    camera1: &Camera,
    camera2: &Camera,
) -> Option<Matrix3<f64>> {
    let k1_inv = camera1.calibration_matrix().try_inverse()?;
    let k2_inv = camera2.calibration_matrix().try_inverse()?;
    Some(k2_inv.transpose() * essential * k1_inv)
}

/// Squared Sampson error of `x₂ᵀ F x₁ = 0`, in the squared units of the points.
///
/// Source: Hartley & Zisserman, Multiple View Geometry, eq. (11.9).
pub fn squared_sampson_error(f: &Matrix3<f64>, x1: &Point2<f64>, x2: &Point2<f64>) -> f64 {
    let (h1, h2) = (x1.to_homogeneous(), x2.to_homogeneous());
    let f_x1 = f * h1;
    let ft_x2 = f.tr_mul(&h2);
    let c = h2.dot(&f_x1);
    let denominator = f_x1.x * f_x1.x + f_x1.y * f_x1.y + ft_x2.x * ft_x2.x + ft_x2.y * ft_x2.y;
    if denominator > 0.0 { c * c / denominator } else { f64::INFINITY }
}

/// `E = K₂ᵀ F K₁` (P22, Eq. (3) corrected).
pub fn essential_from_fundamental(
    fundamental: &Matrix3<f64>,
    camera1: &Camera,
    camera2: &Camera,
) -> Matrix3<f64> {
    camera2.calibration_matrix().transpose() * fundamental * camera1.calibration_matrix()
}

/// Focal lengths of both cameras behind a fundamental matrix, pixels.
///
/// ```text
/// f₁² = − (p₂ᵀ [e₂]ₓ Ĩ F p₁) (p₁ᵀ Fᵀ p₂) / (p₂ᵀ [e₂]ₓ Ĩ F Ĩ Fᵀ p₂),   Ĩ = diag(1, 1, 0)
/// ```
///
/// and the same with the images exchanged.
///
/// * `principal_point1`, `principal_point2`: pixels; square pixels are assumed.
/// * Returns `None` where a square is not positive: parallel or intersecting optical axes leave
///   the focal lengths undetermined, and noise near them has the same effect.
///
/// Source: Bougnoux, "From Projective to Euclidean Space Under Any Practical Situation", ICCV
/// 1998.
pub fn focals_from_fundamental(
    fundamental: &Matrix3<f64>,
    principal_point1: &Point2<f64>,
    principal_point2: &Point2<f64>,
) -> Option<[f64; 2]> {
    let (p1, p2) = (principal_point1.to_homogeneous(), principal_point2.to_homogeneous());
    let focal = |f: &Matrix3<f64>, p1: &Vector3<f64>, p2: &Vector3<f64>| {
        let svd = f.try_svd(true, false, f64::EPSILON, 100)?;
        let epipole2 = svd.u?.column(2).into_owned();
        let flat = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, 0.0));
        let row = p2.transpose() * epipole2.cross_matrix() * flat * f;
        let numerator = (row * p1).x * (p2.transpose() * f * p1).x;
        let denominator = (row * flat * f.transpose() * p2).x;
        let focal = (-numerator / denominator).sqrt();
        (focal.is_finite() && focal > 0.0).then_some(focal)
    };
    Some([focal(fundamental, &p1, &p2)?, focal(&fundamental.transpose(), &p2, &p1)?])
}

/// The four poses of an essential matrix, translations of unit length (P23, Eq. (4)).
///
/// `E = U diag(1,1,0) Vᵀ`; `R = U W Vᵀ` or `U Wᵀ Vᵀ`, `t = ±u₃`.
pub fn poses_from_essential(essential: &Matrix3<f64>) -> Option<[Isometry3<f64>; 4]> {
    let svd = essential.svd(true, true);
    let (mut u, mut v_t) = (svd.u?, svd.v_t?);
    if u.determinant() < 0.0 {
        u = -u;
    }
    if v_t.determinant() < 0.0 {
        v_t = -v_t;
    }
    let w = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
    let t = u.column(2).into_owned();
    let pose = |r: Matrix3<f64>, t: Vector3<f64>| {
        let rotation = nalgebra::Rotation3::from_matrix_unchecked(r);
        Isometry3::from_parts(t.into(), UnitQuaternion::from_rotation_matrix(&rotation))
    };
    let (r1, r2) = (u * w * v_t, u * w.transpose() * v_t);
    Some([pose(r1, t), pose(r1, -t), pose(r2, t), pose(r2, -t)])
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::CameraModel;

    fn cameras() -> [Camera; 2] {
        let new = |params: &[f64]| Camera::new(CameraModel::Pinhole, 640, 480, params).unwrap();
        [new(&[520.0, 530.0, 310.0, 250.0]), new(&[700.0, 690.0, 330.0, 235.0])]
    }

    fn poses() -> Vec<Isometry3<f64>> {
        (0..20)
            .map(|i| {
                let a = f64::from(i);
                Isometry3::new(
                    Vector3::new((1.3 * a).sin(), (2.1 * a).cos(), (0.7 * a).sin() * 0.5),
                    Vector3::new(0.2 * a.sin(), 0.3 * (1.7 * a).cos(), 0.1 * (0.3 * a).sin()),
                )
            })
            .collect()
    }

    fn points() -> impl Iterator<Item = Point3<f64>> {
        (0..30).map(|i| {
            let a = f64::from(i);
            Point3::new((3.1 * a).sin() * 1.5, (1.9 * a).cos(), 5.0 + 2.0 * (0.9 * a).sin())
        })
    }

    /// P22: both ways between E and F agree, and both hold for the pixels of true points.
    #[test]
    fn essential_and_fundamental_agree() {
        let [camera1, camera2] = cameras();
        for pose in poses() {
            let e = essential_from_pose(&pose);
            let f = fundamental_from_essential(&e, &camera1, &camera2).unwrap();
            let again = essential_from_fundamental(&f, &camera1, &camera2);
            assert!((again - e).norm() < 1e-12 * e.norm());
            for p in points() {
                let (x1, x2) = (camera1.project(&p), camera2.project(&(pose * p)));
                let (x1, x2) = (x1.unwrap(), x2.unwrap());
                assert!(squared_sampson_error(&f, &x1, &x2) < 1e-16);
            }
        }
    }

    /// P23: the four candidates are `U W Vᵀ`, `U Wᵀ Vᵀ` with `±u₃`, rotations all, E for each up
    /// to sign, and one is the truth.
    #[test]
    fn four_candidates_equal_the_formula() {
        for pose in poses() {
            let e = essential_from_pose(&pose).normalize();
            let candidates = poses_from_essential(&e).unwrap();
            for c in &candidates {
                let r = c.rotation.to_rotation_matrix();
                assert!((r.matrix().determinant() - 1.0).abs() < 1e-12);
                let again = essential_from_pose(c).normalize();
                assert!((again - e).norm().min((again + e).norm()) < 1e-9);
                assert!((c.translation.vector.norm() - 1.0).abs() < 1e-12);
            }
            assert_eq!(candidates[0].translation.vector, -candidates[1].translation.vector);
            assert_eq!(candidates[0].rotation, candidates[1].rotation);
            assert_eq!(candidates[2].rotation, candidates[3].rotation);
            // The two rotations differ by half a turn about the baseline.
            let between = candidates[2].rotation * candidates[0].rotation.inverse();
            assert!((between.angle() - std::f64::consts::PI).abs() < 1e-6);
            let t = pose.translation.vector.normalize();
            let is_truth = |c: &&Isometry3<f64>| {
                (c.translation.vector - t).norm() < 1e-8
                    && c.rotation.angle_to(&pose.rotation) < 1e-7
            };
            assert_eq!(candidates.iter().filter(is_truth).count(), 1);
        }
    }

    /// P24: without noise exactly one candidate has the points in front of both cameras, and it
    /// is the truth.
    #[test]
    fn cheirality_picks_the_truth() {
        for pose in poses() {
            let t = pose.translation.vector.normalize();
            let candidates = poses_from_essential(&essential_from_pose(&pose)).unwrap();
            for p in points() {
                let xy = |p: Point3<f64>| nalgebra::Vector2::new(p.x / p.z, p.y / p.z);
                let seen = [xy(p), xy(pose * p)];
                let in_front = |c: &&Isometry3<f64>| {
                    let views = [Isometry3::identity(), **c];
                    crate::triangulation::triangulate_linear(&views, &seen)
                        .is_some_and(|x| x.z > 0.0 && (*c * x).z > 0.0)
                };
                let front: Vec<_> = candidates.iter().filter(in_front).collect();
                assert_eq!(front.len(), 1);
                assert!((front[0].translation.vector - t).norm() < 1e-8);
            }
        }
    }

    /// The focal lengths come back wherever the optical axes do not meet.
    #[test]
    fn focal_lengths_come_back() {
        let new = |focal| Camera::from_focal(CameraModel::Pinhole, 640, 480, focal).unwrap();
        let (camera1, camera2) = (new(520.0), new(700.0));
        let pose = Isometry3::new(Vector3::new(0.8, -0.3, 0.2), Vector3::new(0.2, -0.3, 0.1));
        let e = essential_from_pose(&pose);
        let f = fundamental_from_essential(&e, &camera1, &camera2).unwrap();
        let centers = (camera1.principal_point(), camera2.principal_point());
        let [f1, f2] = focals_from_fundamental(&(f * -3.0), &centers.0, &centers.1).unwrap();
        assert!((f1 - 520.0).abs() < 1e-6 && (f2 - 700.0).abs() < 1e-6, "{f1} {f2}");
        // A sideways step: parallel axes.
        let sideways = essential_from_pose(&Isometry3::translation(1.0, 0.0, 0.0));
        let f = fundamental_from_essential(&sideways, &camera1, &camera2).unwrap();
        assert_eq!(focals_from_fundamental(&f, &centers.0, &centers.1), None);
    }
}
