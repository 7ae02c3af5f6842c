//! Chooses among the models of a pair.

use nalgebra::{Matrix3, Point2};
use volery_geometry::{Camera, Rng, median};
use volery_scene::{FeatureMatch, TwoViewGeometry, TwoViewKind};

use super::TwoViewOptions;
use super::correspondences::{
    Correspondences, Pair, epipolar_error, homography_error, indices_below, undistort,
};
use super::estimators::{EssentialEstimator, FundamentalEstimator};
use super::poses::is_mirrored;
use super::refinement::{Effort, refine_fundamental, refine_rotation, scaled_essential};
use super::selection::{Noise, Slack, is_explained};
use crate::ransac::least_squares::Loss;
use crate::ransac::lo_ransac;
use crate::solvers::rotation_from_bearings;

/// Inliers that wrong matches give by chance must be outnumbered by this factor.
const CHANCE_FACTOR: f64 = 2.0;
/// Cauchy's 95 % efficiency under normal noise.
const CAUCHY_TUNING: f64 = 2.385;
const MIN_SIGMA_PX: f64 = 0.2;

/// The matches of a pair on the way to their geometry.
pub(super) struct Verification<'a> {
    pub(super) camera1: &'a Camera,
    pub(super) camera2: &'a Camera,
    /// The matches of `data`, in the same order.
    pub(super) matches: Vec<FeatureMatch>,
    pub(super) data: Correspondences,
    pub(super) num_putative: usize,
    pub(super) min_inliers: usize,
}

