//! From pairs of keypoints and points to a pose that is believed.

use nalgebra::{Isometry3, Matrix6, Point2, Point3};
use volery_estimation::absolute_pose::{RefinedPose, refine_absolute_pose};
use volery_estimation::{AbsolutePoseOptions, estimate_absolute_pose};
use volery_geometry::{Camera, median};
use volery_scene::{Features, Keypoint};

use crate::LocalizationIndex;
use crate::acceptance::{
    Evidence, MIN_CONFIRMED, MIN_CONFIRMED_NEAR, MIN_INLIERS, covariance_in_map, judge,
};
use crate::correspondences::Pair;
use crate::guided::{KeypointGrid, match_projected};
use crate::localize::{
    LocalizationPrior, LocalizeOptions, NotFoundReason, PoseEstimate, Reference, Status,
};
use crate::map_share::map_share;
use crate::refine::{Sight, refine_weighted};

/// Inlier threshold of the first pose, of an image 640 pixels wide.
const MAX_ERROR_PX: f64 = 6.0;
/// Radii of the windows in which projected points are looked for, and inlier thresholds of the
/// refinements that follow, of an image 640 pixels wide.
const GUIDED_RADII_PX: [f64; 2] = [10.0, 4.0];
/// Fewest inliers of a first pose: enough to say where to look for more.
const MIN_FIRST_INLIERS: usize = 8;
const MAX_ITERATIONS: usize = 20_000;
/// A rival with this part of the best pose's support makes the answer ambiguous.
const RIVAL_SUPPORT: f64 = 0.7;
/// A believed pose with less than this part of a doubted one's support is not believed.
const MIN_SUPPORT: f64 = 0.8;
/// Poses tried per set of pairs.
const MAX_CANDIDATES: usize = 3;
/// Hypotheses drawn in search of another pose.
const MAX_RIVAL_ITERATIONS: usize = 2_000;
/// Poses are the same place within this part of the median depth, and this angle.
const SAME_PLACE: f64 = 0.1;
const SAME_ROTATION_DEG: f64 = 5.0;

pub(crate) struct PoseSolver<'a> {
    index: &'a LocalizationIndex,
    features: &'a Features,
    camera: &'a Camera,
    grid: KeypointGrid,
    /// Thresholds are for images 640 pixels wide; larger images get larger ones.
    pixel_scale: f64,
    seed: u64,
    error_against: Reference,
}

/// A pose with all that speaks for it.
struct Candidate {
    cam_from_world: Isometry3<f64>,
    /// Pairs that agree with it.
    inliers: Vec<Pair>,
    median_depth: f64,
    estimate: PoseEstimate,
    verdict: Result<(), NotFoundReason>,
}

impl<'a> PoseSolver<'a> {
    pub(crate) fn new(
        index: &'a LocalizationIndex,
        features: &'a Features,
        camera: &'a Camera,
        options: &LocalizeOptions,
    ) -> Self {
        let grid = KeypointGrid::new(features, camera);
        let pixel_scale = (f64::from(camera.width.max(camera.height)) / 640.0).max(1.0);
        let LocalizeOptions { seed, error_against, .. } = *options;
        Self { index, features, camera, grid, pixel_scale, seed, error_against }
    }

    /// The pose that `pairs` speak for.
    pub(crate) fn solve(&self, pairs: &[Pair], prior: &LocalizationPrior) -> Status {
        if pairs.len() < MIN_FIRST_INLIERS {
            return Status::NotFound(NotFoundReason::TooFewMatches);
        }
        let found = self.candidates(pairs);
        let reason = match found.first() {
            None => return Status::NotFound(NotFoundReason::TooFewInliers),
            Some(first) => first.verdict.err(),
        };
        let most_support = found.iter().map(|c| c.inliers.len()).max().unwrap_or(0);
        let (mut believed, doubted): (Vec<_>, Vec<_>) =
            found.into_iter().partition(|candidate| candidate.verdict.is_ok());
        believed.sort_by_key(|candidate| std::cmp::Reverse(candidate.inliers.len()));
        let Some(best) = believed.first() else {
            return Status::NotFound(reason.unwrap_or(NotFoundReason::TooFewInliers));
        };
        let is_outdone = (best.inliers.len() as f64) < MIN_SUPPORT * most_support as f64;
        if let (true, Some(doubt)) = (is_outdone, doubted.first()) {
            let reason = doubt.verdict.err();
            return Status::NotFound(reason.unwrap_or(NotFoundReason::TooFewInliers));
        }
        let others = believed[1..].iter().filter(|other| rivals(best, other));
        let mut poses = vec![best.estimate.clone()];
        poses.extend(others.map(|other| other.estimate.clone()));
        if poses.len() > 1 || contradicts(&poses[0], prior) {
            return Status::Ambiguous(poses);
        }
        Status::Ok(poses.swap_remove(0))
    }

