//! Robust similarity between two point sets with wrong correspondences.

use arrayvec::ArrayVec;
use nalgebra::{Point3, Similarity3};
use volery_geometry::{AlignError, Rng, similarity_from_points};

use crate::ransac::{Estimator, Hypotheses, RansacOptions, Score, lo_ransac};

/// Options of [`estimate_similarity`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SimilarityOptions {
    /// Inlier threshold on the distance in the target frame, target units.
    pub max_error: f64,
    /// Fewest inliers of an answer.
    pub min_inliers: usize,
    /// Chance of never having drawn an all-inlier sample.
    pub failure_probability: f64,
    /// Bound on the number of hypotheses.
    pub max_iterations: usize,
}

impl Default for SimilarityOptions {
    fn default() -> Self {
        Self { max_error: 0.1, min_inliers: 4, failure_probability: 1e-4, max_iterations: 10_000 }
    }
}

/// Why there is no similarity.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum SimilarityError {
    /// The points themselves do not determine one.
    #[error(transparent)]
    Degenerate(#[from] AlignError),
    /// The best hypothesis has too little support.
    #[error("best similarity has {num_inliers} inliers of {total}, {needed} needed")]
    TooFewInliers {
        /// Support of the best hypothesis.
        num_inliers: usize,
        /// Correspondences.
        total: usize,
        /// What it takes.
        needed: usize,
    },
}

/// A similarity with its support.
#[derive(Debug, Clone, PartialEq)]
pub struct EstimatedSimilarity {
    /// Least squares over the inliers.
    pub target_from_source: Similarity3<f64>,
    /// Per correspondence.
    pub inliers: Vec<bool>,
    /// Number of inliers.
    pub num_inliers: usize,
    /// Root mean square distance of the inliers, target units.
    pub rms: f64,
}

/// Similarity that maps `source` onto `target` by three-point samples in LO-RANSAC.
///
/// * `source[i]` and `target[i]` are the same point, each in its own frame; pairs past the shorter
///   list are ignored.
/// * Deterministic for equal arguments.
///
/// # Errors
///
/// [`SimilarityError`] for fewer than three pairs, for values that are not finite, for points on a
/// line, and where no similarity has the support that `options` demand.
pub fn estimate_similarity(
    source: &[Point3<f64>],
    target: &[Point3<f64>],
    options: &SimilarityOptions,
    seed: u64,
) -> Result<EstimatedSimilarity, SimilarityError> {
    let total = source.len().min(target.len());
    if total < 3 {
        return Err(AlignError::TooFewPoints { got: total }.into());
    }
    let (source, target) = (&source[..total], &target[..total]);
    if source.iter().chain(target).any(|p| !p.coords.iter().all(|v| v.is_finite())) {
        return Err(AlignError::NotFinite.into());
    }
    let squared_threshold = options.max_error * options.max_error;
    let estimator = SimilarityEstimator { source, target, squared_threshold };
    let ransac = RansacOptions {
        failure_probability: options.failure_probability,
        min_iterations: 20,
        max_iterations: options.max_iterations,
    };
    let needed = options.min_inliers.max(3);
    let too_few = |num_inliers| SimilarityError::TooFewInliers { num_inliers, total, needed };
    let found =
        lo_ransac(&estimator, &[], &ransac, &mut Rng::new(seed)).ok_or(AlignError::Collinear)?;
    if found.score.num_inliers < needed {
        return Err(too_few(found.score.num_inliers));
    }
    let target_from_source = estimator.refine(&found.model).ok_or(AlignError::Collinear)?;
    let errors: Vec<f64> =
        (0..total).map(|i| estimator.squared_error(&target_from_source, i)).collect();
    let inliers: Vec<bool> = errors.iter().map(|&e| e < squared_threshold).collect();
    let num_inliers = inliers.iter().filter(|&&inlier| inlier).count();
    if num_inliers < needed {
        return Err(too_few(num_inliers));
    }
    let sum: f64 = errors.iter().filter(|&&e| e < squared_threshold).sum();
    let rms = (sum / num_inliers as f64).sqrt();
    Ok(EstimatedSimilarity { target_from_source, inliers, num_inliers, rms })
}

