//! What a child is told.

use std::{collections::HashSet, path::Path};

use volery_api::{
    CreateJob, Image, JobKind,
    worker::{CACHE_FOLDER, JOB_FILE, JobImage, JobMap, JobSpec},
};

use super::progress::stages_from;
use crate::{
    error::{ApiError, ApiResult, Code},
    state::App,
    store::{JobRow, Lease, blobs::write_whole},
};

/// Fills the work folder of a job. The same request over the same image sets and maps gives the
/// same file.
pub(super) async fn prepare(app: &App, job: &JobRow, lease: Lease) -> ApiResult<()> {
    let spec = spec(app, &job.request).await?;
    let text = serde_json::to_vec_pretty(&spec)?;
    let folder = app.job_folder(job.id);
    let anew: Vec<_> =
        job.from_stage.as_deref().and_then(stages_from).into_iter().flatten().collect();
    tokio::task::spawn_blocking(move || {
        std::fs::create_dir_all(&folder)?;
        for stage in anew {
            forget(&folder.join(CACHE_FOLDER).join(stage))?;
        }
        write_whole(&folder.join(JOB_FILE), &text)
    })
    .await??;
    if job.from_stage.is_some() {
        // A lost lease shows at the next beat.
        let _ = app.store.stages_forgotten(lease).await?;
    }
    Ok(())
}

/// Deletes a folder that may not be there.
fn forget(folder: &Path) -> std::io::Result<()> {
    match std::fs::remove_dir_all(folder) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}

async fn spec(app: &App, request: &CreateJob) -> ApiResult<JobSpec> {
    let mut images = Vec::new();
    let mut names = HashSet::new();
    for (index, &id) in request.imageset_ids.iter().enumerate() {
        let set = app.store.imageset(id).await?;
        let camera = match set.camera_id {
            Some(camera) => Some(app.store.camera(camera).await?.camera),
            None => None,
        };
        for image in in_capture_order(app.store.images_by_name(id).await?) {
            let mut name = image.name;
            if !names.insert(name.clone()) {
                name = format!("{}/{name}", index + 1);
                names.insert(name.clone());
            }
            images.push(JobImage {
                name,
                path: app.blobs.path(&image.sha256).display().to_string(),
                camera: camera.clone(),
                camera_group: Some(id.to_string()),
                prior: image.prior.unwrap_or_default(),
            });
        }
    }
    if images.is_empty() && request.kind != JobKind::RegisterMaps {
        return Err(ApiError::new(
            Code::Unprocessable("no_images"),
            "the image sets hold no images",
        ));
    }
    Ok(JobSpec {
        kind: request.kind,
        maps: maps(app, request).await?,
        registration: request.registration,
        images,
        camera: request.camera.clone(),
        known_distances: request.known_distances.clone(),
        preset: request.preset,
        seed: request.seed,
        origin: request.origin,
        poses: request.poses,
        options: request.options,
        stages: request.stages.clone(),
    })
}

/// The maps that are joined with each other or with the photos, in their active versions.
async fn maps(app: &App, request: &CreateJob) -> ApiResult<Vec<JobMap>> {
    let extended = request.map_id.filter(|_| request.kind == JobKind::ExtendMap);
    let mut maps = Vec::new();
    for id in request.map_ids.iter().copied().chain(extended) {
        let map = app.store.map(id).await?;
        let folder = app.map_folder(&map.active).await?;
        let photos = app.store.photos_of_map(id).await?;
        let photos = photos.iter().map(|sha256| app.blobs.path(sha256).display().to_string());
        let path = folder.display().to_string();
        maps.push(JobMap { name: map.name, path, photos: photos.collect() });
    }
    Ok(maps)
}

/// By time if every image has one, else by name, which they come in.
fn in_capture_order(mut images: Vec<Image>) -> Vec<Image> {
    let time = |image: &Image| image.prior.as_ref().and_then(|prior| prior.time_s);
    if images.iter().all(|image| time(image).is_some()) {
        images.sort_by(|a, b| time(a).partial_cmp(&time(b)).unwrap_or(std::cmp::Ordering::Equal));
    } else if images.iter().all(|image| image.capture_time_ns.is_some()) {
        images.sort_by_key(|image| image.capture_time_ns);
    }
    images
}
