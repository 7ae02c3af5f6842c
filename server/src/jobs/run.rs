//! The loop that claims jobs and brings them to an end.

use std::{
    path::{Component, Path, PathBuf},
    sync::Arc,
    time::Duration,
};

use sha2::{Digest, Sha256};
use tokio_util::task::TaskTracker;
use uuid::Uuid;
use volery_api::{
    JobError, JobState,
    worker::{JobResult, OUT_FOLDER},
};

use super::{
    child::{Ended, run_child},
    heart::{Beat, Heart},
    spec::prepare,
};
use crate::{
    error::{ApiError, ApiResult, Code},
    metrics::add,
    state::App,
    store::{Finish, JobRow, Lease, NewVersion},
};

/// Time between looks for jobs whose turn has come without anyone calling.
const POLL: Duration = Duration::from_secs(1);

/// Codes of failures that a full disk may be the cause of.
const FOR_WANT_OF_SPACE: [&str; 3] = ["disk_full", "io", "worker_crashed"];

/// Runs jobs until the service closes down.
pub(crate) async fn run_jobs(app: Arc<App>) {
    let loops = TaskTracker::new();
    for _ in 0..app.config.jobs.parallel {
        loops.spawn(claim_and_run(Arc::clone(&app)));
    }
    loops.close();
    loops.wait().await;
}

async fn claim_and_run(app: Arc<App>) {
    let lease_ms = app.config.jobs.lease.as_millis() as i64;
    let mut had_space = true;
    while !app.closing.is_cancelled() {
        let space = has_space(&app).await;
        if had_space && !space {
            tracing::error!("the disk is full: jobs wait until there is space");
        }
        had_space = space;
        let claimed = if space { claim(&app, lease_ms).await } else { None };
        match claimed {
            Some(job) => run(&app, &job).await,
            None => {
                // Logged where it failed; the next round tries again.
                let _ = app.store.fail_lost_jobs().await;
                tokio::select! {
                    () = app.job_queued.notified() => {}
                    () = tokio::time::sleep(POLL) => {}
                    () = app.closing.cancelled() => {}
                }
            }
        }
    }
}

async fn claim(app: &App, lease_ms: i64) -> Option<JobRow> {
    let claimed = app.store.claim_job(app.instance, lease_ms).await;
    claimed.unwrap_or_else(|error| {
        tracing::warn!(error = %error.detail, "cannot claim a job");
        None
    })
}

async fn has_space(app: &Arc<App>) -> bool {
    app.with_blobs(|blobs| blobs.check_space(0)).await.is_ok()
}

async fn run(app: &Arc<App>, job: &JobRow) {
    let lease = Lease { job: job.id, token: job.lease_token };
    let mut heart = Heart::start(Arc::clone(app), lease);
    tracing::info!(job = %job.id, attempt = job.attempt, "job {} runs", job.id);
    let finish = match work(app, job, lease, &mut heart).await {
        Ok(Some(finish)) => finish,
        Ok(None) => {
            tracing::warn!(job = %job.id, "the lease on job {} was lost", job.id);
            return;
        }
        Err(error) => again_or_failed(app, job, to_job_error(&error)),
    };
    let finish = unless_disk_is_full(app, finish).await;
    match app.store.finish_job(lease, finish).await {
        Ok(Ok(JobState::Succeeded)) if !app.config.jobs.keep_work_folders => {
            if let Err(error) = tokio::fs::remove_dir_all(app.job_folder(job.id)).await {
                tracing::warn!(job = %job.id, %error, "cannot delete a work folder");
            }
        }
        Ok(Ok(_)) => {}
        Ok(Err(_lost)) => tracing::warn!(job = %job.id, "the lease on job {} was lost", job.id),
        // The lease will lapse, and the job will run again.
        Err(error) => tracing::error!(job = %job.id, error = %error.detail, "cannot end a job"),
    }
}

/// How a run ended; `None` when the job is no longer ours.
async fn work(
    app: &Arc<App>,
    job: &JobRow,
    lease: Lease,
    heart: &mut Heart,
) -> ApiResult<Option<Finish>> {
    match prepare(app, job, lease).await {
        Ok(()) => {}
        Err(error) if matches!(error.code, Code::Unprocessable(_) | Code::NotFound) => {
            return Ok(Some(Finish::Failed(to_job_error(&error))));
        }
        Err(error) => return Err(error),
    }
    Ok(Some(match run_child(app, job, lease, heart).await? {
        Ended::LeaseLost => return Ok(None),
        Ended::Closing => Finish::Interrupted(None),
        Ended::Stopped => Finish::Cancelled,
        Ended::Said(result) if result.ok => publish(app, job, result).await?,
        Ended::Said(JobResult { code, detail, hint, .. }) => {
            let code = code.unwrap_or_else(|| "failed".to_owned());
            if code == "cancelled" && *heart.beat.borrow() == Beat::Cancel {
                Finish::Cancelled
            } else {
                Finish::Failed(JobError { code, detail: detail.unwrap_or_default(), hint })
            }
        }
        Ended::TimedOut => {
            let error = JobError {
                code: "job_timeout".to_owned(),
                detail: format!("it ran longer than {:?}", app.config.jobs.timeout),
                hint: Some("use fewer photos or the preset `fast`".to_owned()),
            };
            rescued(app, job, error).await?
        }
        Ended::Crashed { detail } => {
            add(&app.metrics.worker_deaths, 1);
            let error = JobError { code: "worker_crashed".to_owned(), detail, hint: None };
            match again_or_failed(app, job, error) {
                Finish::Failed(error) => rescued(app, job, error).await?,
                again => again,
            }
        }
    }))
}

