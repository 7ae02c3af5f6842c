//! The pose of an image by features and PnP, or the reason why there is none.

use nalgebra::{Isometry3, Matrix6, Point3};
use volery_features::{PackedDescriptors, SiftOptions, detect_and_describe, global_descriptor};
use volery_geometry::Camera;
use volery_scene::{Features, GrayImage};

use crate::correspondences::{ImageMatches, match_images, pool, rank_images, sort_by_matches};
use crate::solve::PoseSolver;
use crate::{Correspondence, LocalizationIndex};

/// What is known before.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LocalizationPrior {
    /// Position in the map with its sigma, meters.
    pub position: Option<(Point3<f64>, f64)>,
    /// Yaw in the map (rotation about +z of the camera's forward axis from map x), with sigma,
    /// radians.
    pub yaw: Option<(f64, f64)>,
}

/// Options of [`localize`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalizeOptions {
    /// Most features taken from the image.
    pub max_features: usize,
    /// Map images compared in detail.
    pub num_retrieved: usize,
    /// Seed of the random choices.
    pub seed: u64,
    /// What the covariance speaks of.
    pub error_against: Reference,
}

/// What an error of a pose is measured against.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Reference {
    /// The true place: what the map is off counts.
    #[default]
    Truth,
    /// The map as it is, for images that are to be refined together with it.
    Map,
}

impl Default for LocalizeOptions {
    fn default() -> Self {
        Self { max_features: 2000, num_retrieved: 10, seed: 0, error_against: Reference::Truth }
    }
}

/// Milliseconds per step; the caller measures decoding.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StepTimings {
    /// SIFT.
    pub features_ms: f64,
    /// Retrieval and matching.
    pub match_ms: f64,
    /// RANSAC and refinement.
    pub solve_ms: f64,
}

/// A pose with its proof.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseEstimate {
    /// Camera in the map.
    pub map_from_camera: Isometry3<f64>,
    /// Order: position x, y, z in the map (m), then rotation about map x, y, z (rad).
    pub covariance: Matrix6<f64>,
    /// Inliers of the pose.
    pub num_inliers: usize,
    /// 2D–3D correspondences that they are of: more than were matched at first, where points of the
    /// map were looked for once a pose was known.
    pub num_correspondences: usize,
    /// Root mean square reprojection error, pixels.
    pub reprojection_px: f64,
    /// The inliers, if they are features that see points of the map.
    pub sightings: Vec<Correspondence>,
}

impl PoseEstimate {
    /// Inliers over correspondences.
    pub fn inlier_ratio(&self) -> f64 {
        self.num_inliers as f64 / self.num_correspondences.max(1) as f64
    }
}

/// Why an image was not found. The names are stable codes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NotFoundReason {
    /// Too few features in the image.
    TooFewFeatures,
    /// Too few matches to the map.
    TooFewMatches,
    /// No pose has enough support.
    TooFewInliers,
    /// The support is bunched in a small part of the image.
    PoorSpread,
    /// The pose's covariance is too large.
    Uncertain,
    /// No position and yaw to start from.
    NoPrior,
    /// The photo is too small to be compared, or not of the camera's size.
    TooSmall,
    /// The photo is too blurred to be compared.
    Blurred,
    /// From the given place too little of the map is in view.
    NothingInView,
    /// No view of the map looks like the photo.
    NotAlike,
    /// What looks like the photo lies too far from the given place.
    FarFromPrior,
}

impl NotFoundReason {
    /// The stable code.
    pub fn code(self) -> &'static str {
        match self {
            Self::TooFewFeatures => "too_few_features",
            Self::TooFewMatches => "too_few_matches",
            Self::TooFewInliers => "too_few_inliers",
            Self::PoorSpread => "poor_spread",
            Self::Uncertain => "uncertain",
            Self::NoPrior => "no_prior",
            Self::TooSmall => "too_small",
            Self::Blurred => "blurred",
            Self::NothingInView => "nothing_in_view",
            Self::NotAlike => "not_alike",
            Self::FarFromPrior => "far_from_prior",
        }
    }
}

/// Whether there is a pose.
#[derive(Debug, Clone, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "one per request, and `Ok` is the usual one")]
pub enum Status {
    /// One pose stands out.
    Ok(PoseEstimate),
    /// Several poses are about as good; best first.
    Ambiguous(Vec<PoseEstimate>),
    /// None.
    NotFound(NotFoundReason),
}

