//! One run of a job in a child process.

use std::{
    process::ExitStatus,
    sync::Arc,
    time::{Duration, Instant},
};

use futures_util::StreamExt;
use tokio::{
    io::{AsyncRead, AsyncReadExt},
    process::Child,
};
use tokio_util::codec::{FramedRead, LinesCodec};
use volery_api::worker::{JobLine, JobResult};

use super::{
    heart::{Beat, Heart},
    progress::{Step, Tracker},
};
use crate::{
    clock,
    error::{ApiError, ApiResult},
    state::App,
    store::{JobRow, Lease, LeaseLost},
    workers::{command, confine, kill_group, stop_group},
};

/// Longest line of a child's output, bytes.
const MAX_LINE: usize = 1 << 20;
/// Bytes kept of the end of a child's errors.
const STDERR_TAIL: usize = 4 << 10;
/// Time between looks at progress that was held back.
const TICK: Duration = Duration::from_millis(250);

/// How a child ended.
#[derive(Debug)]
pub(super) enum Ended {
    /// It said how.
    Said(JobResult),
    /// It did not.
    Crashed { detail: String },
    /// It was asked to stop, and stopped.
    Stopped,
    /// It ran longer than any job may.
    TimedOut,
    /// The service closes down.
    Closing,
    /// The job is someone else's now.
    LeaseLost,
}

/// A child whose whole process group ends with the handle.
struct Group(Child);

impl Drop for Group {
    fn drop(&mut self) {
        kill_group(&self.0);
    }
}

/// Runs the child of a job to its end and tells its progress.
pub(super) async fn run_child(
    app: &Arc<App>,
    job: &JobRow,
    lease: Lease,
    heart: &mut Heart,
) -> ApiResult<Ended> {
    let child = command(&app.config, "run-job").arg(app.job_folder(job.id)).spawn()?;
    confine(&child, app.config.workers.job_bytes, 10);
    let mut group = Group(child);
    let (Some(stdout), Some(stderr)) = (group.0.stdout.take(), group.0.stderr.take()) else {
        return Err(ApiError::internal("the child's output is not piped"));
    };
    // The child leaves when its standard input ends.
    let _stdin = group.0.stdin.take();
    let tail = tokio::spawn(read_tail(stderr));
    let mut lines = FramedRead::new(stdout, LinesCodec::new_with_max_length(MAX_LINE));
    let tracker = Tracker::new(job.request.preset.last_stage(&job.request.stages));
    let mut teller = Teller { app, lease, tracker, said: None };
    let mut tick = tokio::time::interval(TICK);
    let deadline = tokio::time::sleep(app.config.jobs.timeout);
    let mut deadline = std::pin::pin!(deadline);
    loop {
        let told = tokio::select! {
            line = lines.next() => match line {
                Some(Ok(line)) => teller.line(&line).await?,
                // Nonsense is as good as the end.
                Some(Err(_)) | None => break,
            },
            _ = tick.tick() => teller.overdue().await?,
            changed = heart.beat.changed() => {
                let beat = *heart.beat.borrow_and_update();
                match beat {
                    _ if changed.is_err() => Err(LeaseLost),
                    Beat::Lost => Err(LeaseLost),
                    Beat::Go => Ok(()),
                    Beat::Cancel => {
                        stop(&mut group, app.config.jobs.cancel_grace).await;
                        return Ok(Ended::Stopped);
                    }
                }
            }
            () = &mut deadline => {
                stop(&mut group, app.config.jobs.cancel_grace).await;
                return Ok(Ended::TimedOut);
            }
            () = app.closing.cancelled() => {
                stop(&mut group, Duration::from_secs(2)).await;
                return Ok(Ended::Closing);
            }
        };
        if told.is_err() {
            return Ok(Ended::LeaseLost);
        }
    }
    let status = match tokio::time::timeout(Duration::from_secs(10), group.0.wait()).await {
        Ok(status) => Some(status?),
        Err(_) => None,
    };
    kill_group(&group.0);
    let tail = tail.await.unwrap_or_default();
    Ok(teller.judge(status, &tail).await?.unwrap_or(Ended::LeaseLost))
}

