//! Alignment of two maps by points that both know.

use std::collections::BTreeMap;

use nalgebra::{Point3, Similarity3, SymmetricEigen};
use volery_estimation::{
    EstimatedSimilarity, SimilarityError, SimilarityOptions, estimate_similarity,
};
use volery_geometry::{AlignError, isometry_from_points, median};
use volery_scene::{FeatureMatch, ImageId, PointId, SparseModel};

use crate::constraint::{Constraint, TwistMatrix, twist};
use crate::surfels::center;
use crate::{Motion, RegistrationError};

/// A point is found again if it falls this near, as a share of the distance from which the target
/// sees its points. Triangulated points are known to 1 to 2 %.
const MAX_ERROR: f64 = 0.02;
/// Fewest points found again.
const MIN_INLIERS: usize = 20;
/// Extent of the points found again in their second direction, share of that distance: a poster
/// that hangs in two rooms does not make them one.
const MIN_EXTENT: f64 = 0.1;
/// Hypotheses; enough for one right pair in twenty.
const MAX_ITERATIONS: usize = 50_000;

/// Keypoints of an image of the source that look like those of an image of the target.
#[derive(Debug, Clone, PartialEq)]
pub struct CrossMatches {
    /// Image of the source; `feature1` counts its keypoints.
    pub source: ImageId,
    /// Image of the target; `feature2` counts its keypoints.
    pub target: ImageId,
    /// Of their keypoints.
    pub matches: Vec<FeatureMatch>,
}

/// A transform from shared points.
#[derive(Debug, Clone, PartialEq)]
pub struct SharedAlignment {
    /// The transform, with scale.
    pub target_from_source: Similarity3<f64>,
    /// Points that both maps know and that it brings together, source and target.
    pub points: Vec<(PointId, PointId)>,
    /// Points that matches pair.
    pub num_pairs: usize,
    /// Root mean square distance of the points brought together, units of the target.
    pub rms: f64,
    /// How well it is known.
    pub constraint: Constraint,
}

/// Pairs of points that keypoint matches suggest, each point in one pair: that with most votes.
pub fn shared_points(
    source: &SparseModel,
    target: &SparseModel,
    matches: &[CrossMatches],
) -> Vec<(PointId, PointId)> {
    let point_of = |model: &SparseModel, image: ImageId, keypoint: u32| {
        model.images.get(&image)?.points.get(keypoint as usize).copied().flatten()
    };
    let mut votes: BTreeMap<(PointId, PointId), u32> = BTreeMap::new();
    for pair in matches {
        for found in &pair.matches {
            let in_source = point_of(source, pair.source, found.feature1);
            let in_target = point_of(target, pair.target, found.feature2);
            if let (Some(s), Some(t)) = (in_source, in_target) {
                *votes.entry((s, t)).or_default() += 1;
            }
        }
    }
    let mut ranked: Vec<((PointId, PointId), u32)> = votes.into_iter().collect();
    ranked.sort_by_key(|&(pair, votes)| (std::cmp::Reverse(votes), pair));
    let mut taken = (std::collections::BTreeSet::new(), std::collections::BTreeSet::new());
    ranked.retain(|&((s, t), _)| {
        let is_free = !taken.0.contains(&s) && !taken.1.contains(&t);
        if is_free {
            taken.0.insert(s);
            taken.1.insert(t);
        }
        is_free
    });
    let mut pairs: Vec<_> = ranked.into_iter().map(|(pair, _)| pair).collect();
    pairs.sort_unstable();
    pairs
}

/// Positions of pairs of points, in either map.
fn positions(
    source: &SparseModel,
    target: &SparseModel,
    pairs: &[(PointId, PointId)],
) -> (Vec<Point3<f64>>, Vec<Point3<f64>>) {
    let of = |(s, t): &(PointId, PointId)| {
        Some((source.points.get(s)?.position, target.points.get(t)?.position))
    };
    pairs.iter().filter_map(of).unzip()
}

/// Pairs of points that keypoint matches suggest and that a known transform brings together.
pub fn agreeing_points(
    source: &SparseModel,
    target: &SparseModel,
    matches: &[CrossMatches],
    target_from_source: &Similarity3<f64>,
) -> Vec<(PointId, PointId)> {
    let pairs = shared_points(source, target, matches);
    let (from, to) = positions(source, target, &pairs);
    let max_error = MAX_ERROR * viewing_distance(target, pairs.iter().map(|pair| pair.1));
    let agrees = |k: usize| (target_from_source * from[k] - to[k]).norm() <= max_error;
    (0..from.len()).filter(|&k| agrees(k)).map(|k| pairs[k]).collect()
}

/// Rounds of fitting to those that fit, where the scale is known.
const RIGID_ROUNDS: usize = 3;