/// The end of a job that will not run again: with the sparse map, if that was whole before the
/// failure, else without any.
async fn rescued(app: &Arc<App>, job: &JobRow, error: JobError) -> ApiResult<Finish> {
    let marker = app.job_folder(job.id).join(OUT_FOLDER).join("map.json");
    if !tokio::fs::try_exists(marker).await? {
        return Ok(Finish::Failed(error));
    }
    let JobError { code, detail, hint } = error;
    let result = JobResult {
        ok: true,
        state: Some("partial".to_owned()),
        code: Some(code),
        detail: Some(detail),
        hint,
        map: None,
        warnings: Vec::new(),
    };
    publish(app, job, result).await
}

fn again_or_failed(app: &App, job: &JobRow, error: JobError) -> Finish {
    if job.attempt >= job.max_attempts {
        return Finish::Failed(error);
    }
    let backoff = &app.config.jobs.backoff;
    let wait = backoff.get(job.attempt.saturating_sub(1) as usize).or(backoff.last());
    Finish::Retry { error, delay_ms: wait.map_or(0, |wait| wait.as_millis() as i64) }
}

/// A failure on a full disk does not count: the job goes on when there is space.
async fn unless_disk_is_full(app: &Arc<App>, finish: Finish) -> Finish {
    match &finish {
        Finish::Failed(error) | Finish::Retry { error, .. }
            if FOR_WANT_OF_SPACE.contains(&error.code.as_str()) && !has_space(app).await =>
        {
            Finish::Interrupted(Some(JobError {
                code: "disk_full".to_owned(),
                detail: error.detail.clone(),
                hint: Some("free some space: the job goes on by itself".to_owned()),
            }))
        }
        _ => finish,
    }
}

fn to_job_error(error: &ApiError) -> JobError {
    JobError {
        code: error.code().to_owned(),
        detail: error.detail.clone(),
        hint: error.hint.clone(),
    }
}

/// Keeps the map folder; it becomes visible when the job ends.
async fn publish(app: &Arc<App>, job: &JobRow, result: JobResult) -> ApiResult<Finish> {
    let folder = inside(&app.job_folder(job.id), result.map.as_deref().unwrap_or(OUT_FOLDER))
        .ok_or_else(|| ApiError::internal("the worker named a map outside of its folder"))?;
    let info = match tokio::fs::read(folder.join("map.json")).await {
        Ok(text) => serde_json::from_slice(&text)?,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => serde_json::json!({}),
        Err(error) => return Err(error.into()),
    };
    let files = app.with_blobs(move |blobs| blobs.put_folder(&folder)).await?;
    let state = match result.state.as_deref() {
        Some("partial") => JobState::Partial,
        _ => JobState::Succeeded,
    };
    let name = match &job.request.map_name {
        Some(name) => name.clone(),
        None => match job.request.imageset_ids.first() {
            Some(&set) => app.store.imageset(set).await.map_or("map".to_owned(), |set| set.name),
            None => "map".to_owned(),
        },
    };
    let version = NewVersion {
        map_id: job.request.map_id.unwrap_or_else(|| map_of(job.id)),
        name,
        job_id: Some(job.id),
        parent_version: None,
        info,
        residuals: None,
        files,
        activate: state == JobState::Succeeded,
        request: None,
    };
    let error = result.code.map(|code| JobError {
        code,
        detail: result.detail.unwrap_or_default(),
        hint: result.hint,
    });
    let warnings = result.warnings;
    Ok(Finish::Map { state, version: Box::new(version), error, warnings })
}

/// The map of a job that names none: the same for every run, so that a retry adds a version.
fn map_of(job: Uuid) -> Uuid {
    let mut hash = Sha256::new();
    hash.update(b"map of job ");
    hash.update(job.as_bytes());
    let mut bytes = [0; 16];
    bytes.copy_from_slice(&hash.finalize()[..16]);
    uuid::Builder::from_custom_bytes(bytes).into_uuid()
}

/// A folder below `root`; `None` when the name leads out of it.
fn inside(root: &Path, name: &str) -> Option<PathBuf> {
    let plain = Path::new(name).components().all(|part| matches!(part, Component::Normal(_)));
    (plain && !name.is_empty()).then(|| root.join(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_map_folder_lies_in_its_work_folder() {
        let root = Path::new("/data/jobs/1");
        assert_eq!(inside(root, "out"), Some(root.join("out")));
        for bad in ["", "/etc", "../2/out", "out/../../2"] {
            assert_eq!(inside(root, bad), None, "{bad}");
        }
    }
}
