//! `volery upload`.

use std::{collections::BTreeMap, path::PathBuf};

use volery_api::{CreateJob, Prior, UploadStatus};
use volery_client::UploadFile;
use volery_pipeline::{PipelineError, wire};

use crate::{
    args::UploadArgs,
    input,
    output::{Ending, Outcome, print_json},
    progress::Counter,
    remote::{ending_of, failed, job_line, watch, with_server},
};

/// Bytes of the unit in which an archive is counted.
const MEGABYTE: u64 = 1_000_000;

/// What is known of the photos: what the flight knew, and the poses and cameras of a model.
fn priors_of(
    args: &UploadArgs,
    files: &[UploadFile],
) -> Result<BTreeMap<String, Prior>, PipelineError> {
    let mut known = input::priors(&args.flight)?;
    let mut cameras = BTreeMap::new();
    if let Some(path) = &args.given.model {
        let names = files.iter().map(|file| file.name.clone()).collect();
        for (name, (pose, camera)) in input::model(path, names)?.images {
            known.entry(name.clone()).or_default().pose = Some(pose);
            cameras.insert(name, camera.into());
        }
    }
    let mut priors: BTreeMap<String, Prior> =
        known.iter().map(|(name, prior)| (name.clone(), wire::prior(prior))).collect();
    for (name, camera) in cameras {
        priors.entry(name).or_default().camera = Some(camera);
    }
    Ok(priors)
}

pub(crate) fn run(args: &UploadArgs, json: bool) -> Outcome {
    let is_archive = |path: &&PathBuf| path.extension().is_some_and(|e| e == "zip");
    let archives: Vec<_> = args.photos.iter().filter(is_archive).cloned().collect();
    let photos: Vec<_> = args.photos.iter().filter(|p| !is_archive(p)).cloned().collect();
    let files: Vec<UploadFile> = input::photos(&photos)?
        .into_iter()
        .map(|file| UploadFile { name: file.name, path: file.path })
        .collect();
    let camera = args.camera.as_deref().map(input::camera).transpose()?;
    let priors = priors_of(args, &files)?;
    with_server(&args.server, async |client| {
        let imageset = match args.imageset {
            Some(id) => id,
            None => {
                let camera = match &camera {
                    Some(camera) => Some(
                        client
                            .create_camera(&args.name, camera.clone().into())
                            .await
                            .map_err(failed)?
                            .id,
                    ),
                    None => None,
                };
                client.create_imageset(&args.name, camera).await.map_err(failed)?.id
            }
        };
        let mut counter = Counter::default();
        let mut results = client
            .upload_files(imageset, &files, |done, _| {
                counter.show("upload", done as u64, files.len() as u64, "photos");
            })
            .await
            .map_err(failed)?;
        for archive in &archives {
            let size = archive.metadata().map_err(|e| PipelineError::io(archive, &e))?.len();
            let name = archive.file_name().unwrap_or_default().to_string_lossy();
            let report = client
                .upload_archive(imageset, archive, |safe| {
                    counter.show(&name, safe / MEGABYTE, size / MEGABYTE, "MB");
                })
                .await
                .map_err(failed)?;
            results.extend(report.results);
        }
        counter.end();
        if !priors.is_empty() {
            client.put_priors(imageset, priors.clone()).await.map_err(failed)?;
        }
        let count = |status| results.iter().filter(|r| r.status == status).count();
        let rejected = count(UploadStatus::Rejected);
        let job = if args.reconstruct {
            let request = CreateJob {
                imageset_ids: vec![imageset],
                map_name: Some(args.name.clone()),
                poses: args.given.poses(),
                ..CreateJob::default()
            };
            let job = client.create_job(&request).await.map_err(failed)?;
            Some(watch(&client, job.id).await?)
        } else {
            None
        };
        if json {
            let answer =
                serde_json::json!({ "imageset_id": imageset, "results": results, "job": job });
            print_json(&answer);
        } else {
            println!(
                "image set {imageset}: {} stored, {} known already, {rejected} rejected",
                count(UploadStatus::Stored),
                count(UploadStatus::Duplicate)
            );
            for result in results.iter().filter(|r| r.status == UploadStatus::Rejected) {
                let detail = result.detail.as_deref().unwrap_or_default();
                println!("  {}: {detail}", result.name);
            }
            if let Some(job) = &job {
                println!("{}", job_line(job));
            }
        }
        match job {
            Some(job) => ending_of(&job),
            None if rejected > 0 => Ok(Ending::Partial),
            None => Ok(Ending::Done),
        }
    })
}
