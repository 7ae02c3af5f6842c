//! Fundamental matrix from seven or more correspondences.

use arrayvec::ArrayVec;
use nalgebra::{Matrix3, Point2, SMatrix, Vector3};

use super::null_space::null_space;
use super::polynomial::cubic_roots;

/// Fundamental matrices of seven correspondences, up to three, of unit Frobenius norm.
///
/// `F = αF₁ + (1 − α)F₂` with `det F = 0`, F₁ and F₂ spanning the null space of `x₂ᵀ F x₁ = 0`.
/// The points should be of order one.
///
/// Source: Hartley & Zisserman, Multiple View Geometry, 11.1.2.
pub fn fundamental_7pt(x1: &[Point2<f64>; 7], x2: &[Point2<f64>; 7]) -> ArrayVec<Matrix3<f64>, 3> {
    let rows: [[f64; 9]; 7] = std::array::from_fn(|i| epipolar_row(&x1[i], &x2[i]));
    let basis: [[f64; 9]; 2] = null_space(rows);
    let a = Matrix3::from_row_slice(&basis[0]);
    let b = Matrix3::from_row_slice(&basis[1]);
    // det(αA + B): the cubic through the columns' determinants.
    let det = |m: [(&Matrix3<f64>, usize); 3]| {
        let c = m.map(|(m, i)| m.column(i).into_owned());
        c[0].dot(&c[1].cross(&c[2]))
    };
    let c3 = a.determinant();
    let c2 = det([(&b, 0), (&a, 1), (&a, 2)])
        + det([(&a, 0), (&b, 1), (&a, 2)])
        + det([(&a, 0), (&a, 1), (&b, 2)]);
    let c1 = det([(&a, 0), (&b, 1), (&b, 2)])
        + det([(&b, 0), (&a, 1), (&b, 2)])
        + det([(&b, 0), (&b, 1), (&a, 2)]);
    let c0 = b.determinant();
    cubic_roots(c3, c2, c1, c0)
        .into_iter()
        .map(|alpha| a * alpha + b)
        .map(|f| f / f.norm())
        .filter(|f| f.iter().all(|v| v.is_finite()))
        .collect()
}

/// Fundamental matrix of n ≥ 8 correspondences by the normalized eight-point algorithm (P20,
/// Eq. (2)), of rank two and unit Frobenius norm.
///
/// * Returns `None` for fewer than eight, or points that do not determine it.
///
/// Source: Hartley, "In Defense of the Eight-Point Algorithm", PAMI 1997.
pub fn fundamental_8pt(x1: &[Point2<f64>], x2: &[Point2<f64>]) -> Option<Matrix3<f64>> {
    let n = x1.len().min(x2.len());
    if n < 8 {
        return None;
    }
    let (t1, t2) = (normalization(&x1[..n])?, normalization(&x2[..n])?);
    let mut a_t_a = SMatrix::<f64, 9, 9>::zeros();
    for (p, q) in x1[..n].iter().zip(&x2[..n]) {
        let row = SMatrix::<f64, 9, 1>::from(epipolar_row(
            &apply_normalization(&t1, p),
            &apply_normalization(&t2, q),
        ));
        a_t_a += row * row.transpose();
    }
    let eigen = a_t_a.symmetric_eigen();
    let f = Matrix3::from_row_iterator(
        eigen.eigenvectors.column(eigen.eigenvalues.imin()).iter().copied(),
    );
    let f = t2.transpose() * closest_of_rank_two(&f)? * t1;
    let norm = f.norm();
    (norm.is_finite() && norm > 0.0).then(|| f / norm)
}

/// The closest matrix of rank two.
pub(crate) fn closest_of_rank_two(f: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let svd = f.try_svd(true, true, f64::EPSILON, 100)?;
    let (u, v_t, s) = (svd.u?, svd.v_t?, svd.singular_values);
    Some(u * Matrix3::from_diagonal(&Vector3::new(s[0], s[1], 0.0)) * v_t)
}

fn epipolar_row(p: &Point2<f64>, q: &Point2<f64>) -> [f64; 9] {
    [q.x * p.x, q.x * p.y, q.x, q.y * p.x, q.y * p.y, q.y, p.x, p.y, 1.0]
}

/// The transform that moves the points' mean to the origin and their mean distance to √2.
pub(super) fn normalization(points: &[Point2<f64>]) -> Option<Matrix3<f64>> {
    let n = points.len() as f64;
    let mean = points.iter().map(|p| p.coords).sum::<nalgebra::Vector2<f64>>() / n;
    let spread = points.iter().map(|p| (p.coords - mean).norm()).sum::<f64>() / n;
    let s = std::f64::consts::SQRT_2 / spread;
    s.is_finite().then(|| Matrix3::new(s, 0.0, -s * mean.x, 0.0, s, -s * mean.y, 0.0, 0.0, 1.0))
}

pub(super) fn apply_normalization(t: &Matrix3<f64>, p: &Point2<f64>) -> Point2<f64> {
    Point2::new(t[(0, 0)] * p.x + t[(0, 2)], t[(1, 1)] * p.y + t[(1, 2)])
}
