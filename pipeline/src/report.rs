//! `report.json` and `report.html`.

use std::{collections::BTreeMap, path::Path};

use volery_scene::{
    EnvironmentMap, Gravity, GravitySource, ImageId, OriginRule, Quality, QualityReason,
    RegisteredImage, Scale, ScaleSource, UnplacedReason, Verdict,
};

use crate::{
    atomic::write_atomic,
    clock::{Stopwatch, peak_rss_mib},
    error::{PipelineError, code},
    ingest::Fate,
    map_folder::file,
    report_html,
    report_surface::SurfacePictures,
    run::{Trace, advice_for},
    spec::JobSpec,
    summary::{CameraReport, ImageReport, Summary, Warning},
};

/// Collects what a run has to tell.
pub(crate) fn summarize(
    spec: &JobSpec,
    trace: &Trace,
    map: Option<&EnvironmentMap>,
    error: Option<&PipelineError>,
    clock: &Stopwatch,
) -> Summary {
    let images = image_reports(spec, trace, map, error);
    let quality = match (map, error) {
        (Some(map), _) => map.quality.clone(),
        (None, error) => failed(error),
    };
    let num_observations = map.map_or(0, |map| map.model.num_observations());
    let num_points = map.map_or(0, |map| map.model.points.len());
    let mut warnings = input_warnings(spec, trace);
    warnings.extend(trace.cameras.iter().flat_map(|c| c.warnings.iter().cloned()));
    warnings.extend(trace.warnings.iter().cloned());
    let advice = advice(&quality, &images);
    Summary {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        num_images: spec.images.len(),
        num_registered: images.iter().filter(|image| image.registered).count(),
        num_points,
        num_observations,
        mean_reprojection_px: map.and_then(|map| map.model.mean_reprojection_error_px()),
        mean_track_length: (num_points > 0).then(|| num_observations as f64 / num_points as f64),
        num_verified_pairs: trace.num_verified_pairs,
        num_zones: map.map_or(0, |map| map.zones.len()),
        mapper: trace.mapper.clone(),
        scale: map.map_or(
            Scale { metric: false, source: ScaleSource::Unknown, sigma_rel: None },
            |map| map.scale,
        ),
        gravity: map
            .map_or(Gravity { source: GravitySource::CameraUp, sigma: None }, |map| map.gravity),
        origin: map.map_or(OriginRule::LastCamera, |map| map.origin),
        quality,
        cameras: camera_reports(trace, map),
        images,
        dense: trace.surface.dense.clone(),
        mesh: trace.surface.mesh.clone(),
        stages: trace.stages.clone(),
        warnings,
        advice,
        error: error.cloned(),
        wall_s: clock.wall_s(),
        cpu_s: clock.cpu_s(),
        peak_rss_mib: peak_rss_mib(),
    }
}

/// Writes both files.
pub(crate) fn write(
    summary: &Summary,
    map: Option<&EnvironmentMap>,
    pictures: &SurfacePictures,
    out_dir: &Path,
) -> Result<(), PipelineError> {
    let json = serde_json::to_vec_pretty(summary)
        .map_err(|e| PipelineError::plain(code::IO, e.to_string()))?;
    write_atomic(&out_dir.join(file::REPORT), &json)?;
    let html = report_html::page(summary, map, pictures);
    write_atomic(&out_dir.join(file::REPORT_HTML), html.as_bytes())
}

fn failed(error: Option<&PipelineError>) -> Quality {
    let reason = error.map(|e| QualityReason { code: e.code.clone(), detail: e.detail.clone() });
    Quality { verdict: Verdict::Failed, reasons: reason.into_iter().collect() }
}

/// Why an image has no pose when no image has one; `None` where the input or the disk is to blame.
fn reason_of_failure(error: &PipelineError) -> Option<UnplacedReason> {
    match error.code.as_str() {
        code::NO_OVERLAP => Some(UnplacedReason::NoOverlap),
        code::NO_PARALLAX => Some(UnplacedReason::NoParallax),
        code::TOO_FEW_FEATURES => Some(UnplacedReason::TooFewFeatures),
        code::NO_IMAGES | code::TOO_FEW_IMAGES | code::BAD_INPUT | code::IO => None,
        _ => Some(UnplacedReason::Ambiguous),
    }
}

fn image_reports(
    spec: &JobSpec,
    trace: &Trace,
    map: Option<&EnvironmentMap>,
    error: Option<&PipelineError>,
) -> Vec<ImageReport> {
    let Some(ingested) = &trace.ingested else { return Vec::new() };
    let unplaced: BTreeMap<ImageId, UnplacedReason> = map
        .iter()
        .flat_map(|map| map.unplaced.iter().map(|image| (image.image, image.reason)))
        .collect();
    let empty = |name: &str| ImageReport {
        name: name.to_owned(),
        registered: false,
        reason: None,
        detail: None,
        duplicate_of: None,
        num_features: 0,
        num_observations: 0,
        reprojection_px: None,
    };
    let reports = ingested.fates.iter().zip(&spec.images);
    reports
        .map(|(fate, input)| match fate {
            Fate::Unreadable(code, detail) => ImageReport {
                reason: Some(UnplacedReason::Undecodable),
                detail: Some(format!("{code}: {detail}")),
                ..empty(&input.name)
            },
            Fate::DuplicateOf(first) => ImageReport {
                registered: is_placed(&ingested.fates[*first], map),
                detail: Some("same bytes as another image".to_owned()),
                duplicate_of: Some(spec.images[*first].name.clone()),
                ..empty(&input.name)
            },
            Fate::Usable(i) => {
                let photo = &ingested.usable[*i].photo;
                let id = ImageId(*i as u32);
                let image = map.and_then(|map| map.model.images.get(&id));
                let reason = unplaced.get(&id).copied().or(error.and_then(reason_of_failure));
                let reason = reason.map(|reason| match reason {
                    UnplacedReason::TooFewFeatures if photo.is_blurred() => UnplacedReason::Blurred,
                    other => other,
                });
                let (num_observations, reprojection_px) =
                    image.zip(map).map_or((0, None), |(image, map)| support(image, map));
                ImageReport {
                    registered: image.is_some(),
                    reason: reason.filter(|_| image.is_none()),
                    num_features: photo.features.len(),
                    num_observations,
                    reprojection_px,
                    ..empty(&input.name)
                }
            }
        })
        .collect()
}