/// The same without scale: fitted to the inliers, which are chosen anew.
fn without_scale(
    mut found: EstimatedSimilarity,
    from: &[Point3<f64>],
    to: &[Point3<f64>],
    max_error: f64,
) -> Result<EstimatedSimilarity, AlignError> {
    for _ in 0..RIGID_ROUNDS {
        let kept = |points: &[Point3<f64>]| -> Vec<Point3<f64>> {
            points.iter().zip(&found.inliers).filter(|(_, i)| **i).map(|(p, _)| *p).collect()
        };
        let target_from_source = isometry_from_points(&kept(from), &kept(to))?;
        let errors = from.iter().zip(to).map(|(f, t)| (target_from_source * f - t).norm());
        let inliers: Vec<bool> = errors.clone().map(|error| error <= max_error).collect();
        let squares = errors.filter(|error| *error <= max_error).map(|error| error * error);
        let num_inliers = inliers.iter().filter(|inlier| **inlier).count();
        let rms = (squares.sum::<f64>() / num_inliers.max(1) as f64).sqrt();
        let target_from_source = Similarity3::from_isometry(target_from_source, 1.0);
        found = EstimatedSimilarity { target_from_source, inliers, num_inliers, rms };
    }
    Ok(found)
}

/// The transform that brings points of `source` to points of `target` that look the same.
///
/// # Errors
///
/// [`RegistrationError::NoOverlap`] where less than twenty points agree,
/// [`RegistrationError::Degenerate`] where they lie on a line or in one spot.
pub fn align_shared_points(
    source: &SparseModel,
    target: &SparseModel,
    matches: &[CrossMatches],
    motion: Motion,
    seed: u64,
) -> Result<SharedAlignment, RegistrationError> {
    let pairs = shared_points(source, target, matches);
    let (from, to) = positions(source, target, &pairs);
    let distance = viewing_distance(target, pairs.iter().map(|pair| pair.1));
    let options = SimilarityOptions {
        max_error: MAX_ERROR * distance,
        min_inliers: MIN_INLIERS,
        failure_probability: 1e-4,
        max_iterations: MAX_ITERATIONS,
    };
    let share = |inliers: usize| inliers as f64 / pairs.len().max(1) as f64;
    let found = estimate_similarity(&from, &to, &options, seed).map_err(|error| match error {
        SimilarityError::Degenerate(AlignError::TooFewPoints { .. }) => {
            RegistrationError::NoOverlap { overlap: 0.0, contradiction: 0.0 }
        }
        SimilarityError::Degenerate(error) => error.into(),
        SimilarityError::TooFewInliers { num_inliers, .. } => {
            RegistrationError::NoOverlap { overlap: share(num_inliers), contradiction: 0.0 }
        }
    })?;
    let found = match motion {
        Motion::Similarity => found,
        Motion::Rigid => without_scale(found, &from, &to, options.max_error)?,
    };
    if found.num_inliers < MIN_INLIERS {
        let overlap = share(found.num_inliers);
        return Err(RegistrationError::NoOverlap { overlap, contradiction: 0.0 });
    }
    let inliers: Vec<Point3<f64>> =
        to.iter().zip(&found.inliers).filter(|(_, inlier)| **inlier).map(|(p, _)| *p).collect();
    if second_extent(&inliers) < MIN_EXTENT * distance {
        return Err(AlignError::Collinear.into());
    }
    let EstimatedSimilarity { target_from_source, rms, .. } = found;
    let points = pairs.iter().zip(&found.inliers).filter(|(_, i)| **i).map(|(p, _)| *p).collect();
    let constraint = constraint(&inliers, rms);
    Ok(SharedAlignment { target_from_source, points, num_pairs: pairs.len(), rms, constraint })
}

/// Median distance of points from the first camera that saw them; infinite for none, so that no
/// error is too large for nothing.
fn viewing_distance(model: &SparseModel, points: impl Iterator<Item = PointId>) -> f64 {
    let distance = |id: PointId| {
        let point = model.points.get(&id)?;
        let image = model.images.get(&point.track.first()?.image)?;
        Some((point.position - image.center()).norm())
    };
    median(&mut points.filter_map(distance).collect::<Vec<_>>()).unwrap_or(0.0)
}

/// Standard deviation along the second principal axis.
fn second_extent(points: &[Point3<f64>]) -> f64 {
    let middle = center(points.iter().copied());
    let scatter: nalgebra::Matrix3<f64> =
        points.iter().map(|p| (p - middle) * (p - middle).transpose()).sum();
    let mut values = SymmetricEigen::new(scatter / points.len().max(1) as f64).eigenvalues;
    values.as_mut_slice().sort_by(f64::total_cmp);
    values[1].max(0.0).sqrt()
}

/// Of points that are known to `rms` together, in all directions.
fn constraint(points: &[Point3<f64>], rms: f64) -> Constraint {
    let center = center(points.iter().copied());
    // A residual has three components.
    let sigma = (rms / 3.0_f64.sqrt()).max(f64::MIN_POSITIVE.sqrt());
    let mut information = TwistMatrix::zeros();
    for point in points {
        let arm = point - center;
        for k in 0..3 {
            let axis = nalgebra::Vector3::ith(k, 1.0 / sigma);
            let row = twist(&arm.cross(&axis), &axis, arm.dot(&axis));
            information += row * row.transpose();
        }
    }
    Constraint { center, information, sigma, free: Vec::new() }
}

#[cfg(test)]
mod tests;
