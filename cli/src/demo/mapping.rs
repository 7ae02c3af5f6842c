//! The first half: photos of the hall are taken, uploaded, made into a map and localized in it.

use std::path::Path;

use nalgebra::{Isometry3, Point3};
use rayon::prelude::*;
use uuid::Uuid;
use volery_api::{CreateJob, Job};
use volery_client::{Client, LocalizeQuery};
use volery_formats::{read_ply_of_mesh, read_poses_csv};
use volery_pipeline::{CameraSpec, PipelineError, error::code, wire};
use volery_synthetic::{DemoHall, Photo, Shot};

use super::{
    Stages,
    folder::DemoFolder,
    score::{self, QueryScore, Score},
};
use crate::{
    input,
    remote::{failed, watch},
};

/// The painted surface, beside the report.
pub(super) const GLB_FILE: &str = "map.glb";

/// A map and how good it is.
pub(super) struct Mapped {
    pub(super) map_id: Uuid,
    pub(super) job: Job,
    pub(super) info: serde_json::Value,
    pub(super) score: Score,
    pub(super) queries: Vec<QueryScore>,
    /// The hall from the map, whose unit is taken as it is.
    pub(super) world_from_map: Isometry3<f64>,
    /// Middle of the scan in the map.
    pub(super) middle: Point3<f64>,
}

/// Renders the photos of the scan and the queries.
pub(super) fn take_photos(hall: &DemoHall, folder: &DemoFolder) -> Result<(), PipelineError> {
    for (name, shots) in [("scan", &hall.scan), ("query", &hall.queries)] {
        shots
            .par_iter()
            .try_for_each(|shot| save(&hall.photo(shot), &folder.join(name).join(&shot.name)))?;
    }
    Ok(())
}

/// Writes a photo as a file.
pub(crate) fn save(photo: &Photo, path: &Path) -> Result<(), PipelineError> {
    let pixels: Vec<u8> = photo.rgb.iter().flatten().copied().collect();
    image::save_buffer(path, &pixels, photo.width, photo.height, image::ColorType::Rgb8)
        .map_err(|e| PipelineError::plain(code::IO, format!("{}: {e}", path.display())))
}

/// Makes the map and asks it for the places of the queries.
pub(super) async fn map(
    client: &Client,
    hall: &DemoHall,
    folder: &DemoFolder,
    stages: &mut Stages,
) -> Result<Mapped, PipelineError> {
    let job = reconstruct(client, hall, folder, stages).await?;
    let map_id = job.outputs.as_ref().ok_or_else(|| no_map(&job))?.map_id;
    let exported = async |name| client.export(map_id, name, None).await.map_err(failed);
    let broken = |name: &str, e: &dyn std::fmt::Display| {
        PipelineError::plain("protocol", format!("{name}: {e}"))
    };
    let poses = exported("poses.csv").await?;
    let poses = read_poses_csv(&poses).map_err(|e| broken("poses.csv", &e))?;
    let mesh = exported("mesh.ply").await?;
    let mesh = read_ply_of_mesh(&mesh).map_err(|e| broken("mesh.ply", &e))?;
    folder.write(GLB_FILE, &exported("map.glb").await?)?;
    let info = client.map(map_id).await.map_err(failed)?.active.info;

    let not_comparable = || PipelineError::plain(code::NO_MODEL, "the map cannot be compared");
    let (score, world_from_map) = score::map(hall, &poses).ok_or_else(not_comparable)?;
    let mut queries = Vec::new();
    for shot in &hall.queries {
        queries.push(localize(client, map_id, hall, shot, folder, &world_from_map).await?);
    }
    stages.done("localization");
    let sum: nalgebra::Vector3<f64> =
        poses.iter().map(|pose| pose.world_from_cam.translation.vector).sum();
    Ok(Mapped {
        map_id,
        job,
        info,
        score: score.with_queries(&queries).with_mesh(&mesh, hall, &world_from_map),
        queries,
        world_from_map: score::rigid(hall, &poses).ok_or_else(not_comparable)?,
        middle: Point3::from(sum / poses.len() as f64),
    })
}

async fn localize(
    client: &Client,
    map_id: Uuid,
    hall: &DemoHall,
    shot: &Shot,
    folder: &DemoFolder,
    world_from_map: &volery_geometry::Similarity3<f64>,
) -> Result<QueryScore, PipelineError> {
    let image = input::read(&folder.join("query").join(&shot.name))?;
    let camera = Some(CameraSpec::from(hall.camera()).into());
    let query = LocalizeQuery { image, camera, ..LocalizeQuery::default() };
    let answer = client.localize(map_id, &query).await.map_err(failed)?;
    Ok(score::query(shot, &answer, world_from_map))
}

async fn reconstruct(
    client: &Client,
    hall: &DemoHall,
    folder: &DemoFolder,
    stages: &mut Stages,
) -> Result<Job, PipelineError> {
    let camera = CameraSpec::from(hall.camera()).into();
    let camera = client.create_camera("demo", camera).await.map_err(failed)?;
    let set = client.create_imageset("demo scan", Some(camera.id)).await.map_err(failed)?;
    let scan = folder.join("scan");
    let files: Vec<_> =
        hall.scan.iter().map(|shot| scan.join(&shot.name).as_path().into()).collect();
    client.upload_files(set.id, &files, |_, _| {}).await.map_err(failed)?;
    let priors =
        hall.scan.iter().map(|shot| (shot.name.clone(), wire::prior(&shot.prior))).collect();
    client.put_priors(set.id, priors).await.map_err(failed)?;
    stages.done("upload");
    let request = CreateJob {
        imageset_ids: vec![set.id],
        map_name: Some("demo hall".to_owned()),
        ..CreateJob::default()
    };
    let job = client.create_job(&request).await.map_err(failed)?;
    let job = watch(client, job.id).await?;
    stages.done("reconstruction");
    Ok(job)
}

fn no_map(job: &Job) -> PipelineError {
    let error = job.error.clone().unwrap_or_default();
    PipelineError { code: error.code, detail: error.detail, hint: error.hint }
}
