//! `volery demo`: a synthetic hall is scanned, mapped by the service, and localized against; the
//! result is compared with the truth.

mod page;
mod score;

use std::{fs, path::Path, time::Instant};

use rayon::prelude::*;
use volery_api::{CreateJob, Job, LocalizeAnswer, LocalizeStatus, Role};
use volery_client::{Client, LocalizeQuery};
use volery_formats::{NamedPose, read_ply_of_mesh, read_poses_csv};
use volery_pipeline::{CameraSpec, PipelineError, error::code};
use volery_scene::TriangleMesh;
use volery_server::{Config, start};
use volery_synthetic::{DemoHall, Photo, Shot};

use crate::{
    args::DemoArgs,
    input,
    output::{Ending, Outcome, print_json},
    remote::{failed, watch},
    serve::{own_program, runtime},
    wire::{wire_camera, wire_priors},
};
use score::{QueryScore, Score};

/// The painted surface, beside the report.
const GLB_FILE: &str = "map.glb";

/// What the demo has measured, for the page and for `--json`.
#[derive(Debug, serde::Serialize)]
pub(crate) struct DemoReport {
    pub(crate) score: Score,
    pub(crate) queries: Vec<QueryScore>,
    pub(crate) job: Job,
    pub(crate) map: serde_json::Value,
    pub(crate) seconds: Vec<(&'static str, f64)>,
}

pub(crate) fn run(args: &DemoArgs, json: bool) -> Outcome {
    let out = &args.out;
    let mut seconds = Vec::new();
    let mut lap = Instant::now();
    let mut done = |what: &'static str| {
        let spent = lap.elapsed().as_secs_f64();
        eprintln!("{what}: {spent:.1} s");
        lap = Instant::now();
        seconds.push((what, spent));
    };

    for name in ["data", "scan", "query"] {
        renew(&out.join(name))?;
    }
    let hall = DemoHall::new(args.seed);
    take_photos(&hall, &hall.scan, &out.join("scan"))?;
    take_photos(&hall, &hall.queries, &out.join("query"))?;
    done("rendering");

    let runtime = runtime()?;
    let report = runtime.block_on(async {
        let config = Config {
            listen: ([127, 0, 0, 1], 0).into(),
            ..Config::new(out.join("data"), own_program()?)
        };
        let server =
            start(config).await.map_err(|e| PipelineError::plain("serve", e.to_string()))?;
        let admin = Client::new(&server.url(), server.admin_token.as_deref()).map_err(failed)?;
        let token = admin.create_token("demo", Role::Mapper, Some(3600)).await.map_err(failed)?;
        let client = Client::new(&server.url(), Some(&token.secret)).map_err(failed)?;
        eprintln!("ground station at {}", server.url());

        let job = reconstruct(&client, &hall, out, &mut done).await?;
        let outputs = job.outputs.clone().ok_or_else(|| no_map(&job))?;
        let poses = client.export(outputs.map_id, "poses.csv", None).await.map_err(failed)?;
        let poses = read_poses_csv(&poses)
            .map_err(|e| PipelineError::plain("protocol", format!("poses.csv: {e}")))?;
        let mesh = client.export(outputs.map_id, "mesh.ply", None).await.map_err(failed)?;
        let mesh = read_ply_of_mesh(&mesh)
            .map_err(|e| PipelineError::plain("protocol", format!("mesh.ply: {e}")))?;
        let glb = client.export(outputs.map_id, "map.glb", None).await.map_err(failed)?;
        let path = out.join(GLB_FILE);
        fs::write(&path, glb).map_err(|e| PipelineError::io(&path, &e))?;
        let map = client.map(outputs.map_id).await.map_err(failed)?.active.info;
        let mut answers = Vec::new();
        for shot in &hall.queries {
            let image = input::read(&out.join("query").join(&shot.name))?;
            let camera = Some(wire_camera(&CameraSpec::from(hall.camera())));
            let query = LocalizeQuery { image, camera, ..LocalizeQuery::default() };
            answers.push(client.localize(outputs.map_id, &query).await.map_err(failed)?);
        }
        done("localization");
        server.stop().await;
        report(&hall, &poses, &mesh, &answers, job, map)
    })?;
    let report = DemoReport { seconds, ..report };
    let page = page::page(&hall, &report);
    let path = out.join("report.html");
    fs::write(&path, page).map_err(|e| PipelineError::io(&path, &e))?;
    if json {
        print_json(&report);
    } else {
        print_text(&report, &path);
    }
    Ok(if report.score.is_as_promised() { Ending::Done } else { Ending::Partial })
}

