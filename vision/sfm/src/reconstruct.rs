//! Verified pairs to sparse models: the incremental and the global mapper, validated, the better
//! one kept.

use nalgebra::Point2;
use volery_estimation::IntrinsicsRefinement;
use volery_geometry::Camera;
use volery_scene::{
    CameraId, Cancelled, ImageId, ImagePrior, Progress, Quality, SparseModel, TwoViewGeometry,
    TwoViewKind, UnplacedImage, UnplacedReason, Verdict,
};

use crate::global::map_globally;
use crate::incremental::{Input, extend_model, map_incrementally};
use crate::quality::{Evidence, no_map};
use crate::self_calibration::start_cameras;

/// A camera as it is known before mapping.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SfmCamera {
    /// First intrinsics.
    pub camera: Camera,
    /// Which of them may move.
    pub refine: IntrinsicsRefinement,
    /// Whether the focal length is a guess (no EXIF, no calibration).
    pub focal_is_guess: bool,
}

/// An image as the mapper sees it. Position in the slice = order of capture.
#[derive(Debug, Clone, PartialEq)]
pub struct SfmImage {
    /// Id; equals its index in the slice.
    pub id: ImageId,
    /// File name.
    pub name: String,
    /// Its camera, an index into the cameras.
    pub camera: CameraId,
    /// Keypoints, pixels, as detected; `TwoViewGeometry` matches index into them.
    pub keypoints: Vec<Point2<f64>>,
    /// sRGB at the keypoints; as many.
    pub colors: Vec<[u8; 3]>,
    /// What else is known.
    pub prior: ImagePrior,
}

/// Options of [`reconstruct`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapperOptions {
    /// Seed of all random choices.
    pub seed: u64,
    /// Least triangulation angle of a point, radians.
    pub min_angle: f64,
    /// Greatest reprojection error of an observation, pixels.
    pub max_error_px: f64,
}

impl Default for MapperOptions {
    fn default() -> Self {
        Self { seed: 0, min_angle: 1.5_f64.to_radians(), max_error_px: 4.0 }
    }
}

/// What came of the pairs. Models are in arbitrary frames (no scale, no gravity).
#[derive(Debug, Clone, PartialEq)]
pub struct Reconstruction {
    /// Largest first; the first is the map, the others are zones. Empty if nothing could be built.
    pub models: Vec<SparseModel>,
    /// Images without a pose in `models[0]`.
    pub unplaced: Vec<UnplacedImage>,
    /// Verdict over `models[0]`.
    pub quality: Quality,
    /// `incremental` or `global`: whose model was kept.
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
}

/// Pairs of which so large a part only turns the camera make a yaw scan.
const YAW_SCAN_FRACTION: f64 = 0.6;
/// Parallax, radians, below which a pair of neighbors counts as turned in place.
const TINY_PARALLAX: f64 = 0.02;
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
    let input = Input { images, cameras, pairs, options };
    let order = if is_yaw_scan(pairs) {
        [Mapper::Global, Mapper::Incremental]
    } else {
        [Mapper::Incremental, Mapper::Global]
    };
    let first = attempt(order[0], input, progress)?;
    let satisfied = first.num_images() as f64 >= ENOUGH_IMAGES * images.len() as f64
        && first.quality.verdict == Verdict::Good;
    let kept = if satisfied {
        first
    } else {
        let second = attempt(order[1], input, progress)?;
        if second.is_better_than(&first) { second } else { first }
    };
    let unplaced = unplaced_images(images, pairs, &kept.models);
    Ok(Reconstruction {
        quality: if kept.models.is_empty() { no_map(&unplaced) } else { kept.quality },
        models: kept.models,
        unplaced,
        mapper: kept.mapper.name(),
    })
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Mapper {
    Incremental,
    Global,
}

impl Mapper {
    fn name(self) -> &'static str {
        match self {
            Self::Incremental => "incremental",
            Self::Global => "global",
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
    };
    let (quality, contradiction) = match models.first() {
        Some(model) => {
            let evidence = Evidence::of(model, pairs);
            (evidence.verdict(model, cameras), evidence.contradiction)
        }
        None => (Quality { verdict: Verdict::Failed, reasons: Vec::new() }, 0.0),
    };
    Ok(Attempt { mapper, models, quality, contradiction })
}

/// Whether most of the strongest pairs only turn the camera.
fn is_yaw_scan(pairs: &[TwoViewGeometry]) -> bool {
    let neighbors = || pairs.iter().filter(|pair| pair.image2.0 == pair.image1.0 + 1);
    let turned = neighbors().filter(|pair| {
        pair.kind == TwoViewKind::RotationOnly
            || (pair.kind != TwoViewKind::Uncalibrated && pair.median_parallax < TINY_PARALLAX)
    });
    let num_neighbors = neighbors().count();
    num_neighbors > 0 && turned.count() as f64 >= YAW_SCAN_FRACTION * num_neighbors as f64
}

/// Every image without a pose in the first model, and why.
fn unplaced_images(
    images: &[SfmImage],
    pairs: &[TwoViewGeometry],
    models: &[SparseModel],
) -> Vec<UnplacedImage> {
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
                if pair.kind == TwoViewKind::RotationOnly
                    || (pair.kind != TwoViewKind::Uncalibrated
                        && pair.median_parallax < TINY_PARALLAX)
                {
                    turned += pair.num_inliers();
                }
                if placed(other) {
                    to_map += pair.num_inliers();
                }
            }
            let reason = if in_zone {
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
