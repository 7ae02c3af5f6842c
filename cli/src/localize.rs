//! `volery localize` against a map folder, without a server.

use std::{fs, path::Path, time::Instant};

use serde::Serialize;
use volery_api::{ImageEncoding, Localization, LocalizeMethod, LocalizeStatus};
use volery_formats::{NamedPose, write_poses_csv};
use volery_geometry::{Isometry3, Point3, UnitQuaternion};
use volery_localization::{LocalizationPrior, LocalizeOptions};
use volery_pipeline::{
    MapFolder, PipelineError,
    error::code,
    worker::{localization, query_image},
};
use volery_scene::ImagePrior;

use crate::{
    args::LocalizeArgs,
    input::{self, PhotoFile},
    output::{Ending, Outcome, print_json},
    progress::Counter,
};

/// The answer to one photo.
#[derive(Debug, Serialize)]
struct Answer {
    image: String,
    #[serde(flatten)]
    result: AnswerResult,
}

/// What came of a photo.
#[derive(Debug, Serialize)]
#[serde(untagged)]
enum AnswerResult {
    Localization(Box<Localization>),
    /// It could not even be asked about.
    Error {
        error: PipelineError,
    },
}

pub(crate) fn run(args: &LocalizeArgs, json: bool) -> Outcome {
    if let Some((server, map)) = args.remote() {
        return crate::remote::localize(args, server, map, json);
    }
    let [folder, photos @ ..] = args.paths.as_slice() else { return Err(no_photos()) };
    if photos.is_empty() {
        return Err(no_photos());
    }
    let map = MapFolder::open(folder)?;
    let files = input::photos(photos)?;
    let camera = match &args.camera {
        Some(path) => Some(input::camera(path)?.camera().map_err(|e| input::unusable(path, &e))?),
        None => None,
    };
    let telemetry = args.telemetry.as_deref().map(input::telemetry).transpose()?;
    let options = LocalizeOptions { seed: args.seed, ..LocalizeOptions::default() };
    let mut answers = Answers::new(files.len(), json);
    for file in &files {
        let prior = telemetry.as_ref().and_then(|rows| rows.get(&file.name));
        let mut prior =
            prior.map_or_else(LocalizationPrior::default, |prior| map_prior(&map, prior));
        prior.position = args.near.map(|near| (Point3::from(near), args.near_sigma));
        let method = args.method.into();
        answers.add(&file.name, localize(file, &map, camera.as_ref(), &prior, &options, method));
    }
    answers.finish(args, map.info().scale.metric)
}

/// The answers of a run, told one by one as they come, or counted where all are one document.
pub(crate) struct Answers {
    num_photos: usize,
    json: bool,
    answers: Vec<Answer>,
    poses: Vec<NamedPose>,
    counter: Counter,
}

impl Answers {
    pub(crate) fn new(num_photos: usize, json: bool) -> Self {
        let (answers, poses) = (Vec::new(), Vec::new());
        Self { num_photos, json, answers, poses, counter: Counter::default() }
    }

    /// The next photo's.
    pub(crate) fn add(&mut self, image: &str, found: Result<Localization, PipelineError>) {
        let image = image.to_owned();
        if let Some(world_from_cam) = found.as_ref().ok().and_then(pose_of) {
            self.poses.push(NamedPose { image: image.clone(), world_from_cam });
        }
        let result = match found {
            Ok(answer) => AnswerResult::Localization(Box::new(answer)),
            Err(error) => AnswerResult::Error { error },
        };
        let answer = Answer { image, result };
        if self.json {
            let (done, total) = (self.answers.len() as u64 + 1, self.num_photos as u64);
            self.counter.show("localize", done, total, "photos");
        } else {
            print_text(&answer);
        }
        self.answers.push(answer);
    }

    /// Writes the poses and the answers.
    pub(crate) fn finish(mut self, args: &LocalizeArgs, metric: bool) -> Outcome {
        self.counter.end();
        let Self { answers, poses, .. } = &self;
        write(args.out.as_deref(), poses)?;
        if self.json {
            print_json(&serde_json::json!({
                "metric": metric,
                "num_images": answers.len(),
                "num_ok": poses.len(),
                "images": answers,
            }));
        } else {
            println!("{} of {} photos localized", poses.len(), answers.len());
        }
        let any_error = answers.iter().any(|a| matches!(a.result, AnswerResult::Error { .. }));
        Ok(if any_error { Ending::Partial } else { Ending::Done })
    }
}

fn localize(
    file: &PhotoFile,
    map: &MapFolder,
    camera: Option<&volery_geometry::Camera>,
    prior: &LocalizationPrior,
    options: &LocalizeOptions,
    method: LocalizeMethod,
) -> Result<Localization, PipelineError> {
    let start = Instant::now();
    let bytes = fs::read(&file.path).map_err(|e| PipelineError::io(&file.path, &e))?;
    let query = query_image(&bytes, ImageEncoding::Auto, None, camera, map)
        .map_err(|e| PipelineError::plain(e.code(), format!("{}: {e}", file.name)))?;
    let decode_ms = start.elapsed().as_secs_f64() * 1e3;
    let located = map.locate(&query.image, &query.camera, prior, options, method)?;
    let mut reply = localization(&located);
    reply.timings.decode_ms = Some(decode_ms);
    reply.timings.total_ms = Some(start.elapsed().as_secs_f64() * 1e3);
    Ok(reply)
}

/// The yaw of the telemetry, in the map.
fn map_prior(map: &MapFolder, prior: &ImagePrior) -> LocalizationPrior {
    let yaw = map.info().north.zip(prior.attitude).map(|(north, attitude)| north.yaw_of(&attitude));
    LocalizationPrior { position: None, yaw }
}

/// Poses as a table; nothing if no file is named.
fn write(out: Option<&Path>, poses: &[NamedPose]) -> Result<(), PipelineError> {
    let Some(out) = out else { return Ok(()) };
    fs::write(out, write_poses_csv(poses)).map_err(|e| PipelineError::io(out, &e))
}

/// The pose of an answer.
pub(crate) fn pose_of(answer: &Localization) -> Option<Isometry3<f64>> {
    let pose = answer.pose.as_ref().filter(|_| answer.status == LocalizeStatus::Ok)?;
    let [w, i, j, k] = pose.orientation;
    let rotation = UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, i, j, k));
    Some(Isometry3::from_parts(pose.position.into(), rotation))
}

fn print_text(answer: &Answer) {
    match &answer.result {
        AnswerResult::Error { error } => println!("{}: error: {error}", answer.image),
        AnswerResult::Localization(found) => match (&found.pose, &found.reason) {
            (Some(pose), _) => {
                let [x, y, z] = pose.position;
                println!(
                    "{}: ok, ({x:.3}, {y:.3}, {z:.3}), {} inliers",
                    answer.image, found.num_inliers
                );
            }
            (None, Some(reason)) => println!("{}: not found, {reason}", answer.image),
            (None, None) => println!("{}: ambiguous", answer.image),
        },
    }
}

fn no_photos() -> PipelineError {
    PipelineError::new(
        code::BAD_INPUT,
        "no photos are named",
        "volery localize MAP PHOTOS, or volery localize [--server URL] --map ID PHOTOS",
    )
}
