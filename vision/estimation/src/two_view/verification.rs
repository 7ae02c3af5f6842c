//! Searches the models of a pair and chooses among them.

use nalgebra::{Isometry3, Matrix3, Point2, Translation3, UnitQuaternion, Vector3};
use volery_geometry::Camera;
use volery_geometry::epipolar::poses_from_essential;
use volery_geometry::homography::poses_from_homography;
use volery_scene::{FeatureMatch, ImageId, TwoViewGeometry, TwoViewKind};

use super::TwoViewOptions;
use super::correspondences::{
    Correspondences, Pair, epipolar_error, homography_error, pixel_from_scaled, undistort,
};
use super::estimators::{
    EssentialEstimator, FundamentalEstimator, HomographyEstimator, ParallaxEstimator,
    RotationEstimator,
};
use super::refinement::{
    Effort, refine_fundamental, refine_homography, refine_pose, refine_rotation, scaled_essential,
};
use super::selection::{Noise, Slack, is_explained};
use crate::ransac::least_squares::Loss;
use crate::ransac::{Estimator, Hypotheses, Random, RansacOptions, lo_ransac, num_samples};
use crate::solvers::rotation_from_bearings;

const FAILURE_PROBABILITY: f64 = 1e-3;
const MIN_ITERATIONS: usize = 20;
/// Samples spent on a pair without a good hypothesis. A pair of few matches is most often not a
/// pair at all.
const MAX_ITERATIONS: usize = 2000;
const MAX_ITERATIONS_OF_FEW: usize = 600;
const FEW_MATCHES: usize = 100;
/// Inlier ratios below this are not searched for.
const MIN_INLIER_RATIO: f64 = 0.2;
/// Inliers that wrong matches give by chance must be outnumbered by this factor.
const CHANCE_FACTOR: f64 = 2.0;
/// Cauchy's 95 % efficiency under normal noise.
const CAUCHY_TUNING: f64 = 2.385;
const MIN_SIGMA_PX: f64 = 0.2;

