//! The stages in order.

use std::{fs, path::Path};

use volery_scene::{EnvironmentMap, ImagePrior, OriginRule, Stage, Verdict};
use volery_sfm::{AlignOptions, Reconstruction, environment_map};

use crate::{
    cache::Cache,
    cameras::{Cameras, assign_cameras},
    clock::Stopwatch,
    error::{PipelineError, code},
    export::write_map,
    files::Files,
    ingest::{Fate, Ingested, ingest},
    map_folder::MapInfo,
    mapping::map_pairs,
    matching::{Matched, PairContext, choose_pairs, match_pairs},
    options::StageOptions,
    progress::StageProgress,
    report,
    spec::{JobSpec, PoseSource},
    summary::{StageReport, Summary, Warning},
    surface::{SurfaceTrace, add_surface},
};

/// Fewest features of a photo that any pose can come from.
const MIN_FEATURES: usize = 15;

/// What a run has learned so far; the report is made from it even when the run fails.
#[derive(Default)]
pub(crate) struct Trace {
    /// Photos, once read.
    pub(crate) ingested: Option<Ingested>,
    /// Cameras, once assigned.
    pub(crate) cameras: Option<Cameras>,
    /// Number of verified pairs.
    pub(crate) num_verified_pairs: usize,
    /// Finished stages.
    pub(crate) stages: Vec<StageReport>,
    /// What the user should know.
    pub(crate) warnings: Vec<Warning>,
    /// Whose model was kept.
    pub(crate) mapper: String,
    /// What came after the sparse map.
    pub(crate) surface: SurfaceTrace,
}

/// See [`crate::reconstruct`].
pub(crate) fn reconstruct(
    spec: &JobSpec,
    work_dir: &Path,
    out_dir: &Path,
    progress: &dyn StageProgress,
) -> Result<Summary, PipelineError> {
    let clock = Stopwatch::start();
    fs::create_dir_all(out_dir).map_err(|e| PipelineError::io(out_dir, &e))?;
    let mut trace = Trace::default();
    let options = StageOptions::of(spec);
    match build(spec, &options, work_dir, out_dir, progress, &mut trace) {
        Ok((map, info)) => {
            let summarize = |trace: &Trace| {
                let summary = report::summarize(spec, trace, Some(&map), None, &clock);
                report::write(&summary, Some(&map), &trace.surface.pictures, out_dir)?;
                Ok(summary)
            };
            let Some(ingested) = &trace.ingested else { return summarize(&trace) };
            // What follows may end the process; the sparse map and its report are there then.
            summarize(&trace)?;
            let folders = [work_dir, out_dir];
            let files = Files::of_job(spec, ingested);
            let surface = add_surface(spec, &files, &map, &info, &options, folders, progress)?;
            trace.stages.extend(surface.stages.iter().cloned());
            trace.surface = surface;
            summarize(&trace)
        }
        Err(error) => {
            if !error.is_cancelled() && trace.ingested.is_some() {
                let summary = report::summarize(spec, &trace, None, Some(&error), &clock);
                report::write(&summary, None, &trace.surface.pictures, out_dir)?;
            }
            Err(error)
        }
    }
}