struct SimilarityEstimator<'a> {
    source: &'a [Point3<f64>],
    target: &'a [Point3<f64>],
    squared_threshold: f64,
}

impl SimilarityEstimator<'_> {
    fn squared_error(&self, model: &Similarity3<f64>, i: usize) -> f64 {
        (model * self.source[i] - self.target[i]).norm_squared()
    }
}

impl Estimator for SimilarityEstimator<'_> {
    type Model = Similarity3<f64>;
    const SAMPLE_SIZE: usize = 3;

    fn num_data(&self) -> usize {
        self.source.len()
    }

    fn solve(&self, sample: &[usize], hypotheses: &mut Hypotheses<Self::Model>) {
        let pick = |points: &[Point3<f64>]| -> ArrayVec<Point3<f64>, 3> {
            sample.iter().map(|&i| points[i]).collect()
        };
        hypotheses.extend(similarity_from_points(&pick(self.source), &pick(self.target)));
    }

    fn score(&self, model: &Self::Model, bound: f64) -> Score {
        let mut score = Score { cost: 0.0, num_inliers: 0 };
        for i in 0..self.source.len() {
            let e = self.squared_error(model, i);
            if e < self.squared_threshold {
                score.num_inliers += 1;
                score.cost += e;
            } else {
                score.cost += self.squared_threshold;
            }
            if score.cost > bound {
                break;
            }
        }
        score
    }

    fn refine(&self, model: &Self::Model) -> Option<Self::Model> {
        let (source, target): (Vec<_>, Vec<_>) = (0..self.source.len())
            .filter(|&i| self.squared_error(model, i) < self.squared_threshold)
            .map(|i| (self.source[i], self.target[i]))
            .unzip();
        similarity_from_points(&source, &target).ok()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::test_scene::room_point;

    #[test]
    fn half_the_correspondences_are_wrong() {
        let truth =
            Similarity3::new(Vector3::new(3.0, -1.0, 0.5), Vector3::new(0.2, 2.0, -0.4), 1.7);
        for seed in 0..20 {
            let mut random = Rng::new(seed);
            let source: Vec<_> = (0..80).map(|_| room_point(&mut random)).collect();
            let target: Vec<_> = source
                .iter()
                .enumerate()
                .map(|(i, p)| {
                    let p = if i < 40 { *p } else { room_point(&mut random) };
                    truth * p + random.normal3() * 0.01
                })
                .collect();
            let found =
                estimate_similarity(&source, &target, &SimilarityOptions::default(), seed).unwrap();
            assert!(found.inliers[..40].iter().all(|&i| i) && found.num_inliers <= 44);
            let found = found.target_from_source;
            assert!((found.scaling() / truth.scaling() - 1.0).abs() < 3e-3);
            assert!(found.isometry.rotation.angle_to(&truth.isometry.rotation) < 5e-3);
        }
    }

    #[test]
    fn degenerate_input_is_refused() {
        let solve = |s: &[Point3<f64>], t: &[Point3<f64>]| {
            estimate_similarity(s, t, &SimilarityOptions::default(), 1)
        };
        assert_eq!(solve(&[], &[]), Err(AlignError::TooFewPoints { got: 0 }.into()));
        let line: Vec<_> = (0..9).map(|i| Point3::new(f64::from(i), 0.0, 1.0)).collect();
        assert_eq!(solve(&line, &line), Err(AlignError::Collinear.into()));
        let mut random = Rng::new(1);
        let mut cloud = || -> Vec<_> { (0..30).map(|_| room_point(&mut random)).collect() };
        let (a, mut b) = (cloud(), cloud());
        let many = SimilarityOptions { min_inliers: 12, ..Default::default() };
        assert!(matches!(
            estimate_similarity(&a, &b, &many, 1),
            Err(SimilarityError::TooFewInliers { total: 30, needed: 12, .. })
        ));
        b[3].x = f64::NAN;
        assert_eq!(solve(&a, &b), Err(AlignError::NotFinite.into()));
    }
}
