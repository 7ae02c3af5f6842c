//! Rotation from rays.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

/// Rotation of a camera that only turned, from two correspondences.
///
/// The rotation that maps the bisector and the normal of `b1` onto those of `b2`; exact for exact
/// data, symmetric in the two rays otherwise. `None` for parallel rays.
///
/// * `b1`, `b2`: unit rays in each camera's frame; returns `cam2_from_cam1`.
pub fn rotation_2pt(b1: &[Vector3<f64>; 2], b2: &[Vector3<f64>; 2]) -> Option<Rotation3<f64>> {
    let frame = |b: &[Vector3<f64>; 2]| {
        let bisector = (b[0] + b[1]).try_normalize(1e-9)?;
        let normal = b[0].cross(&b[1]).try_normalize(1e-9)?;
        Some(Matrix3::from_columns(&[bisector, normal, bisector.cross(&normal)]))
    };
    Some(Rotation3::from_matrix_unchecked(frame(b2)? * frame(b1)?.transpose()))
}

/// Least-squares rotation `Σ wᵢ ‖b2ᵢ − R b1ᵢ‖²` of weighted rays; `None` where it is not unique.
///
/// Source: Kabsch 1976 with Umeyama's sign (43).
pub fn rotation_from_bearings(
    pairs: impl Iterator<Item = (Vector3<f64>, Vector3<f64>, f64)>,
) -> Option<UnitQuaternion<f64>> {
    let mut covariance = Matrix3::zeros();
    for (b1, b2, weight) in pairs {
        covariance += b2 * b1.transpose() * weight;
    }
    let svd = covariance.try_svd(true, true, f64::EPSILON, 100)?;
    let (u, v_t, d) = (svd.u?, svd.v_t?, svd.singular_values);
    if d[1].is_nan() || d[1] <= 1e-12 * d[0] {
        return None;
    }
    let s = Vector3::new(1.0, 1.0, (u.determinant() * v_t.determinant()).signum());
    let r = u * Matrix3::from_diagonal(&s) * v_t;
    Some(UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(r)))
}
