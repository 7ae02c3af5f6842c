//! The similarity that maps one point set onto another.

use nalgebra::{
    Isometry3, Matrix3, Point3, Rotation3, Similarity3, Translation3, UnitQuaternion, Vector3,
};

/// Why two point sets have no unique similarity.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum AlignError {
    /// A similarity has seven degrees of freedom and needs three points.
    #[error("a similarity needs at least 3 correspondences, got {got}")]
    TooFewPoints {
        /// Correspondences given.
        got: usize,
    },
    /// The points lie on a line (or coincide), so the rotation about it is free.
    #[error("points are collinear")]
    Collinear,
    /// An input is not finite.
    #[error("a point is not finite")]
    NotFinite,
}

/// Least-squares similarity that maps `source` onto `target`.
///
/// Minimizes over scale `c > 0`, rotation `R` and translation `t`
///
/// ```text
/// 1/n Σᵢ ‖ yᵢ − (c R xᵢ + t) ‖²,   xᵢ = source[i],  yᵢ = target[i]
/// ```
///
/// * `source`, `target`: n ≥ 3 corresponding points, each in its own frame; pairs past the
///   shorter list are ignored.
/// * Returns `target_from_source`.
///
/// # Errors
///
/// [`AlignError::TooFewPoints`], [`AlignError::NotFinite`], and [`AlignError::Collinear`] if the
/// points leave the rotation undetermined. Outliers are not rejected here: call it from RANSAC.
///
/// # Source
///
/// Umeyama, "Least-Squares Estimation of Transformation Parameters Between Two Point Patterns",
/// PAMI 1991, eqs. (34)–(43). Names follow the paper.
pub fn similarity_from_points(
    source: &[Point3<f64>],
    target: &[Point3<f64>],
) -> Result<Similarity3<f64>, AlignError> {
    solve(source, target, false)
}

/// As [`similarity_from_points`] with `c = 1`.
///
/// # Errors
///
/// As there.
pub fn isometry_from_points(
    source: &[Point3<f64>],
    target: &[Point3<f64>],
) -> Result<Isometry3<f64>, AlignError> {
    solve(source, target, true).map(|target_from_source| target_from_source.isometry)
}

fn solve(
    source: &[Point3<f64>],
    target: &[Point3<f64>],
    is_rigid: bool,
) -> Result<Similarity3<f64>, AlignError> {
    let n = source.len().min(target.len());
    if n < 3 {
        return Err(AlignError::TooFewPoints { got: n });
    }
    let (source, target) = (&source[..n], &target[..n]);
    if source.iter().chain(target).any(|p| !p.coords.iter().all(|v| v.is_finite())) {
        return Err(AlignError::NotFinite);
    }
    let n_inv = 1.0 / n as f64;
    let mu_x = source.iter().map(|p| p.coords).sum::<Vector3<f64>>() * n_inv; // (34)
    let mu_y = target.iter().map(|p| p.coords).sum::<Vector3<f64>>() * n_inv; // (35)
    let var_x = source.iter().map(|p| (p.coords - mu_x).norm_squared()).sum::<f64>() * n_inv; // (36)
    let mut cov_xy = Matrix3::zeros(); // (38)
    for (x, y) in source.iter().zip(target) {
        cov_xy += (y.coords - mu_y) * (x.coords - mu_x).transpose() * n_inv;
    }

    let svd = cov_xy.svd(true, true); // Σₓᵧ = U D Vᵀ, D descending
    let (u, v_t) = (svd.u.ok_or(AlignError::NotFinite)?, svd.v_t.ok_or(AlignError::NotFinite)?);
    let d = svd.singular_values;
    // Rank 2 is needed; a thousandth of a millionth of the largest variance is rounding.
    if d[1] <= 1e-9 * d[0] || d[0] <= 0.0 {
        return Err(AlignError::Collinear);
    }

    // S flips the weakest axis when U Vᵀ is a reflection (43).
    let s = Vector3::new(1.0, 1.0, (u.determinant() * v_t.determinant()).signum());
    let r = u * Matrix3::from_diagonal(&s) * v_t; // (40)
    let c = if is_rigid { 1.0 } else { d.dot(&s) / var_x }; // (42)
    let t = mu_y - c * (r * mu_x); // (41)
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(r));
    Ok(Similarity3::from_isometry(Isometry3::from_parts(Translation3::from(t), rotation), c))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tetrahedron() -> Vec<Point3<f64>> {
        vec![
            Point3::new(0.0, 0.0, 0.0),
            Point3::new(1.0, 0.0, 0.2),
            Point3::new(0.0, 2.0, 0.0),
            Point3::new(0.3, 0.1, 1.5),
        ]
    }

    #[test]
    fn exact_data_gives_the_truth_back() {
        let truth =
            Similarity3::new(Vector3::new(1.0, -2.0, 0.5), Vector3::new(0.4, 1.1, -0.3), 2.5);
        let target: Vec<_> = tetrahedron().iter().map(|p| truth * p).collect();
        let found = similarity_from_points(&tetrahedron(), &target).unwrap();
        assert!((found.to_homogeneous() - truth.to_homogeneous()).norm() < 1e-12);
    }

    /// Of a scaled copy, too, and about the mean points.
    #[test]
    fn a_rigid_fit_leaves_the_scale_alone() {
        let truth =
            Similarity3::new(Vector3::new(1.0, -2.0, 0.5), Vector3::new(0.4, 1.1, -0.3), 2.5);
        let target: Vec<_> = tetrahedron().iter().map(|p| truth * p).collect();
        let found = isometry_from_points(&tetrahedron(), &target).unwrap();
        assert!(found.rotation.angle_to(&truth.isometry.rotation) < 1e-12);
        let mean = |points: &[Point3<f64>]| {
            Point3::from(points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / 4.0)
        };
        assert!((found * mean(&tetrahedron()) - mean(&target)).norm() < 1e-12);
    }

    /// Dies if S (43) is dropped: the best fit of a mirror image is still a rotation.
    #[test]
    fn mirrored_points_give_a_rotation() {
        let mirrored: Vec<_> = tetrahedron().iter().map(|p| Point3::new(-p.x, p.y, p.z)).collect();
        let found = similarity_from_points(&tetrahedron(), &mirrored).unwrap();
        let rotation = found.isometry.rotation.to_rotation_matrix();
        assert!((rotation.matrix().determinant() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn degenerate_sets_are_refused() {
        let line: Vec<_> =
            (0..5).map(|i| Point3::new(f64::from(i), 2.0 * f64::from(i), 0.0)).collect();
        assert_eq!(similarity_from_points(&line, &line), Err(AlignError::Collinear));
        let same = vec![Point3::new(1.0, 2.0, 3.0); 4];
        assert_eq!(similarity_from_points(&same, &same), Err(AlignError::Collinear));
        assert_eq!(
            similarity_from_points(&line[..2], &line[..2]),
            Err(AlignError::TooFewPoints { got: 2 })
        );
        let mut nan = tetrahedron();
        nan[1].x = f64::NAN;
        assert_eq!(similarity_from_points(&nan, &tetrahedron()), Err(AlignError::NotFinite));
    }
}
