//! Commands that talk to a server through the client SDK.

use std::{fs, path::Path};

use serde::Serialize;
use uuid::Uuid;
use volery_api::{
    CreateJob, Job, JobEvent, JobKind, JobState, KnownDistance, LocalizePrior, PositionPrior,
    RegisterMaps, YawPrior,
};
use volery_client::{Client, ClientError, LocalizeQuery};
use volery_pipeline::{NorthInMap, PipelineError};

use crate::{
    args::{JobsCommand, LocalizeArgs, MapsCommand, ServerArgs},
    input,
    localize::Answers,
    output::{Ending, Outcome, print_json},
    progress::Counter,
    serve::runtime,
};

/// A failure of the SDK as one of the command line.
pub(crate) fn failed(error: ClientError) -> PipelineError {
    PipelineError {
        code: error.code().to_owned(),
        detail: error.to_string(),
        hint: error.hint().map(str::to_owned),
    }
}

pub(crate) fn with_server(
    server: &ServerArgs,
    work: impl AsyncFnOnce(Client) -> Outcome,
) -> Outcome {
    let client = Client::new(&server.server, server.token.as_deref()).map_err(failed)?;
    runtime()?.block_on(work(client))
}

/// Prints a value of the API: JSON, or a line of text.
fn show<T: Serialize>(value: &T, json: bool, line: impl FnOnce(&T) -> String) {
    if json { print_json(value) } else { println!("{}", line(value)) }
}

pub(crate) fn jobs(server: &ServerArgs, command: Option<&JobsCommand>, json: bool) -> Outcome {
    with_server(server, async |client| {
        let job = match command {
            None => {
                let jobs = client.jobs(None).await.map_err(failed)?;
                let lines =
                    |jobs: &Vec<Job>| jobs.iter().map(job_line).collect::<Vec<_>>().join("\n");
                show(&jobs, json, lines);
                return Ok(Ending::Done);
            }
            Some(JobsCommand::Log { id }) => {
                show(&client.job_log(*id).await.map_err(failed)?, json, |log| {
                    log.trim_end().to_owned()
                });
                return Ok(Ending::Done);
            }
            Some(JobsCommand::Submit {
                imagesets,
                map,
                name,
                effort,
                seed,
                known_distance,
                wait,
            }) => {
                let known = known_distance.iter().map(|d| KnownDistance {
                    image_a: d.image_a.clone(),
                    image_b: d.image_b.clone(),
                    meters: d.meters,
                });
                let request = CreateJob {
                    imageset_ids: imagesets.clone(),
                    map_id: *map,
                    map_name: name.clone(),
                    preset: effort.preset(),
                    stages: effort.stages(),
                    options: effort.options(),
                    seed: *seed,
                    known_distances: known.collect(),
                    ..CreateJob::default()
                };
                let job = client.create_job(&request).await.map_err(failed)?;
                if *wait { watch(&client, job.id).await? } else { job }
            }
            Some(JobsCommand::Show { id }) => client.job(*id).await.map_err(failed)?,
            Some(JobsCommand::Watch { id }) => watch(&client, *id).await?,
            Some(JobsCommand::Cancel { id }) => client.cancel_job(*id).await.map_err(failed)?,
            Some(JobsCommand::Retry { id, from_stage }) => {
                client.retry_job(*id, from_stage.as_deref()).await.map_err(failed)?
            }
        };
        show(&job, json, job_line);
        match command {
            Some(JobsCommand::Submit { wait: true, .. } | JobsCommand::Watch { .. }) => {
                ending_of(&job)
            }
            _ => Ok(Ending::Done),
        }
    })
}

pub(crate) fn maps(server: &ServerArgs, command: Option<&MapsCommand>, json: bool) -> Outcome {
    with_server(server, async |client| {
        match command {
            None => {
                let maps = client.maps().await.map_err(failed)?;
                show(&maps, json, |maps| {
                    let line = |m: &volery_api::Map| {
                        format!("{} version {} {}", m.id, m.active_version, m.name)
                    };
                    maps.iter().map(line).collect::<Vec<_>>().join("\n")
                });
            }
            Some(MapsCommand::Show { id }) => {
                let map = client.map(*id).await.map_err(failed)?;
                show(&map, json, |map| {
                    format!(
                        "{} {}, version {}: {:#}",
                        map.id, map.name, map.active_version, map.active.info
                    )
                });
            }
            Some(MapsCommand::Versions { id }) => {
                let versions = client.map_versions(*id).await.map_err(failed)?;
                show(&versions, json, |all| {
                    let line = |v: &volery_api::MapVersion| format!("{} {}", v.version, v.created);
                    all.iter().map(line).collect::<Vec<_>>().join("\n")
                });
            }
            Some(MapsCommand::Activate { id, version }) => {
                let map = client.activate_version(*id, *version).await.map_err(failed)?;
                show(&map, json, |map| format!("{} answers with version {version}", map.id));
            }
            Some(MapsCommand::Delete { id }) => {
                client.delete_map(*id).await.map_err(failed)?;
                show(&serde_json::json!({ "deleted": id }), json, |_| format!("{id} is gone"));
            }
            Some(MapsCommand::Register { ids, method, same_scale, effort, map, name, wait }) => {
                let request = RegisterMaps {
                    maps: ids.clone(),
                    method: (*method).into(),
                    with_scale: !same_scale,
                    preset: effort.preset(),
                    stages: effort.stages(),
                    options: effort.options(),
                    map_id: *map,
                    map_name: name.clone(),
                    ..RegisterMaps::default()
                };
                let job = client.register_maps(&request).await.map_err(failed)?;
                return show_job(&client, job, *wait, json).await;
            }
            Some(MapsCommand::Extend { id, imagesets, effort, wait }) => {
                let request = CreateJob {
                    kind: JobKind::ExtendMap,
                    map_id: Some(*id),
                    imageset_ids: imagesets.clone(),
                    preset: effort.preset(),
                    stages: effort.stages(),
                    options: effort.options(),
                    ..CreateJob::default()
                };
                let job = client.create_job(&request).await.map_err(failed)?;
                return show_job(&client, job, *wait, json).await;
            }
        }
        Ok(Ending::Done)
    })
}