/// The answer to one image.
#[derive(Debug, Clone, PartialEq)]
pub struct LocalizationAnswer {
    /// Whether there is a pose.
    pub status: Status,
    /// Features in the image.
    pub num_features: usize,
    /// 2D–3D correspondences by matching.
    pub num_correspondences: usize,
}

/// Fewest features of an image that is worth matching.
const MIN_FEATURES: usize = 30;
/// Map descriptors that are compared before a first pose is tried; small maps are compared whole.
const FIRST_DESCRIPTORS: usize = 30_000;
/// Map descriptors that are compared at most.
const MAX_DESCRIPTORS: usize = 150_000;
/// Best matched map images whose matches are pooled.
const NUM_POOLED: usize = 12;

/// The pose of `image` in the map of `index` (P60, P61). Deterministic. `clock` gives seconds
/// from any start, for the timings.
///
/// Features are matched to those of the most similar map images, image by image; P3P in LO-RANSAC
/// over the pooled matches gives a pose; the map points that it brings into view are looked for
/// where they should appear, and the pose is refined over all that are found. It is believed only
/// if its support is large, spread, a fair part of what should be seen, and certain, and if no
/// other pose has comparable support.
pub fn localize(
    image: &GrayImage,
    camera: &Camera,
    index: &LocalizationIndex,
    prior: &LocalizationPrior,
    options: &LocalizeOptions,
    clock: &dyn Fn() -> f64,
) -> (LocalizationAnswer, StepTimings) {
    let start = clock();
    let sift = SiftOptions { max_features: options.max_features, ..SiftOptions::default() };
    let features = detect_and_describe(image, &sift);
    let extracted = clock();
    let mut timings =
        StepTimings { features_ms: (extracted - start) * 1e3, ..StepTimings::default() };
    let answer = localize_features(&features, camera, index, prior, options, clock, &mut timings);
    (answer, timings)
}

/// As [`localize`], for features that are at hand; adds to `timings`.
pub fn localize_features(
    features: &Features,
    camera: &Camera,
    index: &LocalizationIndex,
    prior: &LocalizationPrior,
    options: &LocalizeOptions,
    clock: &dyn Fn() -> f64,
    timings: &mut StepTimings,
) -> LocalizationAnswer {
    let mut answer = LocalizationAnswer {
        status: Status::NotFound(NotFoundReason::TooFewFeatures),
        num_features: features.len(),
        num_correspondences: 0,
    };
    if features.len() < MIN_FEATURES {
        return answer;
    }
    let started = clock();
    let packed = PackedDescriptors::new(&features.descriptors);
    let ranked = rank_images(index, &global_descriptor(features), prior);
    let solver = PoseSolver::new(index, features, camera, options);
    timings.match_ms += (clock() - started) * 1e3;

    answer.status = Status::NotFound(NotFoundReason::TooFewMatches);
    let mut matches: Vec<ImageMatches> = Vec::new();
    let budgets = [(options.num_retrieved, FIRST_DESCRIPTORS), (usize::MAX, MAX_DESCRIPTORS)];
    for (min_images, max_descriptors) in budgets {
        let next = next_images(index, &ranked, matches.len(), min_images, max_descriptors);
        if next.is_empty() {
            break;
        }
        let started = clock();
        matches.extend(match_images(&packed, index, next));
        sort_by_matches(&mut matches);
        let pairs = pool(matches.iter().take(NUM_POOLED));
        let matched = clock();
        answer.num_correspondences = pairs.len();
        answer.status = solver.solve(&pairs, prior);
        timings.match_ms += (matched - started) * 1e3;
        timings.solve_ms += (clock() - matched) * 1e3;
        if !matches!(answer.status, Status::NotFound(_)) {
            break;
        }
    }
    answer
}

/// The images to compare after the first `num_done` of `ranked`: at least up to `min_images`, then
/// as many as keep the total of descriptors within `max_descriptors`.
fn next_images<'a>(
    index: &LocalizationIndex,
    ranked: &'a [u32],
    num_done: usize,
    min_images: usize,
    max_descriptors: usize,
) -> &'a [u32] {
    let mut total = 0;
    let end = ranked.iter().enumerate().position(|(rank, &image)| {
        total += index.images[image as usize].descriptors.len();
        total > max_descriptors && (min_images == usize::MAX || rank >= min_images)
    });
    let end = end.unwrap_or(ranked.len());
    &ranked[num_done.min(end)..end]
}
