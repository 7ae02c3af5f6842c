//! Searches each model among the matches of a pair.

use nalgebra::{Matrix3, UnitQuaternion};
use volery_geometry::Rng;

use super::correspondences::{Correspondences, homography_error};
use super::estimators::{
    EssentialEstimator, HomographyEstimator, ParallaxEstimator, RotationEstimator,
};
use super::refinement::{Effort, refine_homography};
use super::verification::Verification;
use crate::ransac::least_squares::Loss;
use crate::ransac::{Estimator, Hypotheses, RansacOptions, lo_ransac, num_samples};

const FAILURE_PROBABILITY: f64 = 1e-3;
const MIN_ITERATIONS: usize = 20;
/// Samples spent on a pair without a good hypothesis. A pair of few matches is most often not a
/// pair at all.
const MAX_ITERATIONS: usize = 1500;
const MAX_ITERATIONS_OF_FEW: usize = 300;
const FEW_MATCHES: usize = 100;
/// Inlier ratios below this are not searched for.
const MIN_INLIER_RATIO: f64 = 0.2;

impl Verification<'_> {
    pub(super) fn ransac_options(&self, sample_size: usize) -> RansacOptions {
        let least_ratio = (self.min_inliers as f64 / self.data.len() as f64).max(MIN_INLIER_RATIO);
        let bound =
            if self.data.len() < FEW_MATCHES { MAX_ITERATIONS_OF_FEW } else { MAX_ITERATIONS };
        RansacOptions {
            failure_probability: FAILURE_PROBABILITY,
            min_iterations: MIN_ITERATIONS,
            max_iterations: num_samples(FAILURE_PROBABILITY, least_ratio, sample_size).min(bound),
        }
    }

    pub(super) fn search_rotation(&self, random: &mut Rng) -> Option<UnitQuaternion<f64>> {
        let found =
            lo_ransac(&RotationEstimator(&self.data), &[], &self.ransac_options(2), random)?;
        (found.score.num_inliers >= self.min_inliers).then_some(found.model)
    }

    /// F where one plane holds most points: seven of its points leave F open, and almost every
    /// sample is from it. The plane's H and two points off it close F.
    ///
    /// Source: Chum, Werner & Matas, "Two-View Geometry Estimation Unaffected by a Dominant
    /// Plane", CVPR 2005.
    pub(super) fn search_plane_and_parallax(
        &self,
        random: &mut Rng,
        options: &RansacOptions,
    ) -> Option<Matrix3<f64>> {
        let data = &self.data;
        let plane_options = self.ransac_options(4);
        let plane = lo_ransac(&HomographyEstimator(data), &[], &plane_options, random)?;
        if plane.score.num_inliers < self.min_inliers {
            return None;
        }
        let off_plane: Vec<usize> = (0..data.len())
            .filter(|&i| homography_error(&plane.model, &data.pairs[i]) > data.squared_threshold)
            .collect();
        let estimator = ParallaxEstimator { data, homography: plane.model, off_plane };
        Some(lo_ransac(&estimator, &[], options, random)?.model)
    }

    /// H over the support of E, where a planar scene puts most points on it.
    pub(super) fn search_homography(
        &self,
        support: &Correspondences,
        random: &mut Rng,
        loss: Loss,
    ) -> Option<Matrix3<f64>> {
        const MAX_PLANE_ITERATIONS: usize = 100;
        let options = RansacOptions {
            failure_probability: FAILURE_PROBABILITY,
            min_iterations: MIN_ITERATIONS,
            max_iterations: MAX_PLANE_ITERATIONS,
        };
        let found = lo_ransac(&HomographyEstimator(support), &[], &options, random)?;
        Some(refine_homography(support, &found.model, loss, Effort::FINAL))
    }

    /// The essential matrix of a known rotation: `t` is orthogonal to every `x₂ × R x₁`.
    pub(super) fn essential_near_rotation(
        &self,
        turn: &UnitQuaternion<f64>,
    ) -> Option<Matrix3<f64>> {
        let limit = 4.0 * self.data.squared_threshold.sqrt() / self.data.focal2;
        let mut scatter = Matrix3::zeros();
        for pair in &self.data.pairs {
            let normal = pair.bearing2.cross(&(turn * pair.bearing1));
            if normal.norm() < limit {
                scatter += normal * normal.transpose();
            }
        }
        let eigen = scatter.symmetric_eigen();
        let t = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
        let e = t.cross_matrix() * turn.to_rotation_matrix().into_inner();
        e.iter().all(|v| v.is_finite()).then_some(e)
    }

    /// A second search over the support, at a threshold that follows the noise, where one plane
    /// holds much of it: two motions explain the plane, the cost has more than one valley, and
    /// samples are too noisy to beat a refined hypothesis. So the best of each batch of samples
    /// is refined, whatever its rank.
    pub(super) fn sharpen(
        &self,
        support: &Correspondences,
        e: &Matrix3<f64>,
        homography: Option<&Matrix3<f64>>,
        sigma: f64,
        random: &mut Rng,
    ) -> Matrix3<f64> {
        const BATCHES: usize = 8;
        const SAMPLES: usize = 10;
        const SHARP_SIGMAS: f64 = 2.5;
        const MIN_PLANE_SHARE: f64 = 0.4;
        let squared_threshold = (SHARP_SIGMAS * sigma).powi(2).min(self.data.squared_threshold);
        let sharp = support.with_squared_threshold(squared_threshold);
        let num_on_plane =
            homography.map_or(0, |h| sharp.score_homography(h, f64::INFINITY).num_inliers);
        if (num_on_plane as f64) < MIN_PLANE_SHARE * support.len() as f64 {
            return *e;
        }
        let estimator = EssentialEstimator(&sharp);
        let refined = |e: &Matrix3<f64>| {
            let e = estimator.refine(e)?;
            Some((estimator.score(&e, f64::INFINITY).cost, e))
        };
        let mut best = refined(e);
        let mut hypotheses = Hypotheses::new();
        let mut sample = [0; 5];
        for _ in 0..BATCHES {
            let mut batch_best: Option<(f64, Matrix3<f64>)> = None;
            for _ in 0..SAMPLES {
                random.distinct(sharp.len(), &mut sample);
                hypotheses.clear();
                estimator.solve(&sample, &mut hypotheses);
                for e in &hypotheses {
                    let bound = batch_best.map_or(f64::INFINITY, |(cost, _)| cost);
                    let cost = estimator.score(e, bound).cost;
                    if cost < bound {
                        batch_best = Some((cost, *e));
                    }
                }
            }
            let candidate = batch_best.and_then(|(_, e)| refined(&e));
            if let Some((cost, _)) = candidate
                && best.is_none_or(|(least, _)| cost < least)
            {
                best = candidate;
            }
        }
        best.map_or(*e, |(_, e)| e)
    }
}
