//! Photos that join a map one by one.

use nalgebra::Point2;
use rayon::prelude::*;
use volery_geometry::Camera;
use volery_localization::{
    LocalizationPrior, LocalizeOptions, PoseEstimate, Reference, Status, StepTimings,
    localize_features,
};
use volery_scene::{CameraId, PointId, Progress, RegisteredImage};

use super::{
    contents::index,
    part::{KeptFeatures, points_of_index},
    whole::Whole,
};
use crate::{
    PipelineError,
    cameras::{likely_camera, scaled_to},
    photo::Photo,
    spec::CameraSpec,
};

/// A photo with what is known of it.
pub(super) struct Newcomer<'a> {
    /// In the map.
    pub(super) name: String,
    pub(super) photo: &'a Photo,
    /// If it was given.
    pub(super) camera: Option<&'a CameraSpec>,
}

impl Newcomer<'_> {
    fn camera(&self, whole: &Whole) -> Option<Camera> {
        let size = self.photo.hint.size;
        let given = self.camera.and_then(|camera| camera.camera().ok());
        let fits = |camera: &Camera| scaled_to(camera, size.width, size.height);
        given.as_ref().and_then(fits).or_else(|| {
            let of_map = whole.model.cameras.values().find_map(fits);
            likely_camera(of_map, (size.width, size.height), self.photo.hint.focal_px)
        })
    }
}

/// Looks for each photo in the map and adds those that are found: pose, sightings and descriptors.
/// Returns per photo the stable code of why it was not found.
pub(super) fn place_newcomers(
    whole: &mut Whole,
    newcomers: &[Newcomer<'_>],
    seed: u64,
    progress: &dyn Progress,
) -> Result<Vec<Result<(), &'static str>>, PipelineError> {
    if newcomers.is_empty() {
        return Ok(Vec::new());
    }
    progress.check()?;
    let index = index(&whole.model, &whole.features);
    let points = points_of_index(&index, &whole.model, &nalgebra::Similarity3::identity());
    let options =
        LocalizeOptions { seed, error_against: Reference::Map, ..LocalizeOptions::default() };
    let prior = LocalizationPrior::default();
    let found: Vec<Result<(Camera, PoseEstimate), &'static str>> = newcomers
        .par_iter()
        .map(|newcomer| {
            progress.check()?;
            let Some(camera) = newcomer.camera(whole) else { return Ok(Err("unknown_camera")) };
            let features = &newcomer.photo.features;
            let mut timings = StepTimings::default();
            let answer = localize_features(
                features,
                &camera,
                &index,
                &prior,
                &options,
                &|| 0.0,
                &mut timings,
            );
            Ok(match answer.status {
                Status::Ok(estimate) => Ok((camera, estimate)),
                Status::Ambiguous(_) => Err("ambiguous"),
                Status::NotFound(reason) => Err(reason.code()),
            })
        })
        .collect::<Result<_, PipelineError>>()?;
    let outcomes = newcomers.iter().zip(found).map(|(newcomer, found)| {
        found.map(|(camera, estimate)| add(whole, newcomer, camera, &estimate, &points))
    });
    Ok(outcomes.collect())
}

fn add(
    whole: &mut Whole,
    newcomer: &Newcomer<'_>,
    camera: Camera,
    estimate: &PoseEstimate,
    points: &[Option<PointId>],
) {
    let model = &mut whole.model;
    let known = model.cameras.iter().find(|(_, known)| **known == camera).map(|(id, _)| *id);
    let camera = known.unwrap_or_else(|| {
        let id = CameraId(model.cameras.keys().next_back().map_or(0, |last| last.0 + 1));
        model.cameras.insert(id, camera);
        id
    });
    let features = &newcomer.photo.features;
    let keypoints: Vec<Point2<f64>> = features.keypoints.iter().map(|k| k.pixel()).collect();
    let mut seen = vec![None; keypoints.len()];
    for sighting in &estimate.sightings {
        seen[sighting.keypoint as usize] = points[sighting.point as usize];
    }
    model.add_image(RegisteredImage {
        name: newcomer.name.clone(),
        camera,
        cam_from_world: estimate.map_from_camera.inverse(),
        keypoints,
        points: seen,
    });
    let descriptors = features.descriptors.iter().copied().map(Some).collect();
    let global = newcomer.photo.global.clone();
    whole.features.push(KeptFeatures { descriptors, global });
}
