//! Verified pairs to sparse models: the incremental and the global mapper, validated, the better
//! one kept.

use volery_estimation::IntrinsicsRefinement;
use volery_scene::{
    Cancelled, ImageId, Progress, Quality, SparseModel, TwoViewGeometry, TwoViewKind,
    UnplacedImage, UnplacedReason, Verdict,
};

use crate::global::map_globally;
use crate::incremental::{Input, extend_model, map_incrementally, triangulate_at_given_poses};
use crate::input::{MapperOptions, SfmCamera, SfmImage};
use crate::quality::calibration::{calibration_shift, focal_sigma};
use crate::quality::{Evidence, FEW_POINTS, WEAK_SUPPORT, no_map};
use crate::self_calibration::start_cameras;

/// What came of the pairs. Models are in arbitrary frames (no scale, no gravity).
#[derive(Debug, Clone, PartialEq)]
pub struct Reconstruction {
    /// Largest first; the first is the map, the others are zones. Empty if nothing could be built.
    pub models: Vec<SparseModel>,
    /// Images without a pose in `models[0]`.
    pub unplaced: Vec<UnplacedImage>,
    /// Verdict over `models[0]`.
    pub quality: Quality,
    /// `incremental`, `global` or `given`: whose model was kept.
    pub mapper: &'static str,
}

/// Why there is nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum ReconstructError {
    /// Asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// Two images are the least.
    #[error("a reconstruction needs at least 2 images, got {got}")]
    TooFewImages {
        /// What came.
        got: usize,
    },
    /// An image names a camera that is not there.
    #[error("image {image} has camera {camera}, but there are {num_cameras}")]
    UnknownCamera {
        /// Index of the image.
        image: usize,
        /// Its camera.
        camera: u32,
        /// Cameras given.
        num_cameras: usize,
    },
}

/// A set of which so large a part of the images has only turned is a yaw scan.
const YAW_SCAN_FRACTION: f64 = 0.6;
/// Inliers of a strong pair.
const MIN_STRONG_INLIERS: usize = 40;
/// Parallax, radians, below which a pair counts as turned in place.
const TINY_PARALLAX: f64 = 0.02;
/// Parallax, radians, from which a pair says where its images are.
const FAIR_PARALLAX: f64 = 0.035;
/// Cameras whose intrinsics are probed, one or two adjustments each.
const MAX_PROBED_CAMERAS: usize = 2;
/// A first model that holds so large a part of the images and passes its checks needs no rival.
const ENOUGH_IMAGES: f64 = 0.8;

/// Sparse models of the images that the verified `pairs` tie together.
///
/// A set of images that mostly turn in place goes to the global mapper first, any other set to the
/// incremental one. A model that misses many images or fails a check gets a rival from the other
/// mapper, and the better one is kept.
pub fn reconstruct(
    images: &[SfmImage],
    cameras: &[SfmCamera],
    pairs: &[TwoViewGeometry],
    options: &MapperOptions,
    progress: &dyn Progress,
) -> Result<Reconstruction, ReconstructError> {
    if images.len() < 2 {
        return Err(ReconstructError::TooFewImages { got: images.len() });
    }
    for (image, camera) in images.iter().map(|image| image.camera.0).enumerate() {
        if camera as usize >= cameras.len() {
            let num_cameras = cameras.len();
            return Err(ReconstructError::UnknownCamera { image, camera, num_cameras });
        }
    }
    let pairs = &sound_pairs(images, pairs);
    let input = Input { images, cameras, pairs, options };
    let mut kept = if options.poses_are_given {
        attempt(Mapper::Given, input, progress)?
    } else {
        better_attempt(input, progress)?
    };
    let has_turned = mostly_turned(pairs) || is_yaw_scan(images.len(), pairs);
    if kept.is_thin() && has_turned {
        // What can be made of a camera that only turned is noise and no map.
        kept.models.clear();
    }
    let unplaced = unplaced_images(input, &kept.models);
    Ok(Reconstruction {
        quality: if kept.models.is_empty() { no_map(&unplaced) } else { kept.quality },
        models: kept.models,
        unplaced,
        mapper: kept.mapper.name(),
    })
}

