//! Alignment of two maps by points that both know.

use std::collections::BTreeMap;

use nalgebra::{Point3, Similarity3, SymmetricEigen};
use volery_estimation::{
    EstimatedSimilarity, SimilarityError, SimilarityOptions, estimate_similarity,
};
use volery_geometry::{AlignError, median};
use volery_scene::{FeatureMatch, ImageId, PointId, SparseModel};

use crate::RegistrationError;
use crate::constraint::{Constraint, TwistMatrix, twist};
use crate::surfels::center;

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

/// The similarity that brings points of `source` to points of `target` that look the same.
///
/// # Errors
///
/// [`RegistrationError::NoOverlap`] where less than twenty points agree,
/// [`RegistrationError::Degenerate`] where they lie on a line or in one spot.
pub fn align_shared_points(
    source: &SparseModel,
    target: &SparseModel,
    matches: &[CrossMatches],
    seed: u64,
) -> Result<SharedAlignment, RegistrationError> {
    let pairs = shared_points(source, target, matches);
    let positions: Vec<(Point3<f64>, Point3<f64>)> = pairs
        .iter()
        .filter_map(|(s, t)| Some((source.points.get(s)?.position, target.points.get(t)?.position)))
        .collect();
    let (from, to): (Vec<_>, Vec<_>) = positions.into_iter().unzip();
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
mod tests {
    use nalgebra::{Isometry3, Point2, Vector3};
    use volery_geometry::Rng;
    use volery_scene::{CameraId, Observation, Point3d, RegisteredImage};

    use super::*;

    /// A map of the given points, which two images from (0, 0, -4) see; keypoint i is point i.
    fn map(points: &[Point3<f64>]) -> SparseModel {
        let mut model = SparseModel::default();
        let num = points.len();
        for image in [0, 1].map(ImageId) {
            model.images.insert(
                image,
                RegisteredImage {
                    name: format!("{}.jpg", image.0),
                    camera: CameraId(0),
                    cam_from_world: Isometry3::translation(0.1 * f64::from(image.0), 0.0, 4.0),
                    keypoints: vec![Point2::origin(); num],
                    points: (0..num as u32).map(|i| Some(PointId(i.into()))).collect(),
                },
            );
        }
        for (i, &position) in points.iter().enumerate() {
            let keypoint = i as u32;
            let track = [0, 1].map(|k| Observation { image: ImageId(k), keypoint }).to_vec();
            let point = Point3d { position, color: [0; 3], error_px: 0.5, track };
            model.points.insert(PointId(keypoint.into()), point);
        }
        model
    }

    fn matches(pairs: impl Iterator<Item = (usize, usize)>) -> Vec<CrossMatches> {
        let to_match = |(a, b)| FeatureMatch { feature1: a as u32, feature2: b as u32 };
        let matches: Vec<FeatureMatch> = pairs.map(to_match).collect();
        vec![CrossMatches { source: ImageId(0), target: ImageId(1), matches }]
    }

    fn spread(rng: &mut Rng, n: usize) -> Vec<Point3<f64>> {
        (0..n).map(|_| Point3::from(rng.normal3() * 1.5)).collect()
    }

    /// P53: two maps in frames and units of their own, 40 of 200 matches right.
    #[test]
    fn a_fifth_of_right_matches_is_enough() {
        let truth =
            Similarity3::new(Vector3::new(3.0, -1.0, 0.5), Vector3::new(0.2, 2.0, -0.4), 1.7);
        let mut normalized = Vec::new();
        for seed in 0..10 {
            let mut rng = Rng::new(seed);
            let source = spread(&mut rng, 200);
            let target: Vec<_> = source.iter().map(|p| truth * p + rng.normal3() * 0.01).collect();
            let shuffled = (0..200).map(|i| (i, if i < 40 { i } else { rng.index(200) }));
            let matches = matches(shuffled.collect::<Vec<_>>().into_iter());
            let found = align_shared_points(&map(&source), &map(&target), &matches, seed).unwrap();
            assert!(found.points.len() >= 38, "{}", found.points.len());
            assert!(found.points.iter().filter(|(s, t)| s == t).count() >= 38);
            let error = found.target_from_source * truth.inverse();
            assert!((error.scaling() - 1.0).abs() < 5e-3);
            assert!(error.isometry.rotation.angle() < 5e-3);
            let c = found.constraint.center;
            let moved = error * c - c;
            let covariance = found.constraint.covariance().unwrap();
            normalized.push(moved.norm_squared() / covariance.fixed_view::<3, 3>(3, 3).trace());
        }
        // χ² of three degrees over its mean: one on average, here of ten draws.
        let mean = normalized.iter().sum::<f64>() / 10.0;
        assert!((0.3..2.5).contains(&mean), "{mean}");
    }

    #[test]
    fn rooms_without_common_points_are_told_apart() {
        for seed in 0..10 {
            let mut rng = Rng::new(seed);
            let (source, target) = (spread(&mut rng, 300), spread(&mut rng, 300));
            let all = matches((0..300).map(|i| (i, i)));
            let found = align_shared_points(&map(&source), &map(&target), &all, seed);
            assert!(matches!(found, Err(RegistrationError::NoOverlap { .. })), "{found:?}");
        }
        let empty = map(&[]);
        let none = align_shared_points(&empty, &empty, &[], 0).unwrap_err();
        assert_eq!(none.code(), "no_overlap");
    }

    /// Fifty points of one poster, 40 cm wide, 4 m away.
    #[test]
    fn a_poster_is_no_overlap() {
        let mut rng = Rng::new(1);
        let poster: Vec<_> =
            (0..50).map(|_| Point3::new(rng.range(-0.2, 0.2), rng.range(-0.3, 0.3), 0.0)).collect();
        let all = matches((0..50).map(|i| (i, i)));
        let found = align_shared_points(&map(&poster), &map(&poster), &all, 1).unwrap_err();
        assert_eq!(found.code(), "underconstrained");
    }

    #[test]
    fn points_are_paired_once_by_votes() {
        let mut rng = Rng::new(2);
        let model = map(&spread(&mut rng, 10));
        let mut votes = matches([(0, 0), (1, 1), (2, 5), (9, 9)].into_iter());
        votes.extend(matches([(0, 3), (2, 5), (1, 1), (99, 0)].into_iter()));
        votes.push(CrossMatches { source: ImageId(7), ..votes[0].clone() });
        let pairs = shared_points(&model, &model, &votes);
        let ids = [(0, 0), (1, 1), (2, 5), (9, 9)].map(|(s, t)| (PointId(s), PointId(t)));
        assert_eq!(pairs, ids);
    }
}
