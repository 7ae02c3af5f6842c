//! Homography from four or more correspondences.

use nalgebra::{Matrix3, Point2, SMatrix, Vector3};

use super::fundamental::{apply_normalization, normalization};

/// The homography `x₂ ~ H x₁` of four correspondences, of unit Frobenius norm.
///
/// Both quadruples are mapped to the projective basis. `None` where three points are collinear.
pub fn homography_4pt(x1: &[Vector3<f64>; 4], x2: &[Vector3<f64>; 4]) -> Option<Matrix3<f64>> {
    let h = points_from_basis(x2)? * points_from_basis(x1)?.try_inverse()?;
    let norm = h.norm();
    (norm.is_finite() && norm > 0.0).then(|| h / norm)
}

/// The matrix that maps the three axes and (1, 1, 1) to the four points.
fn points_from_basis(x: &[Vector3<f64>; 4]) -> Option<Matrix3<f64>> {
    let m = Matrix3::from_columns(&x[..3]);
    let weights = m.try_inverse()? * x[3];
    let size = weights.amax();
    // A weight of zero puts the fourth point on a line through two others.
    (weights.iter().all(|w| w.abs() > 1e-9 * size))
        .then(|| Matrix3::from_columns(&[x[0] * weights[0], x[1] * weights[1], x[2] * weights[2]]))
}

/// The homography `x₂ ~ H x₁` of n ≥ 4 correspondences by the normalized direct linear
/// transform, of unit Frobenius norm.
///
/// Source: Hartley & Zisserman, Multiple View Geometry, algorithm 4.2.
pub fn homography_dlt(x1: &[Point2<f64>], x2: &[Point2<f64>]) -> Option<Matrix3<f64>> {
    let n = x1.len().min(x2.len());
    if n < 4 {
        return None;
    }
    let (t1, t2) = (normalization(&x1[..n])?, normalization(&x2[..n])?);
    let mut a_t_a = SMatrix::<f64, 9, 9>::zeros();
    for (p, q) in x1[..n].iter().zip(&x2[..n]) {
        let (p, q) = (apply_normalization(&t1, p), apply_normalization(&t2, q));
        for row in [
            [p.x, p.y, 1.0, 0.0, 0.0, 0.0, -q.x * p.x, -q.x * p.y, -q.x],
            [0.0, 0.0, 0.0, p.x, p.y, 1.0, -q.y * p.x, -q.y * p.y, -q.y],
        ] {
            let row = SMatrix::<f64, 9, 1>::from(row);
            a_t_a += row * row.transpose();
        }
    }
    let eigen = a_t_a.symmetric_eigen();
    let h = Matrix3::from_row_iterator(
        eigen.eigenvectors.column(eigen.eigenvalues.imin()).iter().copied(),
    );
    let h = t2.try_inverse()? * h * t1;
    let norm = h.norm();
    (norm.is_finite() && norm > 0.0).then(|| h / norm)
}
