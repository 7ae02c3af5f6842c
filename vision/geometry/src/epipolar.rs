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