    /// Poses that explain parts of `pairs`, each what the ones before it leave over: until one is
    /// believed and a rival of it was looked for.
    fn candidates(&self, pairs: &[Pair]) -> Vec<Candidate> {
        let (mut found, mut left) = (Vec::<Candidate>::new(), pairs.to_vec());
        for round in 0..MAX_CANDIDATES {
            let iterations = if round == 0 { MAX_ITERATIONS } else { MAX_RIVAL_ITERATIONS };
            let had_believed = found.iter().any(|candidate| candidate.verdict.is_ok());
            let Some(next) = self.candidate(&left, MIN_FIRST_INLIERS, iterations) else { break };
            let far = 4.0 * MAX_ERROR_PX * self.pixel_scale;
            left.retain(|pair| {
                let pixel = self.camera.project(&(next.cam_from_world * self.position(pair)));
                pixel.is_none_or(|pixel| (pixel - self.pixel(pair)).norm() > far)
            });
            found.push(next);
            if had_believed {
                break;
            }
        }
        found
    }

    fn pixel(&self, pair: &Pair) -> Point2<f64> {
        self.features.keypoints[pair.keypoint as usize].pixel()
    }

    fn position(&self, pair: &Pair) -> Point3<f64> {
        self.index.points[pair.point as usize].position
    }

    /// One per place: a keypoint described twice, for two orientations, is one measurement.
    fn sights(&self, pairs: &[Pair]) -> Vec<Sight> {
        let mut places: Vec<(i64, i64)> = Vec::new();
        let mut sights = Vec::with_capacity(pairs.len());
        for pair in pairs {
            let pixel = self.pixel(pair);
            let place = ((pixel.x * 2.0).floor() as i64, (pixel.y * 2.0).floor() as i64);
            if places.contains(&place) {
                continue;
            }
            places.push(place);
            let point = &self.index.points[pair.point as usize];
            sights.push(Sight {
                pixel,
                relative_sigma: relative_sigma(&self.features.keypoints[pair.keypoint as usize]),
                point: point.position,
                point_index: pair.point,
                covariance: point.covariance.map(f64::from),
            });
        }
        sights
    }

    fn split(&self, pairs: &[Pair]) -> (Vec<Point2<f64>>, Vec<Point3<f64>>) {
        pairs.iter().map(|pair| (self.pixel(pair), self.position(pair))).unzip()
    }

    /// RANSAC, then what is near.
    fn candidate(
        &self,
        pairs: &[Pair],
        min_inliers: usize,
        max_iterations: usize,
    ) -> Option<Candidate> {
        let options = AbsolutePoseOptions {
            max_error_px: MAX_ERROR_PX * self.pixel_scale,
            min_inliers,
            max_iterations,
            ..AbsolutePoseOptions::default()
        };
        let (pixels, points) = self.split(pairs);
        let first =
            estimate_absolute_pose(&pixels, &points, self.camera, &options, self.seed).ok()?;
        self.candidate_near(&first.cam_from_world, kept(pairs, &first.inliers), MIN_CONFIRMED)
    }

    /// The pose near `pose`, whose support is near the points of `inliers`, if there is one that is
    /// believed. Nobody looks for rivals.
    pub(crate) fn solve_near(&self, pose: &Isometry3<f64>, inliers: Vec<Pair>) -> Status {
        match self.candidate_near(pose, inliers, MIN_CONFIRMED_NEAR) {
            None => Status::NotFound(NotFoundReason::TooFewInliers),
            Some(Candidate { verdict: Err(reason), .. }) => Status::NotFound(reason),
            Some(Candidate { estimate, .. }) => Status::Ok(estimate),
        }
    }