fn build(
    spec: &JobSpec,
    options: &StageOptions,
    work_dir: &Path,
    out_dir: &Path,
    progress: &dyn StageProgress,
    trace: &mut Trace,
) -> Result<(EnvironmentMap, MapInfo), PipelineError> {
    check_spec(spec)?;

    let watch = Stopwatch::start();
    let cache = Cache::open(work_dir, Stage::Features)?;
    let ingested = trace.ingested.insert(ingest(spec, options, &cache, progress)?);
    progress.reused(Stage::Features, ingested.num_cached);
    trace.stages.push(watch.stage("features", ingested.usable.len(), ingested.num_cached));
    let photos = &ingested.usable;
    check_photos(spec, ingested)?;
    let cameras = trace.cameras.insert(assign_cameras(spec, photos)?);
    let priors: Vec<ImagePrior> = photos.iter().map(|p| spec.images[p.input].prior).collect();

    let watch = Stopwatch::start();
    progress.report(Stage::Pairs, 0, photos.len());
    let pairs = choose_pairs(photos, &priors, options);
    progress.report(Stage::Pairs, photos.len(), photos.len());
    trace.stages.push(watch.stage("pairs", photos.len(), 0));

    let watch = Stopwatch::start();
    let context = PairContext {
        photos,
        cameras: &cameras.cameras,
        camera_of: &cameras.of_photo,
        options,
        seed: spec.seed,
    };
    let matched = match_pairs(&context, &pairs, work_dir, progress)?;
    trace.num_verified_pairs = matched.pairs.len();
    progress.reused(Stage::Matching, matched.num_cached);
    trace.stages.push(watch.stage("matching", matched.num_tried, matched.num_cached));
    check_pairs(&matched, photos.len())?;

    let watch = Stopwatch::start();
    progress.report(Stage::Mapping, 0, photos.len());
    let cache = Cache::open(work_dir, Stage::Mapping)?;
    let (reconstruction, cached) = map_pairs(
        spec,
        photos,
        &cameras.cameras,
        &cameras.of_photo,
        &priors,
        &matched.pairs,
        options,
        &cache,
        progress,
    )?;
    let num_cached = usize::from(cached) * photos.len();
    progress.reused(Stage::Mapping, num_cached);
    trace.stages.push(watch.stage("mapping", photos.len(), num_cached));
    trace.mapper = reconstruction.mapper.to_owned();
    check_reconstruction(&reconstruction)?;

    let watch = Stopwatch::start();
    progress.check()?;
    progress.report(Stage::Align, 0, 1);
    let map = environment_map(reconstruction, &priors, &align_options(spec));
    progress.report(Stage::Align, 1, 1);
    trace.stages.push(watch.stage("align", 1, 0));
    check_map(spec, &map, &mut trace.warnings)?;

    let watch = Stopwatch::start();
    let info = write_map(spec, ingested, &map, out_dir, progress)?;
    trace.stages.push(watch.stage("export", 1, 0));
    Ok((map, info))
}

/// Position priors bring a frame of their own, which is kept unless the job says otherwise.
fn align_options(spec: &JobSpec) -> AlignOptions {
    let has_positions = spec.images.iter().any(|image| image.prior.position.is_some());
    let default = if has_positions { OriginRule::Given } else { OriginRule::LastCamera };
    AlignOptions {
        origin: spec.origin.unwrap_or(default),
        known_distances: spec.known_distances.clone(),
        is_in_map_frame: spec.poses == PoseSource::GivenMetric,
    }
}

fn check_spec(spec: &JobSpec) -> Result<(), PipelineError> {
    if spec.images.is_empty() {
        return Err(PipelineError::new(
            code::NO_IMAGES,
            "there are no images",
            "name a folder with JPEG or PNG photos",
        ));
    }
    let num_posed = spec.images.iter().filter(|image| image.prior.pose.is_some()).count();
    if spec.poses.is_given() && num_posed < 2 {
        return Err(PipelineError::new(
            code::NO_GIVEN_POSES,
            format!("{num_posed} of {} images have a given pose", spec.images.len()),
            "give the model that holds the poses of these photos, or let them be estimated",
        ));
    }
    for distance in &spec.known_distances {
        let names = [&distance.image_a, &distance.image_b];
        for name in names {
            if !spec.images.iter().any(|image| image.name == *name) {
                return Err(PipelineError::new(
                    code::BAD_INPUT,
                    format!("the known distance names image {name:?}, which is not in the set"),
                    "use the file names of two photos",
                ));
            }
        }
        if names[0] == names[1] || !(distance.meters.is_finite() && distance.meters > 0.0) {
            return Err(PipelineError::new(
                code::BAD_INPUT,
                format!(
                    "the known distance from {:?} to {:?} is {} m",
                    names[0], names[1], distance.meters
                ),
                "name two different photos and a positive distance in meters",
            ));
        }
    }
    Ok(())
}

