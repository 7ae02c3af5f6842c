//! Second stage: which pairs show the same, and the geometry between them.

use std::{
    path::Path,
    sync::atomic::{AtomicUsize, Ordering},
};

use nalgebra::Point2;
use rayon::prelude::*;
use volery_estimation::estimate_two_view_geometry;
use volery_features::{GlobalDescriptor, PackedDescriptors, match_features};
use volery_scene::{CameraId, FeatureMatch, ImageId, ImagePrior, Progress, Stage, TwoViewGeometry};
use volery_sfm::{SfmCamera, select_pairs};

use crate::{
    cache::{Key, KeyMaker},
    error::PipelineError,
    ingest::Usable,
    options::StageOptions,
    pair_log::PairLog,
};

/// Pairs between two writes to the log.
const PAIRS_PER_CHUNK: usize = 64;

/// What the pairs of a job are matched with.
pub(crate) struct PairContext<'a> {
    /// Photos in the order of their ids.
    pub(crate) photos: &'a [Usable],
    /// Cameras by id.
    pub(crate) cameras: &'a [SfmCamera],
    /// Camera of every photo.
    pub(crate) camera_of: &'a [CameraId],
    /// Options.
    pub(crate) options: &'a StageOptions,
    /// Seed of the job.
    pub(crate) seed: u64,
}

/// Verified pairs.
pub(crate) struct Matched {
    /// Sorted by image ids.
    pub(crate) pairs: Vec<TwoViewGeometry>,
    /// How many were tried.
    pub(crate) num_tried: usize,
    /// How many came from the log.
    pub(crate) num_cached: usize,
}

/// Chooses the pairs.
pub(crate) fn choose_pairs(
    photos: &[Usable],
    priors: &[ImagePrior],
    options: &StageOptions,
) -> Vec<(usize, usize)> {
    let globals: Vec<GlobalDescriptor> = photos.iter().map(|p| p.photo.global.clone()).collect();
    select_pairs(&globals, priors, &options.pairs)
}

/// Matches and verifies `pairs`, taking from the log what it knows.
pub(crate) fn match_pairs(
    context: &PairContext<'_>,
    pairs: &[(usize, usize)],
    work_dir: &Path,
    progress: &dyn Progress,
) -> Result<Matched, PipelineError> {
    progress.report(Stage::Matching, 0, pairs.len());
    let log = PairLog::open(work_dir)?;
    let known: Vec<(Key, Option<Option<TwoViewGeometry>>)> = pairs
        .par_iter()
        .map(|&pair| {
            let key = context.key(pair);
            let outcome = log.get(&key);
            (key, outcome)
        })
        .collect();
    let num_cached = known.iter().filter(|(_, outcome)| outcome.is_some()).count();
    let done = AtomicUsize::new(num_cached);
    progress.report(Stage::Matching, num_cached, pairs.len());

    let missing = num_cached < pairs.len();
    let images: Vec<Prepared> =
        if missing { context.photos.par_iter().map(Prepared::new).collect() } else { Vec::new() };
    let mut outcomes = Vec::with_capacity(pairs.len());
    for (pairs_chunk, known_chunk) in
        pairs.chunks(PAIRS_PER_CHUNK).zip(known.chunks(PAIRS_PER_CHUNK))
    {
        let chunk: Vec<Option<TwoViewGeometry>> = pairs_chunk
            .par_iter()
            .zip(known_chunk)
            .map(|(&pair, (_, outcome))| {
                if let Some(outcome) = outcome {
                    return Ok(outcome.clone());
                }
                progress.check()?;
                let outcome = context.verify(pair, &images);
                let finished = done.fetch_add(1, Ordering::Relaxed) + 1;
                progress.report(Stage::Matching, finished, pairs.len());
                Ok(outcome)
            })
            .collect::<Result<_, PipelineError>>()?;
        let fresh = known_chunk.iter().zip(&chunk).filter(|((_, known), _)| known.is_none());
        log.append(fresh.map(|((key, _), outcome)| (key, outcome.as_ref())))?;
        outcomes.extend(chunk);
    }
    let pairs_found = outcomes
        .into_iter()
        .zip(pairs)
        .filter_map(|(outcome, &(i, j))| {
            // Ids are positions in this job; the log may be of another one.
            let (image1, image2) = (ImageId(i as u32), ImageId(j as u32));
            outcome.map(|geometry| TwoViewGeometry { image1, image2, ..geometry })
        })
        .collect();
    Ok(Matched { pairs: pairs_found, num_tried: pairs.len(), num_cached })
}

/// What of a photo is needed for each of its pairs, made once.
struct Prepared {
    packed: PackedDescriptors,
    pixels: Vec<Point2<f64>>,
}

impl Prepared {
    fn new(usable: &Usable) -> Self {
        let features = &usable.photo.features;
        Self {
            packed: PackedDescriptors::new(&features.descriptors),
            pixels: features.keypoints.iter().map(|k| k.pixel()).collect(),
        }
    }
}

impl PairContext<'_> {
    fn camera(&self, photo: usize) -> &SfmCamera {
        &self.cameras[self.camera_of[photo].0 as usize]
    }

    fn is_calibrated(&self, (i, j): (usize, usize)) -> bool {
        !self.camera(i).focal_is_guess && !self.camera(j).focal_is_guess
    }

    fn key(&self, pair: (usize, usize)) -> Key {
        let (i, j) = pair;
        KeyMaker::new("pair")
            .with(self.photos[i].key.as_bytes())
            .with(self.photos[j].key.as_bytes())
            .with_debug(&self.camera(i).camera)
            .with_debug(&self.camera(j).camera)
            .with_debug(&self.is_calibrated(pair))
            .with_debug(&self.options.matching)
            .with_debug(&self.options.two_view)
            .with_debug(&self.seed)
            .key()
    }

    fn verify(&self, pair: (usize, usize), images: &[Prepared]) -> Option<TwoViewGeometry> {
        let (i, j) = pair;
        let (image1, image2) = (&images[i], &images[j]);
        let matches = match_features(&image1.packed, &image2.packed, &self.options.matching);
        if matches.len() < self.options.two_view.min_inliers {
            return None;
        }
        let options = volery_estimation::TwoViewOptions {
            calibrated: self.is_calibrated(pair),
            ..self.options.two_view
        };
        estimate_two_view_geometry(
            ImageId(i as u32),
            &self.camera(i).camera,
            &image1.pixels,
            ImageId(j as u32),
            &self.camera(j).camera,
            &image2.pixels,
            &matches,
            &options,
            seed_of(self.seed, &matches),
        )
    }
}

/// Seed of a pair: of the job and the matches alone, so that neither the place of the photos in the
/// job nor another build of the program changes what is found.
fn seed_of(job_seed: u64, matches: &[FeatureMatch]) -> u64 {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&job_seed.to_le_bytes());
    for m in matches {
        hasher.update(&m.feature1.to_le_bytes()).update(&m.feature2.to_le_bytes());
    }
    let hash = hasher.finalize();
    let (seed, _) = hash.as_bytes().split_first_chunk::<8>().expect("a hash has 32 bytes");
    u64::from_le_bytes(*seed)
}