impl<'a> Verification<'a> {
    /// `None` if there are fewer usable matches than inliers needed.
    pub(super) fn new(
        (camera1, pixels1): (&'a Camera, &[Point2<f64>]),
        (camera2, pixels2): (&'a Camera, &[Point2<f64>]),
        matches: &[FeatureMatch],
        options: &TwoViewOptions,
    ) -> Option<Self> {
        // The five- and seven-point solvers explain their own samples.
        let min_inliers = options.min_inliers.max(8);
        let usable_threshold = options.max_error_px > 0.0;
        if !usable_threshold || matches.len() < min_inliers {
            return None;
        }
        let num_putative = matches.len();
        let (matches, normalized): (Vec<_>, Vec<_>) = matches
            .iter()
            .filter_map(|m| {
                let n1 = undistort(camera1, pixels1, m.feature1)?;
                let n2 = undistort(camera2, pixels2, m.feature2)?;
                Some((*m, (n1, n2)))
            })
            .unzip();
        if matches.len() < min_inliers {
            return None;
        }
        let (focal1, focal2) = (camera1.mean_focal(), camera2.mean_focal());
        let data =
            Correspondences::new(normalized.into_iter(), focal1, focal2, options.max_error_px);
        Some(Self { camera1, camera2, matches, data, num_putative, min_inliers })
    }

    /// E, H and R compete.
    pub(super) fn calibrated(&self, seed: u64) -> Option<TwoViewGeometry> {
        let mut random = Rng::new(seed);
        let data = &self.data;
        let turn = self.search_rotation(&mut random);
        let start: Vec<Matrix3<f64>> =
            turn.iter().filter_map(|q| self.essential_near_rotation(q)).collect();
        let found =
            lo_ransac(&EssentialEstimator(data), &start, &self.ransac_options(5), &mut random)?;
        let e = data.scaled_epipolar(&found.model);
        let errors = self.errors(|pair| epipolar_error(&e, pair));
        let num_by_chance = self.num_by_chance(&errors);
        self.check_support(found.score.num_inliers, num_by_chance)?;

        // Everything below is decided over what E explains; H and R are its special cases.
        let support = data.subset(indices_below(&errors, data.squared_threshold));
        let loss = self.noise_loss(&errors);
        let homography = self.search_homography(&support, &mut random, loss);
        if homography.as_ref().is_some_and(|h| is_mirrored(&support, h)) {
            return None;
        }
        let sigma = self.sigma(&errors);
        let sharpened =
            self.sharpen(&support, &found.model, homography.as_ref(), sigma, &mut random);
        let pose = self.choose_pose(&support, &sharpened)?;
        let pose = self.best_refined(&support, pose, homography.as_ref(), loss);
        let refined_e = scaled_essential(data, &pose);
        let errors = self.errors(|pair| self.error_in_front(&pose, &refined_e, pair));
        let support = data.subset(indices_below(&errors, data.squared_threshold));
        self.check_support(support.len(), num_by_chance)?;
        let on_e: Vec<f64> = support.pairs.iter().map(|p| epipolar_error(&refined_e, p)).collect();
        let noise = Noise {
            sigma: self.sigma(&errors),
            squared_threshold: data.squared_threshold,
            num_by_chance,
        };
        let explained = |h: &Matrix3<f64>, slack: &Slack| {
            let on_h: Vec<f64> = support.pairs.iter().map(|p| homography_error(h, p)).collect();
            is_explained(&on_e, &on_h, &noise, slack)
        };

        if let Some(turn) = turn {
            let turn = refine_rotation(data, &turn, loss, Effort::FINAL);
            let h = data.scaled_homography(&turn.to_rotation_matrix().into_inner());
            if explained(&h, &Slack::ROTATION) {
                return self.rotation_only(turn, &h);
            }
        }
        if let Some(h) = &homography
            && explained(h, &Slack::HOMOGRAPHY)
        {
            return self.with_pose(TwoViewKind::Planar, pose, Some(h));
        }
        let homography = homography
            .filter(|h| data.score_homography(h, f64::INFINITY).num_inliers >= self.min_inliers);
        self.with_pose(TwoViewKind::General, pose, homography.as_ref())
    }

    /// F, with the homography where it has support; where a turn explains all, that alone.
    pub(super) fn uncalibrated(&self, seed: u64) -> Option<TwoViewGeometry> {
        let mut random = Rng::new(seed);
        let data = &self.data;
        let options = self.ransac_options(7);
        let start = self.search_plane_and_parallax(&mut random, &options);
        let start = start.as_slice();
        let found = lo_ransac(&FundamentalEstimator(data), start, &options, &mut random)?;
        let errors = self.errors(|pair| epipolar_error(&found.model, pair));
        self.check_support(found.score.num_inliers, self.num_by_chance(&errors))?;
        let loss = self.noise_loss(&errors);
        let f = refine_fundamental(data, &found.model, loss, Effort::FINAL)?;
        let errors = self.errors(|pair| epipolar_error(&f, pair));
        let inliers = self.inliers(&errors);
        let support = data.subset(inliers.iter().copied());
        let homography = self
            .search_homography(&support, &mut random, loss)
            .filter(|h| data.score_homography(h, f64::INFINITY).num_inliers >= self.min_inliers);
        let noise = Noise {
            sigma: self.sigma(&errors),
            squared_threshold: data.squared_threshold,
            num_by_chance: self.num_by_chance(&errors),
        };
        let on_f: Vec<f64> = support.pairs.iter().map(|p| epipolar_error(&f, p)).collect();
        let on = |h: &Matrix3<f64>| -> Vec<f64> {
            support.pairs.iter().map(|p| homography_error(h, p)).collect()
        };
        let is_turn = |h: &Matrix3<f64>| is_explained(&on_f, &on(h), &noise, &Slack::ROTATION);
        // A turn has a homography, which is at hand; what that leaves out would pull at the turn.
        let on_plane = |h| support.subset(indices_below(&on(h), data.squared_threshold));
        if let Some(h) = &homography
            && is_turn(h)
            && let Some(turn) = self.best_turn(&on_plane(h))
            && is_turn(&turn.homography)
        {
            return self.turn_of_unknown_angle(&turn);
        }
        let turn =
            rotation_from_bearings(support.pairs.iter().map(|p| (p.bearing1, p.bearing2, 1.0)))?;
        self.geometry(
            TwoViewKind::Uncalibrated,
            None,
            Some(f),
            homography.as_ref(),
            &inliers,
            &turn,
        )
    }

    pub(super) fn errors(&self, squared_error: impl Fn(&Pair) -> f64) -> Vec<f64> {
        self.data.pairs.iter().map(squared_error).collect()
    }

    /// Wrong matches expected within the threshold, from the density of matches just outside it.
    pub(super) fn num_by_chance(&self, errors: &[f64]) -> f64 {
        const BAND: f64 = 5.0;
        let t2 = self.data.squared_threshold;
        let outside = errors.iter().filter(|e| (t2..BAND * BAND * t2).contains(*e)).count();
        outside as f64 / (BAND - 1.0)
    }

    pub(super) fn check_support(&self, num_inliers: usize, num_by_chance: f64) -> Option<()> {
        let needed = self.min_inliers as f64 + CHANCE_FACTOR * num_by_chance;
        (num_inliers as f64 >= needed).then_some(())
    }

    /// A loss that follows the noise of the inliers.
    pub(super) fn noise_loss(&self, errors: &[f64]) -> Loss {
        Loss::Cauchy {
            squared_scale: (CAUCHY_TUNING * self.sigma(errors)).powi(2),
            squared_threshold: self.data.squared_threshold,
        }
    }

    /// Standard deviation of the inliers by the median of their squared errors, pixels.
    pub(super) fn sigma(&self, errors: &[f64]) -> f64 {
        let t2 = self.data.squared_threshold;
        let mut inliers: Vec<f64> = errors.iter().copied().filter(|&e| e < t2).collect();
        median(&mut inliers).map_or(MIN_SIGMA_PX, |m| (1.4826 * m.sqrt()).max(MIN_SIGMA_PX))
    }
}
