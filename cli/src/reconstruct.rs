//! `volery reconstruct`.

use std::fs;

use volery_pipeline::{
    ForeignModel, ImageInput, JobSpec, PipelineError, Summary, error::code, reconstruct,
};
use volery_scene::{ImagePrior, Verdict};

use crate::{
    args::ReconstructArgs,
    input,
    output::{Ending, Outcome, print_json},
    progress::Terminal,
};

/// Folder inside OUT that holds finished units until the map is done.
const WORK_FOLDER: &str = ".work";

pub(crate) fn run(args: &ReconstructArgs, json: bool) -> Outcome {
    let spec = job_spec(args)?;
    let own_work = args.out.join(WORK_FOLDER);
    let work = args.work.as_ref().unwrap_or(&own_work);
    let progress = Terminal::new();
    let summary = reconstruct(&spec, work, &args.out, &progress);
    progress.finish();
    let summary = summary.map_err(|error| resumable(error, args.work.is_none()))?;
    if args.work.is_none() {
        fs::remove_dir_all(&own_work).map_err(|e| PipelineError::io(&own_work, &e))?;
    }
    if json {
        print_json(&summary);
    } else {
        print_text(&summary, args);
    }
    Ok(if summary.is_complete() { Ending::Done } else { Ending::Partial })
}

fn resumable(error: PipelineError, has_own_work: bool) -> PipelineError {
    if error.is_cancelled() && has_own_work {
        PipelineError { hint: Some("the same command goes on where it stopped".into()), ..error }
    } else {
        error
    }
}

fn job_spec(args: &ReconstructArgs) -> Result<JobSpec, PipelineError> {
    let files = input::photos(&args.photos)?;
    let priors = input::priors(&args.flight)?;
    let num_known = files.iter().filter(|file| priors.contains_key(&file.name)).count();
    if !priors.is_empty() && num_known == 0 && !files.is_empty() {
        return Err(PipelineError::new(
            code::BAD_INPUT,
            "no photo is named in the telemetry or positions given",
            "their column `image` must hold the file names of the photos",
        ));
    }
    let mut model = match &args.given.model {
        Some(path) => input::model(path, files.iter().map(|file| file.name.clone()).collect())?,
        None => ForeignModel::default(),
    };
    let mut images: Vec<ImageInput> = files
        .into_iter()
        .map(|file| {
            let mut prior = priors.get(&file.name).copied().unwrap_or_default();
            let (pose, camera) = model.images.remove(&file.name).unzip();
            prior.pose = pose;
            ImageInput { prior, camera, ..ImageInput::new(file.name, file.path) }
        })
        .collect();
    sort_by_time(&mut images);
    let camera = args.camera.as_deref().map(input::camera).transpose()?;
    Ok(JobSpec {
        camera,
        known_distances: args.known_distance.clone(),
        preset: args.effort.preset(),
        seed: args.seed,
        origin: args.origin.map(Into::into),
        poses: args.given.poses(),
        options: args.effort.options(),
        stages: args.effort.stages(),
        ..JobSpec::new(images)
    })
}

/// The order of capture is that of the times, if every photo has one.
fn sort_by_time(images: &mut [ImageInput]) {
    let time = |prior: &ImagePrior| prior.time_s.unwrap_or(f64::INFINITY);
    if images.iter().all(|image| image.prior.time_s.is_some()) {
        images.sort_by(|a, b| time(&a.prior).total_cmp(&time(&b.prior)));
    }
}

fn print_text(summary: &Summary, args: &ReconstructArgs) {
    let verdict = match summary.quality.verdict {
        Verdict::Good => "good",
        Verdict::Suspect => "suspect",
        Verdict::Failed => "failed",
    };
    println!(
        "{} of {} images registered, {} points, mean reprojection error {} px",
        summary.num_registered,
        summary.num_images,
        summary.num_points,
        summary.mean_reprojection_px.map_or("?".to_owned(), |e| format!("{e:.3}")),
    );
    println!("verdict: {verdict}");
    for reason in &summary.quality.reasons {
        println!("  {}: {}", reason.code, reason.detail);
    }
    for warning in &summary.warnings {
        println!("warning: {}", warning.detail);
        if let Some(hint) = &warning.hint {
            println!("  {hint}");
        }
    }
    if let Some(dense) = summary.dense.as_ref().filter(|dense| dense.error.is_none()) {
        let (maps, points) = (dense.num_depth_maps, dense.num_points);
        println!("{maps} depth maps, {points} dense points, {} inferred", dense.num_inferred);
    }
    if let Some(mesh) = summary.mesh.as_ref().filter(|mesh| mesh.error.is_none()) {
        println!("mesh of {} triangles", mesh.num_triangles);
    }
    if let Some(error) = summary.surface_error() {
        println!("no surface: {}: {}", error.code, error.detail);
        if let Some(hint) = &error.hint {
            println!("  {hint}");
        }
    }
    for stage in &summary.stages {
        println!(
            "{:10} {:8.2} s wall {:8.2} s CPU, {} units, {} cached",
            stage.name, stage.wall_s, stage.cpu_s, stage.units, stage.cached
        );
    }
    println!("all        {:8.2} s wall {:8.2} s CPU", summary.wall_s, summary.cpu_s);
    println!("map: {0}, report: {0}/report.html", args.out.display());
}