    /// Twice: looks for what the pose brings into view, refines over what is found.
    fn candidate_near(
        &self,
        pose: &Isometry3<f64>,
        mut inliers: Vec<Pair>,
        min_confirmed: f64,
    ) -> Option<Candidate> {
        let mut pose = *pose;
        let mut refined: Option<(RefinedPose, usize, usize)> = None;
        for radius in GUIDED_RADII_PX {
            let radius = radius * self.pixel_scale;
            let sighted = match_projected(
                self.index,
                self.features,
                &self.grid,
                self.camera,
                &pose,
                &inliers,
                radius,
            );
            let (pixels, points) = self.split(&sighted.pairs);
            let better = refine_absolute_pose(&pixels, &points, self.camera, &pose, radius)?;
            pose = better.cam_from_world;
            inliers = kept(&sighted.pairs, &better.inliers);
            refined = Some((better, sighted.pairs.len(), sighted.num_visible));
        }
        let (refined, num_pairs, num_visible) = refined?;
        let sights = self.sights(&inliers);
        let weighted = refine_weighted(&sights, self.camera, &pose)?;
        let pose = weighted.cam_from_world;
        let from_map = match self.error_against {
            Reference::Truth => map_share(self.index, &sights, self.camera, &weighted),
            Reference::Map => Matrix6::zeros(),
        };
        let covariance = covariance_in_map(&pose, &(weighted.covariance + from_map));
        let median_depth = self.median_depth(&pose, &inliers);
        let (pixels, _) = self.split(&inliers);
        let evidence = Evidence {
            inliers: &pixels,
            num_visible,
            min_confirmed,
            median_depth,
            covariance: &covariance,
        };
        Some(Candidate {
            cam_from_world: pose,
            median_depth,
            verdict: judge(&evidence, self.camera),
            estimate: PoseEstimate {
                map_from_camera: pose.inverse(),
                covariance,
                num_inliers: inliers.len(),
                num_correspondences: num_pairs,
                reprojection_px: refined.rms_px,
                sightings: inliers.clone(),
            },
            inliers,
        })
    }

    fn median_depth(&self, pose: &Isometry3<f64>, inliers: &[Pair]) -> f64 {
        let mut depths: Vec<f64> =
            inliers.iter().map(|pair| (pose * self.position(pair)).z).collect();
        median(&mut depths).unwrap_or(0.0)
    }
}

/// Coarse keypoints are placed less exactly.
pub(crate) fn relative_sigma(keypoint: &Keypoint) -> f64 {
    let scale = f64::from(keypoint.scale);
    (1.0 + 0.04 * scale * scale).sqrt()
}

/// Whether two believed poses are elsewhere with comparable support.
fn rivals(best: &Candidate, other: &Candidate) -> bool {
    let distance = (other.estimate.map_from_camera.translation.vector
        - best.estimate.map_from_camera.translation.vector)
        .norm();
    let angle = other.cam_from_world.rotation.angle_to(&best.cam_from_world.rotation);
    let elsewhere =
        distance > SAME_PLACE * best.median_depth || angle > SAME_ROTATION_DEG.to_radians();
    elsewhere && other.inliers.len() as f64 >= RIVAL_SUPPORT * best.inliers.len() as f64
}

fn kept(pairs: &[Pair], inliers: &[bool]) -> Vec<Pair> {
    pairs.iter().zip(inliers).filter(|(_, inlier)| **inlier).map(|(pair, _)| *pair).collect()
}

/// Standard deviations beyond which a pose contradicts what is known before.
const MAX_PRIOR_SIGMAS: f64 = 6.0;

fn contradicts(estimate: &PoseEstimate, prior: &LocalizationPrior) -> bool {
    let position = prior.position.is_some_and(|(position, sigma)| {
        let error = (Point3::from(estimate.map_from_camera.translation.vector) - position).norm();
        error > MAX_PRIOR_SIGMAS * sigma
    });
    let yaw = prior.yaw.is_some_and(|(yaw, sigma)| {
        let forward = estimate.map_from_camera.rotation * nalgebra::Vector3::z();
        // Looking up or down, a camera has no heading.
        let is_level = forward.xy().norm() > 0.3;
        let turn = forward.y.atan2(forward.x) - yaw;
        let error = turn.sin().atan2(turn.cos()).abs();
        is_level && error > MAX_PRIOR_SIGMAS * sigma
    });
    position || yaw
}

const _: () = assert!(MIN_FIRST_INLIERS < MIN_INLIERS);