/// Tells of a job that was queued, at once or at its end.
async fn show_job(client: &Client, job: Job, wait: bool, json: bool) -> Outcome {
    let job = if wait { watch(client, job.id).await? } else { job };
    show(&job, json, job_line);
    if wait { ending_of(&job) } else { Ok(Ending::Done) }
}

pub(crate) fn export(
    server: &ServerArgs,
    map: Uuid,
    name: &str,
    version: Option<u32>,
    out: Option<&Path>,
    json: bool,
) -> Outcome {
    with_server(server, async |client| {
        let bytes = client.export(map, name, version).await.map_err(failed)?;
        let out = out.unwrap_or(Path::new(name));
        fs::write(out, &bytes).map_err(|e| PipelineError::io(out, &e))?;
        let answer = serde_json::json!({ "path": out, "bytes": bytes.len() });
        show(&answer, json, |_| format!("{}: {} bytes", out.display(), bytes.len()));
        Ok(Ending::Done)
    })
}

/// `volery localize --server`.
pub(crate) fn localize(args: &LocalizeArgs, server: String, map: Uuid, json: bool) -> Outcome {
    let files = input::photos(&args.paths)?;
    let camera = args.camera.as_deref().map(input::camera).transpose()?;
    let camera = camera.map(volery_api::Camera::from);
    let telemetry = args.telemetry.as_deref().map(input::telemetry).transpose()?;
    let server = ServerArgs { server, token: args.token.clone() };
    with_server(&server, async |client| {
        let info = match args.version {
            Some(number) => {
                let versions = client.map_versions(map).await.map_err(failed)?;
                let known = versions.into_iter().find(|version| version.version == number);
                // The server says so once it is asked about a photo.
                known.map_or(serde_json::Value::Null, |version| version.info)
            }
            None => client.map(map).await.map_err(failed)?.active.info,
        };
        let north: Option<NorthInMap> = serde_json::from_value(info["north"].clone()).ok();
        let position = args.near.map(|position| PositionPrior { position, sigma: args.near_sigma });
        let mut answers = Answers::new(files.len(), json);
        for file in &files {
            let image = input::read(&file.path)?;
            let camera = camera.clone();
            let attitude = telemetry.as_ref().and_then(|rows| rows.get(&file.name)?.attitude);
            let yaw = north.zip(attitude).map(|(north, attitude)| north.yaw_of(&attitude));
            let yaw = yaw.map(|(yaw, sigma)| YawPrior { yaw, sigma });
            let query = LocalizeQuery {
                image,
                camera,
                prior: (position.is_some() || yaw.is_some())
                    .then_some(LocalizePrior { position, yaw }),
                version: args.version,
                method: Some(args.method.into()),
            };
            let found = match client.localize(map, &query).await {
                Ok(answer) => Ok(answer.localization),
                // The photo's own fault, or a moment without a worker: the others have answers.
                Err(ClientError::Problem(problem)) if [413, 422, 503].contains(&problem.status) => {
                    Err(failed(ClientError::Problem(problem)))
                }
                Err(error) => return Err(failed(error)),
            };
            answers.add(&file.name, found);
        }
        let metric = info["scale"]["metric"] == serde_json::Value::Bool(true);
        answers.finish(args, metric)
    })
}

/// Follows a job to its end, and shows how far it is.
pub(crate) async fn watch(client: &Client, id: Uuid) -> Result<Job, PipelineError> {
    let mut counter = Counter::default();
    let job =
        client.watch_job(id, |event| show_event(&mut counter, event)).await.map_err(failed)?;
    counter.end();
    Ok(job)
}

fn show_event(counter: &mut Counter, event: &JobEvent) {
    let text = |name: &str| event.data[name].as_str().unwrap_or_default();
    let number = |name: &str| event.data[name].as_u64().unwrap_or(0);
    match event.kind.as_str() {
        "job.stage" | "job.progress" => {
            counter.show(text("stage"), number("done"), number("total"), text("unit"));
        }
        "job.log" => counter.say(&format!("{}: {}", text("level"), text("message"))),
        _ => {}
    }
}

pub(crate) fn job_line(job: &Job) -> String {
    let mut line = format!("job {} {}", job.id, job.state.name());
    if let Some(outputs) = &job.outputs {
        line += &format!(", map {} version {}", outputs.map_id, outputs.version);
    }
    if let Some(stage) = job.stage.as_ref().filter(|_| !job.state.is_final()) {
        line += &format!(", {stage} {}/{}", job.progress.done, job.progress.total);
    }
    if let Some(error) = &job.error {
        line += &format!(", {}: {}", error.code, error.detail);
    }
    line
}

/// How a command ends that has waited for a job.
pub(crate) fn ending_of(job: &Job) -> Outcome {
    match job.state {
        JobState::Succeeded => Ok(Ending::Done),
        JobState::Partial => Ok(Ending::Partial),
        state => {
            let error = job.error.clone().unwrap_or_default();
            Err(PipelineError {
                code: if error.code.is_empty() { state.name().to_owned() } else { error.code },
                detail: format!("job {} {}: {}", job.id, state.name(), error.detail),
                hint: error.hint,
            })
        }
    }
}