pub(super) struct Verification<'a> {
    camera1: &'a Camera,
    camera2: &'a Camera,
    /// The matches of `data`, in the same order.
    matches: Vec<FeatureMatch>,
    data: Correspondences,
    num_putative: usize,
    min_inliers: usize,
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
        if !(options.max_error_px > 0.0) || matches.len() < min_inliers {
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
        let mut random = Random::new(seed);
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

    /// F alone, with the homography where it has support.
    pub(super) fn uncalibrated(&self, seed: u64) -> Option<TwoViewGeometry> {
        let mut random = Random::new(seed);
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

    fn ransac_options(&self, sample_size: usize) -> RansacOptions {
        let least_ratio = (self.min_inliers as f64 / self.data.len() as f64).max(MIN_INLIER_RATIO);
        let bound =
            if self.data.len() < FEW_MATCHES { MAX_ITERATIONS_OF_FEW } else { MAX_ITERATIONS };
        RansacOptions {
            failure_probability: FAILURE_PROBABILITY,
            min_iterations: MIN_ITERATIONS,
            max_iterations: num_samples(FAILURE_PROBABILITY, least_ratio, sample_size).min(bound),
        }
    }

    fn search_rotation(&self, random: &mut Random) -> Option<UnitQuaternion<f64>> {
        let found =
            lo_ransac(&RotationEstimator(&self.data), &[], &self.ransac_options(2), random)?;
        (found.score.num_inliers >= self.min_inliers).then_some(found.model)
    }

    /// F where one plane holds most points: seven of its points leave F open, and almost every
    /// sample is from it. The plane's H and two points off it close F.
    ///
    /// Source: Chum, Werner & Matas, "Two-View Geometry Estimation Unaffected by a Dominant
    /// Plane", CVPR 2005.
    fn search_plane_and_parallax(
        &self,
        random: &mut Random,
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
    fn search_homography(
        &self,
        support: &Correspondences,
        random: &mut Random,
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
    fn essential_near_rotation(&self, turn: &UnitQuaternion<f64>) -> Option<Matrix3<f64>> {
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

    fn errors(&self, squared_error: impl Fn(&Pair) -> f64) -> Vec<f64> {
        self.data.pairs.iter().map(squared_error).collect()
    }

    /// Wrong matches expected within the threshold, from the density of matches just outside it.
    fn num_by_chance(&self, errors: &[f64]) -> f64 {
        const BAND: f64 = 5.0;
        let t2 = self.data.squared_threshold;
        let outside = errors.iter().filter(|e| (t2..BAND * BAND * t2).contains(*e)).count();
        outside as f64 / (BAND - 1.0)
    }

    fn check_support(&self, num_inliers: usize, num_by_chance: f64) -> Option<()> {
        let needed = self.min_inliers as f64 + CHANCE_FACTOR * num_by_chance;
        (num_inliers as f64 >= needed).then_some(())
    }

    /// A loss that follows the noise of the inliers.
    fn noise_loss(&self, errors: &[f64]) -> Loss {
        Loss::Cauchy {
            squared_scale: (CAUCHY_TUNING * self.sigma(errors)).powi(2),
            squared_threshold: self.data.squared_threshold,
        }
    }

    /// Standard deviation of the inliers by the median of their squared errors, pixels.
    fn sigma(&self, errors: &[f64]) -> f64 {
        let t2 = self.data.squared_threshold;
        let mut inliers: Vec<f64> = errors.iter().copied().filter(|&e| e < t2).collect();
        if inliers.is_empty() {
            return MIN_SIGMA_PX;
        }
        let middle = inliers.len() / 2;
        let (_, median, _) = inliers.select_nth_unstable_by(middle, f64::total_cmp);
        (1.4826 * median.sqrt()).max(MIN_SIGMA_PX)
    }

    /// Squared Sampson error, infinite for a point that is clearly behind a camera.
    fn error_in_front(&self, pose: &Isometry3<f64>, f: &Matrix3<f64>, pair: &Pair) -> f64 {
        let limit = self.data.squared_threshold.sqrt() / self.data.focal2;
        let (front, parallax) = depth_signs(pose, &pair.bearing1, &pair.bearing2);
        if front || parallax < limit { epipolar_error(f, pair) } else { f64::INFINITY }
    }

    /// A second search over the support, at a threshold that follows the noise, where one plane
    /// holds much of it: two motions explain the plane, the cost has more than one valley, and
    /// samples are too noisy to beat a refined hypothesis. So the best of each batch of samples
    /// is refined, whatever its rank.
    fn sharpen(
        &self,
        support: &Correspondences,
        e: &Matrix3<f64>,
        homography: Option<&Matrix3<f64>>,
        sigma: f64,
        random: &mut Random,
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

    /// Of the four poses of E the one that has the points in front of both cameras (P24). A point
    /// counts by its parallax, up to the threshold: far points vote at random.
    fn choose_pose(&self, support: &Correspondences, e: &Matrix3<f64>) -> Option<Isometry3<f64>> {
        poses_from_essential(e)?
            .into_iter()
            .map(|pose| (self.votes_in_front(support, &pose), pose))
            .max_by(|(a, _), (b, _)| a.total_cmp(b))
            .map(|(_, pose)| pose)
    }

    fn votes_in_front(&self, support: &Correspondences, pose: &Isometry3<f64>) -> f64 {
        let limit = self.data.squared_threshold.sqrt() / self.data.focal2;
        support
            .pairs
            .iter()
            .map(|pair| {
                let (front, parallax) = depth_signs(pose, &pair.bearing1, &pair.bearing2);
                if front { parallax.min(limit) } else { 0.0 }
            })
            .sum()
    }

    fn rotation_only(
        &self,
        turn: UnitQuaternion<f64>,
        h: &Matrix3<f64>,
    ) -> Option<TwoViewGeometry> {
        let errors = self.errors(|pair| homography_error(h, pair));
        let inliers = self.inliers(&errors);
        let pose = Isometry3::from_parts(Translation3::identity(), turn);
        self.geometry(TwoViewKind::RotationOnly, Some(pose), None, Some(h), &inliers, &turn)
    }

    /// The best of the pose from E and the motions behind H, each refined.
    ///
    /// Where one plane holds most points, two motions explain it equally well and only the few
    /// points off the plane tell them apart; a search over E ends at either.
    fn best_refined(
        &self,
        support: &Correspondences,
        from_e: Isometry3<f64>,
        homography: Option<&Matrix3<f64>>,
        loss: Loss,
    ) -> Isometry3<f64> {
        let data = &self.data;
        let motions =
            homography.and_then(|h| poses_from_homography(&data.normalized_homography(h)));
        let seen = |normal: &Vector3<f64>| {
            let count = |p: &&Pair| normal.dot(&p.bearing1) > 0.0;
            support.pairs.iter().filter(count).count() * 2 > support.len()
        };
        let from_h = motions.iter().flatten().filter(|m| seen(&m.normal_in_cam1)).filter_map(|m| {
            let t = m.cam2_from_cam1.translation.vector.try_normalize(1e-9)?;
            Some(Isometry3::from_parts(t.into(), m.cam2_from_cam1.rotation))
        });
        let mut best = (f64::INFINITY, from_e);
        for start in std::iter::once(from_e).chain(from_h) {
            let pose = refine_pose(data, &start, loss, Effort::FINAL);
            let f = scaled_essential(data, &pose);
            let cost: f64 = data
                .pairs
                .iter()
                .map(|pair| loss.evaluate(self.error_in_front(&pose, &f, pair)).0)
                .sum();
            if cost < best.0 {
                best = (cost, pose);
            }
        }
        best.1
    }

    fn with_pose(
        &self,
        kind: TwoViewKind,
        pose: Isometry3<f64>,
        homography: Option<&Matrix3<f64>>,
    ) -> Option<TwoViewGeometry> {
        let f = scaled_essential(&self.data, &pose);
        let errors = self.errors(|pair| self.error_in_front(&pose, &f, pair));
        let inliers = self.inliers(&errors);
        self.geometry(kind, Some(pose), Some(f), homography, &inliers, &pose.rotation)
    }

    /// Indices within the threshold, the best first, one per feature.
    fn inliers(&self, errors: &[f64]) -> Vec<usize> {
        let mut order: Vec<usize> = indices_below(errors, self.data.squared_threshold).collect();
        order.sort_by(|&a, &b| {
            errors[a].total_cmp(&errors[b]).then(self.matches[a].cmp(&self.matches[b]))
        });
        let largest = |f: fn(&FeatureMatch) -> u32| {
            self.matches.iter().map(|m| f(m) as usize + 1).max().unwrap_or(0)
        };
        let mut used1 = vec![false; largest(|m| m.feature1)];
        let mut used2 = vec![false; largest(|m| m.feature2)];
        order.retain(|&i| {
            let m = self.matches[i];
            let (one, two) = (&mut used1[m.feature1 as usize], &mut used2[m.feature2 as usize]);
            let free = !*one && !*two;
            if free {
                (*one, *two) = (true, true);
            }
            free
        });
        order
    }

    fn geometry(
        &self,
        kind: TwoViewKind,
        cam2_from_cam1: Option<Isometry3<f64>>,
        scaled_fundamental: Option<Matrix3<f64>>,
        scaled_homography: Option<&Matrix3<f64>>,
        inliers: &[usize],
        turn: &UnitQuaternion<f64>,
    ) -> Option<TwoViewGeometry> {
        if inliers.len() < self.min_inliers {
            return None;
        }
        let mut parallax: Vec<f64> = inliers
            .iter()
            .map(|&i| {
                let pair = &self.data.pairs[i];
                (turn * pair.bearing1).cross(&pair.bearing2).norm().min(1.0).asin()
            })
            .collect();
        let middle = parallax.len() / 2;
        let (_, median_parallax, _) = parallax.select_nth_unstable_by(middle, f64::total_cmp);
        let k1 = pixel_from_scaled(self.camera1).try_inverse()?;
        let k2 = pixel_from_scaled(self.camera2);
        let k2_inv_t = k2.try_inverse()?.transpose();
        let unit = |m: Matrix3<f64>| m / m.norm();
        let mut matches: Vec<FeatureMatch> = inliers.iter().map(|&i| self.matches[i]).collect();
        matches.sort_unstable();
        Some(TwoViewGeometry {
            image1: ImageId(0),
            image2: ImageId(0),
            kind,
            matches,
            num_putative: self.num_putative,
            cam2_from_cam1,
            fundamental: scaled_fundamental.map(|f| unit(k2_inv_t * f * k1)),
            homography: scaled_homography.map(|h| unit(k2 * h * k1)),
            median_parallax: *median_parallax,
        })
    }
}

/// Whether the rays meet in front of both cameras, and the sine of their angle once the rotation
/// is taken out.
fn depth_signs(
    pose: &Isometry3<f64>,
    bearing1: &Vector3<f64>,
    bearing2: &Vector3<f64>,
) -> (bool, f64) {
    // λ₂ q = λ₁ p + t; the cross products by q and p leave one depth each.
    let (p, q) = (pose.rotation * bearing1, bearing2);
    let t = pose.translation.vector;
    let normal = p.cross(q);
    let depth1 = q.cross(&t).dot(&normal);
    let depth2 = p.cross(&t).dot(&normal);
    (depth1 > 0.0 && depth2 > 0.0, normal.norm())
}

fn indices_below(errors: &[f64], limit: f64) -> impl Iterator<Item = usize> {
    errors.iter().enumerate().filter(move |(_, e)| **e < limit).map(|(i, _)| i)
}

/// Whether most points lie on a plane that camera 2 sees from behind: surfaces are opaque, so
/// this is a mirror image or a coincidence.
fn is_mirrored(support: &Correspondences, h: &Matrix3<f64>) -> bool {
    let determinant = h.determinant();
    let flipped = support
        .pairs
        .iter()
        .filter(|pair| homography_error(h, pair) < support.squared_threshold)
        .filter(|pair| determinant * (h * pair.x1).z < 0.0)
        .count();
    2 * flipped > support.len()
}