/// An empty folder; what an earlier demo left there is removed.
fn renew(folder: &Path) -> Result<(), PipelineError> {
    if folder.exists() {
        fs::remove_dir_all(folder).map_err(|e| PipelineError::io(folder, &e))?;
    }
    fs::create_dir_all(folder).map_err(|e| PipelineError::io(folder, &e))
}

fn take_photos(hall: &DemoHall, shots: &[Shot], folder: &Path) -> Result<(), PipelineError> {
    shots.par_iter().try_for_each(|shot| {
        let path = folder.join(&shot.name);
        save(&hall.photo(shot), &path)
            .map_err(|e| PipelineError::plain(code::IO, format!("{}: {e}", path.display())))
    })
}

fn save(photo: &Photo, path: &Path) -> image::ImageResult<()> {
    let pixels: Vec<u8> = photo.rgb.iter().flatten().copied().collect();
    image::save_buffer(path, &pixels, photo.width, photo.height, image::ColorType::Rgb8)
}

async fn reconstruct(
    client: &Client,
    hall: &DemoHall,
    out: &Path,
    done: &mut impl FnMut(&'static str),
) -> Result<Job, PipelineError> {
    let camera = wire_camera(&CameraSpec::from(hall.camera()));
    let camera = client.create_camera("demo", camera).await.map_err(failed)?;
    let set = client.create_imageset("demo scan", Some(camera.id)).await.map_err(failed)?;
    let folder = out.join("scan");
    let files: Vec<_> =
        hall.scan.iter().map(|shot| folder.join(&shot.name).as_path().into()).collect();
    client.upload_files(set.id, &files, |_, _| {}).await.map_err(failed)?;
    let priors = wire_priors(hall.scan.iter().map(|shot| (shot.name.as_str(), &shot.prior)));
    client.put_priors(set.id, priors).await.map_err(failed)?;
    done("upload");
    let request = CreateJob {
        imageset_ids: vec![set.id],
        map_name: Some("demo hall".to_owned()),
        ..CreateJob::default()
    };
    let job = client.create_job(&request).await.map_err(failed)?;
    let job = watch(client, job.id).await?;
    done("reconstruction");
    Ok(job)
}

fn report(
    hall: &DemoHall,
    poses: &[NamedPose],
    mesh: &TriangleMesh,
    answers: &[LocalizeAnswer],
    job: Job,
    map: serde_json::Value,
) -> Result<DemoReport, PipelineError> {
    let (score, world_from_map) = score::map(hall, poses)
        .ok_or_else(|| PipelineError::plain(code::NO_MODEL, "the map cannot be compared"))?;
    let queries: Vec<QueryScore> = hall
        .queries
        .iter()
        .zip(answers)
        .map(|(shot, answer)| score::query(shot, answer, &world_from_map))
        .collect();
    let score = score.with_queries(&queries).with_mesh(mesh, hall, &world_from_map);
    Ok(DemoReport { score, queries, job, map, seconds: Vec::new() })
}

fn no_map(job: &Job) -> PipelineError {
    let error = job.error.clone().unwrap_or_default();
    PipelineError { code: error.code, detail: error.detail, hint: error.hint }
}

fn print_text(report: &DemoReport, page: &Path) {
    let score = &report.score;
    println!(
        "map       {} of {} photos, verdict {}",
        score.num_registered,
        score.num_scan,
        report.map["quality"]["verdict"].as_str().unwrap_or("?")
    );
    println!(
        "          position error {:.1} mm rms, rotation error {:.3} deg median",
        score.ate_m * 1e3,
        score.rotation_deg
    );
    println!(
        "          scale error {:.2} %, gravity error {:.2} deg",
        score.scale_error * 100.0,
        score.gravity_deg
    );
    println!(
        "mesh      {} triangles, median {:.1} mm from the true surfaces: {GLB_FILE}",
        score.num_triangles,
        score.mesh_m * 1e3
    );
    println!(
        "queries   {} of {} placed, median {:.1} mm, {:.3} deg",
        score.num_localized,
        score.num_queries,
        score.query_m * 1e3,
        score.query_deg
    );
    for query in &report.queries {
        match (query.status, query.error_m, query.error_deg) {
            (LocalizeStatus::Ok, Some(m), Some(deg)) => println!(
                "          {}  {:6.1} mm  {deg:.3} deg  {} inliers  {:.0} ms",
                query.name,
                m * 1e3,
                query.num_inliers,
                query.total_ms
            ),
            _ => println!(
                "          {}  not placed: {}",
                query.name,
                query.reason.as_deref().unwrap_or("?")
            ),
        }
    }
    println!("report    {}", page.display());
}