/// Whether an input that takes part has a pose.
fn is_placed(fate: &Fate, map: Option<&EnvironmentMap>) -> bool {
    let Fate::Usable(i) = fate else { return false };
    map.is_some_and(|map| map.model.images.contains_key(&ImageId(*i as u32)))
}

/// Number of points an image sees, and the mean of their errors, pixels.
fn support(image: &RegisteredImage, map: &EnvironmentMap) -> (usize, Option<f64>) {
    let errors: Vec<f64> = image
        .points
        .iter()
        .flatten()
        .filter_map(|id| map.model.points.get(id).map(|point| point.error_px))
        .collect();
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    (errors.len(), (!errors.is_empty()).then_some(mean))
}

fn camera_reports(trace: &Trace, map: Option<&EnvironmentMap>) -> Vec<CameraReport> {
    let Some(cameras) = &trace.cameras else { return Vec::new() };
    let reports = cameras.cameras.iter().zip(&cameras.sources).enumerate();
    reports
        .map(|(i, (start, source))| {
            let id = volery_scene::CameraId(i as u32);
            let end = map.and_then(|map| map.model.cameras.get(&id)).unwrap_or(&start.camera);
            CameraReport {
                source: *source,
                initial_focal_px: start.camera.mean_focal(),
                camera: end.into(),
                num_images: cameras.of_photo.iter().filter(|of| **of == id).count(),
            }
        })
        .collect()
}

fn input_warnings(spec: &JobSpec, trace: &Trace) -> Vec<Warning> {
    let Some(ingested) = &trace.ingested else { return Vec::new() };
    let mut warnings = Vec::new();
    let names = |wanted: &dyn Fn(&Fate) -> bool| -> Vec<&str> {
        let fates = ingested.fates.iter().zip(&spec.images);
        fates.filter(|(f, _)| wanted(f)).map(|(_, image)| image.name.as_str()).collect()
    };
    let mut warn = |code: &str, what: &str, names: &[&str], hint: &str| {
        if !names.is_empty() {
            warnings.push(Warning {
                code: code.to_owned(),
                detail: format!("{} {what}: {}", names.len(), shortened(names)),
                hint: Some(hint.to_owned()),
            });
        }
    };
    let unreadable = names(&|fate| matches!(fate, Fate::Unreadable(..)));
    warn("undecodable_images", "images could not be decoded", &unreadable, "export them again");
    let repeated = names(&|fate| matches!(fate, Fate::DuplicateOf(_)));
    warn(
        "duplicate_images",
        "images repeat another one",
        &repeated,
        "each has the pose of the one it repeats",
    );
    let odd: Vec<&str> = ingested
        .usable
        .iter()
        .filter(|usable| !usable.photo.hint.warnings.is_empty())
        .map(|usable| spec.images[usable.input].name.as_str())
        .collect();
    if let Some(first) = ingested.usable.iter().find_map(|u| u.photo.hint.warnings.first()) {
        warn("odd_exif", &format!("images have odd EXIF ({first})"), &odd, "it was ignored");
    }
    let blurred: Vec<&str> = ingested
        .usable
        .iter()
        .filter(|usable| usable.photo.is_blurred())
        .map(|usable| spec.images[usable.input].name.as_str())
        .collect();
    warn("blurred_images", "images are blurred", &blurred, "stop before each photo");
    warnings
}

fn shortened(names: &[&str]) -> String {
    const SHOWN: usize = 5;
    let shown = names.iter().take(SHOWN).copied().collect::<Vec<_>>().join(", ");
    if names.len() > SHOWN { format!("{shown}, ...") } else { shown }
}

fn advice(quality: &Quality, images: &[ImageReport]) -> Vec<String> {
    let mut codes: Vec<&str> = quality.reasons.iter().map(|r| r.code.as_str()).collect();
    codes.extend(images.iter().filter_map(|image| image.reason).filter_map(
        |reason| match reason {
            UnplacedReason::NoOverlap | UnplacedReason::OtherZone => Some(code::NO_OVERLAP),
            UnplacedReason::NoParallax => Some(code::NO_PARALLAX),
            _ => None,
        },
    ));
    let mut advice: Vec<String> = Vec::new();
    for text in codes.into_iter().map(advice_for) {
        if !advice.iter().any(|known| known == text) {
            advice.push(text.to_owned());
        }
    }
    advice
}