fn check_photos(spec: &JobSpec, ingested: &Ingested) -> Result<(), PipelineError> {
    let num_duplicates =
        ingested.fates.iter().filter(|fate| matches!(fate, Fate::DuplicateOf(_))).count();
    let first_unreadable = ingested.fates.iter().zip(&spec.images).find_map(|(fate, image)| {
        let Fate::Unreadable(_, detail) = fate else { return None };
        Some(format!("; {}: {detail}", image.name))
    });
    if ingested.usable.len() < 2 {
        return Err(PipelineError::new(
            code::TOO_FEW_IMAGES,
            format!(
                "{} of {} images can be used ({num_duplicates} repeat another one){}",
                ingested.usable.len(),
                spec.images.len(),
                first_unreadable.unwrap_or_default()
            ),
            "a map needs at least two different photos; a good one, dozens",
        ));
    }
    let most = ingested.usable.iter().map(|p| p.photo.features.len()).max().unwrap_or(0);
    if most < MIN_FEATURES {
        return Err(PipelineError::new(
            code::TOO_FEW_FEATURES,
            format!("no image shows more than {most} features"),
            "the photos are blank or blurred: show surfaces with texture, hold the camera still",
        ));
    }
    Ok(())
}

fn check_pairs(matched: &Matched, num_photos: usize) -> Result<(), PipelineError> {
    if matched.pairs.is_empty() {
        return Err(PipelineError::new(
            code::NO_OVERLAP,
            format!(
                "none of {} pairs of {num_photos} images shows the same place",
                matched.num_tried
            ),
            "neighboring photos should share more than half of their view",
        ));
    }
    Ok(())
}

fn check_reconstruction(reconstruction: &Reconstruction) -> Result<(), PipelineError> {
    let quality = &reconstruction.quality;
    if !reconstruction.models.is_empty() && quality.verdict != Verdict::Failed {
        return Ok(());
    }
    let (code, detail) = match quality.reasons.first() {
        Some(reason) => (reason.code.as_str(), reason.detail.clone()),
        None => (code::NO_MODEL, "no part of the scene could be built".to_owned()),
    };
    Err(PipelineError::new(code, detail, advice_for(code)))
}

/// What to do about a failure or a doubt.
pub(crate) fn advice_for(code: &str) -> &'static str {
    match code {
        code::NO_PARALLAX => {
            "move while turning: a circle of at least 0.3 m radius or several hover points; \
             a camera that only turns sees no depth"
        }
        code::NO_OVERLAP => {
            "take more photos between those that do not connect; turn by at most 15 degrees"
        }
        "weakly_tied" => "take a few photos between the parts that hardly overlap",
        "drift" => {
            "let the flight come back to places it has seen, or give more photos that show the same"
        }
        "wrong_calibration" => {
            "check that the calibration is of this camera, lens setting and image size, or leave it out"
        }
        "absurd_intrinsics" => "give the camera's calibration with --camera",
        _ => "take sharper photos with more overlap, moving sideways between them",
    }
}

fn check_map(
    spec: &JobSpec,
    map: &EnvironmentMap,
    warnings: &mut Vec<Warning>,
) -> Result<(), PipelineError> {
    let placed = |name: &str| map.model.images.values().any(|image| image.name == name);
    for distance in &spec.known_distances {
        for name in [&distance.image_a, &distance.image_b] {
            if !placed(name) {
                warnings.push(Warning {
                    code: "known_distance_unused".to_owned(),
                    detail: format!("image {name:?} of a known distance has no pose"),
                    hint: Some("measure between two photos that were registered".to_owned()),
                });
            }
        }
    }
    if !map.scale.metric {
        warnings.push(Warning {
            code: "not_metric".to_owned(),
            detail: "nothing tells the scale: lengths of this map are not meters".to_owned(),
            hint: Some(
                "give --known-distance, --positions, or --telemetry with changing height"
                    .to_owned(),
            ),
        });
    }
    if map.model.images.is_empty() {
        return Err(PipelineError::plain(code::NO_MODEL, "the map holds no image"));
    }
    Ok(())
}
