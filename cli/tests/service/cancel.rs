//! A job is cancelled in every stage, one after the other, and tried again each time.

use std::{collections::BTreeSet, fs};

use uuid::Uuid;
use volery_api::{Job, JobState};
use volery_client::Client;

use crate::server::{Scanned, glance_until, mapped, submit};

const STAGES: [&str; 6] = ["features", "pairs", "matching", "mapping", "align", "export"];

/// Tries to be fast enough for the stages that take a moment only.
const MAX_TRIES: usize = 8;

/// Ids of the processes that `parent` has started to run jobs.
fn workers_of(parent: u32) -> Vec<u32> {
    let processes = fs::read_dir("/proc").unwrap().flatten();
    let ids = processes.filter_map(|entry| entry.file_name().to_str()?.parse::<u32>().ok());
    ids.filter(|id| {
        let command = fs::read_to_string(format!("/proc/{id}/cmdline")).unwrap_or_default();
        let status = fs::read_to_string(format!("/proc/{id}/status")).unwrap_or_default();
        command.contains("run-job") && status.contains(&format!("PPid:\t{parent}\n"))
    })
    .collect()
}

/// Cancels a job as soon as it is in `stage`; answers the stage it was in then. `None` if it had
/// ended before.
async fn cancel_in(client: &Client, job: Uuid, stage: &str) -> Option<String> {
    let reached =
        |job: &Job| job.stage.as_ref().is_some_and(|now| position(now) >= position(stage));
    glance_until(client, job, reached).await;
    match client.cancel_job(job).await {
        Ok(job) => Some(job.stage.expect("it was seen in a stage")),
        Err(error) if error.code() == "job_finished" => None,
        Err(error) => panic!("{error}"),
    }
}

fn position(stage: &str) -> usize {
    STAGES.iter().position(|known| *known == stage).expect("a known stage")
}

#[test]
fn a_job_cancelled_in_every_stage_leaves_nothing_and_can_be_tried_again() {
    let runtime = tokio::runtime::Runtime::new().unwrap();
    runtime.block_on(async {
        let Scanned { server, client, set, .. } = &Scanned::new("cancel").await;
        let mut job = submit(client, *set).await.id;
        let mut hits = BTreeSet::new();
        for stage in STAGES {
            for _ in 0..MAX_TRIES {
                let Some(hit) = cancel_in(client, job, stage).await else {
                    job = submit(client, *set).await.id;
                    continue;
                };
                let ended = glance_until(client, job, |_| false).await;
                assert_eq!(ended.state, JobState::Cancelled, "asked in {hit}: {ended:?}");
                assert_eq!(ended.outputs, None, "cancelled in {hit}");
                assert_eq!(workers_of(server.id()), [0; 0], "cancelled in {hit}");
                let is_hit = hit == stage;
                hits.insert(hit);
                client.retry_job(job, None).await.unwrap();
                if is_hit {
                    break;
                }
            }
        }
        println!("cancelled in {hits:?}");
        // The choice of pairs of so few photos takes less time than a request.
        for stage in STAGES.iter().filter(|stage| **stage != "pairs") {
            assert!(hits.contains(*stage), "never cancelled in {stage}");
        }
        let maps_before = client.maps().await.unwrap();
        let job = mapped(client, job).await;
        assert_eq!(client.maps().await.unwrap().len(), maps_before.len() + 1);
        assert_eq!(job.outputs.unwrap().version, 1, "the cancelled runs made no version");
    });
}