/// What the mapper makes that suits the pairs; if that is in doubt, the better of both mappers'.
fn better_attempt(input: Input<'_>, progress: &dyn Progress) -> Result<Attempt, ReconstructError> {
    let num_images = input.images.len();
    let order = if is_yaw_scan(num_images, input.pairs) {
        [Mapper::Global, Mapper::Incremental]
    } else {
        [Mapper::Incremental, Mapper::Global]
    };
    let first = attempt(order[0], input, progress)?;
    let satisfied = first.num_images() as f64 >= ENOUGH_IMAGES * num_images as f64
        && first.quality.verdict == Verdict::Good;
    if satisfied {
        return Ok(first);
    }
    let second = attempt(order[1], input, progress)?;
    Ok(if second.is_better_than(&first) { second } else { first })
}

/// The pairs without matches that point past the keypoints or at keypoints that are not finite.
fn sound_pairs(images: &[SfmImage], pairs: &[TwoViewGeometry]) -> Vec<TwoViewGeometry> {
    let is_sound = |image: ImageId, keypoint: u32| {
        images
            .get(image.0 as usize)
            .and_then(|image| image.keypoints.get(keypoint as usize))
            .is_some_and(|pixel| pixel.x.is_finite() && pixel.y.is_finite())
    };
    pairs
        .iter()
        .filter(|pair| pair.image1 != pair.image2)
        .map(|pair| {
            let mut pair = pair.clone();
            let (a, b) = (pair.image1, pair.image2);
            pair.matches.retain(|m| is_sound(a, m.feature1) && is_sound(b, m.feature2));
            pair
        })
        .filter(|pair| !pair.matches.is_empty())
        .collect()
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Mapper {
    Incremental,
    Global,
    /// No mapper at all.
    Given,
}

impl Mapper {
    fn name(self) -> &'static str {
        match self {
            Self::Incremental => "incremental",
            Self::Global => "global",
            Self::Given => "given",
        }
    }
}

/// The models of one mapper, judged.
struct Attempt {
    mapper: Mapper,
    models: Vec<SparseModel>,
    quality: Quality,
    /// Part of the pairs' matches that speak against the first model.
    contradiction: f64,
}

impl Attempt {
    fn num_images(&self) -> usize {
        self.models.first().map_or(0, |model| model.images.len())
    }

    /// Whether it, or most of its images, have few points.
    fn is_thin(&self) -> bool {
        let is_thin = |code: &str| matches!(code, FEW_POINTS | WEAK_SUPPORT);
        self.quality.reasons.iter().any(|reason| is_thin(&reason.code))
    }

    /// Images, less what the pairs hold against them.
    fn score(&self) -> f64 {
        self.num_images() as f64 * (1.0 - 2.0 * self.contradiction)
    }

    fn is_better_than(&self, other: &Self) -> bool {
        // A better verdict excuses a tenth of the images missing.
        let bonus = |a: &Self| if a.quality.verdict == Verdict::Good { 1.1 } else { 1.0 };
        self.score() * bonus(self) > other.score() * bonus(other)
    }
}