/// Asks a child to stop, and ends it when it does not.
async fn stop(group: &mut Group, grace: Duration) {
    stop_group(&group.0);
    if tokio::time::timeout(grace, group.0.wait()).await.is_err() {
        kill_group(&group.0);
        // Killed; this reaps it.
        let _ = group.0.wait().await;
    }
}

async fn read_tail(mut stderr: impl AsyncRead + Unpin) -> String {
    let mut tail = Vec::new();
    let mut buffer = [0; 4096];
    while let Ok(len @ 1..) = stderr.read(&mut buffer).await {
        tail.extend_from_slice(&buffer[..len]);
        let excess = tail.len().saturating_sub(STDERR_TAIL);
        tail.drain(..excess);
    }
    String::from_utf8_lossy(&tail).trim().to_owned()
}

/// Tells the lines of a child to the store.
struct Teller<'a> {
    app: &'a App,
    lease: Lease,
    tracker: Tracker,
    said: Option<JobResult>,
}

impl Teller<'_> {
    async fn line(&mut self, line: &str) -> ApiResult<Result<(), LeaseLost>> {
        match serde_json::from_str(line) {
            Ok(JobLine::Progress { stage, done, total, unit }) => {
                let step = Step { stage, done, total, unit };
                let stamp = clock::rfc3339(clock::now_ms());
                let told = self.tracker.step(step, Instant::now(), &stamp);
                if told.is_empty() { Ok(Ok(())) } else { self.write(&told).await }
            }
            Ok(JobLine::Reused { stage, units }) => {
                self.tracker.reused(&stage, units);
                Ok(Ok(()))
            }
            Ok(JobLine::Log { level, message }) => {
                self.app.store.log_job(self.lease, &level, &message).await
            }
            Ok(JobLine::Result(result)) => {
                self.said = Some(result);
                Ok(Ok(()))
            }
            Err(error) => {
                tracing::warn!(job = %self.lease.job, %error, "a worker's line makes no sense");
                Ok(Ok(()))
            }
        }
    }

    async fn overdue(&mut self) -> ApiResult<Result<(), LeaseLost>> {
        match self.tracker.overdue(Instant::now()) {
            None => Ok(Ok(())),
            Some(told) => self.write(&[told]).await,
        }
    }

    async fn write(
        &self,
        told: &[(&'static str, serde_json::Value)],
    ) -> ApiResult<Result<(), LeaseLost>> {
        let Tracker { progress, stages, .. } = &self.tracker;
        let stage = self.tracker.stage();
        self.app.store.report_progress(self.lease, stage, progress, stages, told).await
    }

    async fn judge(
        mut self,
        status: Option<ExitStatus>,
        tail: &str,
    ) -> ApiResult<Result<Ended, LeaseLost>> {
        match (self.said.take(), status) {
            (Some(said), Some(status)) if status.success() => {
                if said.ok {
                    self.tracker.finish(&clock::rfc3339(clock::now_ms()));
                    if let Err(lost) = self.write(&[]).await? {
                        return Ok(Err(lost));
                    }
                }
                Ok(Ok(Ended::Said(said)))
            }
            (_, status) => {
                let how = status.map_or("closed its output and hung".to_owned(), |status| {
                    format!("ended with {status}")
                });
                let stage = match self.tracker.stage() {
                    "" => "before its first stage".to_owned(),
                    stage => format!("in stage {stage}"),
                };
                let mut detail = format!("the worker {how} {stage}");
                if !tail.is_empty() {
                    detail = format!("{detail}: {tail}");
                }
                Ok(Ok(Ended::Crashed { detail }))
            }
        }
    }
}
