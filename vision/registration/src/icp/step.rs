//! The motion that brings given pairs together.

use nalgebra::{Matrix3, Similarity3, Vector3};
use volery_geometry::{AlignError, isometry_from_points, similarity_from_points};

use super::{IcpOptions, Metric, Pair, center, similarity_from_twist};
use crate::constraint::{Twist, TwistMatrix};
use crate::surfels::{Surfel, Surfels};
use crate::{Motion, RegistrationError};

/// Variance of a surface across itself by that along itself. Segal et al. take 1e-3.
const FLATNESS: f64 = 1e-3;
/// Keeps directions that nothing determines where they are.
const DAMPING: f64 = 1e-9;

/// `2ε (Cₜ + R Cₛ Rᵀ)⁻¹` with `C = 1 − (1 − ε) n nᵀ`: one across surfaces that are parallel, ε
/// along them.
///
/// * `source`: the normal of the source, turned into the target frame.
pub(super) fn information(source: &Vector3<f64>, target: &Vector3<f64>) -> Matrix3<f64> {
    // With h = ε − 1: (2 + h (a aᵀ + b bᵀ))⁻¹ by Woodbury, all in the plane of a and b:
    // eigenvectors a ± b with eigenvalues 2 + h (1 ± c), and 2 across.
    let h = FLATNESS - 1.0;
    let c = source.dot(target).clamp(-1.0, 1.0);
    let half = Matrix3::identity() * 0.5;
    let along = |v: Vector3<f64>, eigenvalue: f64| match v.try_normalize(1e-9) {
        Some(v) => v * v.transpose() * (1.0 / eigenvalue - 0.5),
        None => Matrix3::zeros(),
    };
    let sum = along(source + target, 2.0 + h * (1.0 + c));
    let difference = along(source - target, 2.0 + h * (1.0 - c));
    (half + sum + difference) * (2.0 * FLATNESS)
}

/// The next transform.
pub(super) fn step(
    source: &[Surfel],
    target: &Surfels,
    target_from_source: &Similarity3<f64>,
    pairs: &[Pair],
    options: &IcpOptions,
    sigma: f64,
) -> Result<Similarity3<f64>, RegistrationError> {
    if options.metric == Metric::PointToPoint {
        return Ok(closed_form(target, pairs, options.motion)? * target_from_source);
    }
    let rotation = target_from_source.isometry.rotation;
    let middle = center(pairs.iter().map(|pair| pair.at));
    let mut h = TwistMatrix::zeros();
    let mut g = Twist::zeros();
    for pair in pairs {
        let weight = options.kernel.weight(pair.squared.sqrt() / sigma);
        let other = &target.pieces()[pair.target as usize];
        let arm = pair.at - middle;
        let d = pair.at - other.position;
        if options.metric == Metric::PointToPlane {
            let n = other.normal;
            let row = crate::constraint::twist(&arm.cross(&n), &n, arm.dot(&n));
            h.syger(weight, &row, &row, 1.0);
            g += row * (weight * n.dot(&d));
        } else {
            let m = information(&(rotation * source[pair.source as usize].normal), &other.normal);
            accumulate(&mut h, &mut g, &arm, &d, &(m * weight));
        }
    }
    h.fill_upper_triangle_with_lower_triangle();
    let solved = solve(&h, &g, options.motion)?;
    Ok(similarity_from_twist(&middle, &solved) * target_from_source)
}

/// Adds the lower half of `Jᵀ M J` and `Jᵀ M d`, where `J = [−[a]×, 1, a]`: `Jᵀ v = (a × v, v,
/// a · v)`.
fn accumulate(
    h: &mut TwistMatrix,
    g: &mut Twist,
    arm: &Vector3<f64>,
    d: &Vector3<f64>,
    m: &Matrix3<f64>,
) {
    let md = m * d;
    *g += crate::constraint::twist(&arm.cross(&md), &md, arm.dot(&md));
    for k in 0..7 {
        // Column k of J.
        let column = match k {
            0..3 => Vector3::ith(k, 1.0).cross(arm),
            3..6 => Vector3::ith(k - 3, 1.0),
            _ => *arm,
        };
        let v = m * column;
        let entries = crate::constraint::twist(&arm.cross(&v), &v, arm.dot(&v));
        for row in k..7 {
            h[(row, k)] += entries[row];
        }
    }
}

fn solve(h: &TwistMatrix, g: &Twist, motion: Motion) -> Result<Twist, AlignError> {
    let mut damped = h + TwistMatrix::identity() * (DAMPING * h.diagonal().max());
    let mut right = -g;
    if motion == Motion::Rigid {
        damped.fixed_view_mut::<1, 6>(6, 0).fill(0.0);
        damped.fixed_view_mut::<6, 1>(0, 6).fill(0.0);
        right[6] = 0.0;
    }
    let factor = damped.cholesky().ok_or(AlignError::Collinear)?;
    Ok(factor.solve(&right))
}

/// Umeyama's solution; rigid motions leave the scale as it is.
fn closed_form(
    target: &Surfels,
    pairs: &[Pair],
    motion: Motion,
) -> Result<Similarity3<f64>, AlignError> {
    let from: Vec<_> = pairs.iter().map(|pair| pair.at).collect();
    let to: Vec<_> =
        pairs.iter().map(|pair| target.pieces()[pair.target as usize].position).collect();
    match motion {
        Motion::Similarity => similarity_from_points(&from, &to),
        Motion::Rigid => Ok(Similarity3::from_isometry(isometry_from_points(&from, &to)?, 1.0)),
    }
}