fn attempt(
    mapper: Mapper,
    input: Input<'_>,
    progress: &dyn Progress,
) -> Result<Attempt, ReconstructError> {
    let Input { images, cameras, pairs, options } = input;
    let start = start_cameras(images, cameras, pairs);
    let models = match mapper {
        Mapper::Incremental => {
            map_incrementally(images, cameras, &start, pairs, options, progress)?
        }
        Mapper::Global => {
            let mut models = map_globally(images, cameras, &start, pairs, options, progress)?;
            if let Some(map) = models.first_mut()
                && map.images.len() < images.len()
            {
                let extended = extend_model(input, map, progress)?;
                if extended.images.len() > map.images.len() {
                    *map = extended;
                }
            }
            models
        }
        Mapper::Given => vec![triangulate_at_given_poses(input, &start, progress)?],
    };
    let (quality, contradiction) = match models.first() {
        Some(model) => {
            let mut evidence = Evidence::of(model, pairs);
            for (&id, camera) in model.cameras.iter().take(MAX_PROBED_CAMERAS) {
                let given = cameras[id.0 as usize];
                if given.refine == IntrinsicsRefinement::FIXED
                    && let Some(shift) = calibration_shift(model, id, progress)?
                {
                    evidence.calibration_shifts.push((id, shift));
                }
                if given.focal_is_guess
                    && given.refine.focal
                    && camera.focal() != given.camera.focal()
                    && let Some(sigma) = focal_sigma(model, id, progress)?
                {
                    evidence.focal_sigmas.push((id, sigma));
                }
            }
            (evidence.verdict(model, cameras), evidence.witnesses.contradiction)
        }
        None => (Quality { verdict: Verdict::Failed, reasons: Vec::new() }, 0.0),
    };
    Ok(Attempt { mapper, models, quality, contradiction })
}

/// Whether most images have no strong pair with parallax.
fn is_yaw_scan(num_images: usize, pairs: &[TwoViewGeometry]) -> bool {
    let mut moved = vec![false; num_images];
    let mut paired = vec![false; num_images];
    for pair in pairs.iter().filter(|pair| pair.num_inliers() >= MIN_STRONG_INLIERS) {
        for id in [pair.image1, pair.image2] {
            let Some(paired) = paired.get_mut(id.0 as usize) else { continue };
            *paired = true;
            moved[id.0 as usize] |= !is_turn(pair) && pair.median_parallax >= FAIR_PARALLAX;
        }
    }
    let num_paired = paired.iter().filter(|&&paired| paired).count();
    let num_turned =
        paired.iter().zip(&moved).filter(|(paired, moved)| **paired && !**moved).count();
    num_paired > 0 && num_turned as f64 >= YAW_SCAN_FRACTION * num_paired as f64
}

/// Whether most pairs are turns.
fn mostly_turned(pairs: &[TwoViewGeometry]) -> bool {
    2 * pairs.iter().filter(|pair| pair.kind == TwoViewKind::RotationOnly).count() > pairs.len()
}

/// Whether the camera only turned between the images, as far as the pair can tell.
fn is_turn(pair: &TwoViewGeometry) -> bool {
    match pair.kind {
        TwoViewKind::RotationOnly => true,
        TwoViewKind::Uncalibrated => false,
        TwoViewKind::General | TwoViewKind::Planar => pair.median_parallax < TINY_PARALLAX,
    }
}

/// Every image without a pose in the first model, and why.
fn unplaced_images(input: Input<'_>, models: &[SparseModel]) -> Vec<UnplacedImage> {
    let Input { images, pairs, options, .. } = input;
    let placed = |id: ImageId| models.first().is_some_and(|map| map.images.contains_key(&id));
    images
        .iter()
        .map(|image| image.id)
        .filter(|&id| !placed(id))
        .map(|image| {
            let in_zone = models.iter().skip(1).any(|zone| zone.images.contains_key(&image));
            let (mut total, mut turned, mut to_map) = (0usize, 0usize, 0usize);
            for pair in pairs.iter().filter(|p| p.image1 == image || p.image2 == image) {
                let other = if pair.image1 == image { pair.image2 } else { pair.image1 };
                total += pair.num_inliers();
                if is_turn(pair) {
                    turned += pair.num_inliers();
                }
                if placed(other) {
                    to_map += pair.num_inliers();
                }
            }
            let reason = if options.poses_are_given {
                UnplacedReason::NoGivenPose
            } else if in_zone {
                UnplacedReason::OtherZone
            } else if total == 0 {
                UnplacedReason::NoOverlap
            } else if 2 * turned >= total {
                UnplacedReason::NoParallax
            } else if to_map > 0 || models.is_empty() {
                UnplacedReason::Ambiguous
            } else {
                UnplacedReason::NoOverlap
            };
            UnplacedImage { image, reason }
        })
        .collect()
}
