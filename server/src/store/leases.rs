//! Who runs a job, and for how long.
//!
//! A claim raises the lease token. Every write of a worker names the token it was given; once
//! another worker has claimed the job, those writes change nothing and the worker stops.

use serde_json::json as value;
use sqlx::{Row, Sqlite, Transaction};
use uuid::Uuid;
use volery_api::{JobError, JobEvent, JobProgress, JobStage, JobState, Warning};

use super::{JobRow, NewVersion, Store, events, json, maps, uuid};
use crate::{clock, error::ApiResult};

/// Runs of one job that may end with the service before it is given up.
const MAX_INTERRUPTIONS: i64 = 1000;

/// The right to write to a running job.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lease {
    pub(crate) job: Uuid,
    pub(crate) token: i64,
}

/// The lease belongs to someone else now, or the job is gone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct LeaseLost;

/// Outcome of a write that needs the lease.
pub(crate) type Outcome<T> = Result<T, LeaseLost>;

/// How a run ended.
pub(crate) enum Finish {
    /// `succeeded` or `partial`.
    Map {
        state: JobState,
        version: Box<NewVersion>,
        error: Option<JobError>,
        warnings: Vec<Warning>,
    },
    /// For good.
    Failed(JobError),
    /// As asked.
    Cancelled,
    /// Again, after a while.
    Retry { error: JobError, delay_ms: i64 },
    /// The service closes down, or its disk is full: again, as if it had not begun.
    Interrupted(Option<JobError>),
}

impl Store {
    /// The next job to run, if any, and the lease on it.
    pub(crate) async fn claim_job(&self, owner: Uuid, lease_ms: i64) -> ApiResult<Option<JobRow>> {
        let now = clock::now_ms();
        let mut tx = self.begin().await?;
        let row = sqlx::query(
            "UPDATE jobs SET state = 'running', attempt = attempt + 1, lease_owner = ?1,
             lease_token = lease_token + 1, lease_until_ms = ?2,
             started_ms = COALESCE(started_ms, ?3)
             WHERE id = (SELECT id FROM jobs WHERE
                 (state = 'queued' AND run_after_ms <= ?3) OR
                 (state = 'running' AND lease_until_ms < ?3 AND attempt < max_attempts)
                 ORDER BY priority DESC, run_after_ms, seq LIMIT 1)
             RETURNING id, request, attempt, max_attempts, lease_token, from_stage",
        )
        .bind(owner.to_string())
        .bind(now + lease_ms)
        .bind(now)
        .fetch_optional(&mut *tx)
        .await?;
        let Some(row) = row else { return Ok(None) };
        let job = JobRow {
            id: uuid(row.try_get("id")?)?,
            request: json(row.try_get("request")?)?,
            attempt: row.try_get("attempt")?,
            max_attempts: row.try_get("max_attempts")?,
            lease_token: row.try_get("lease_token")?,
            from_stage: row.try_get("from_stage")?,
        };
        let running = value!({ "state": "running", "attempt": job.attempt });
        let event = events::append(&mut tx, job.id, "job.state", running).await?;
        tx.commit().await?;
        self.tell(job.id, [event]);
        Ok(Some(job))
    }

    /// Remembers that what a retry wants done anew is gone from the work folder.
    pub(crate) async fn stages_forgotten(&self, lease: Lease) -> ApiResult<Outcome<()>> {
        let result = sqlx::query(
            "UPDATE jobs SET from_stage = NULL
             WHERE id = ?1 AND lease_token = ?2 AND state = 'running'",
        )
        .bind(lease.job.to_string())
        .bind(lease.token)
        .execute(&self.writer)
        .await?;
        Ok(if result.rows_affected() == 0 { Err(LeaseLost) } else { Ok(()) })
    }

    /// Keeps the lease; answers whether someone asked the job to stop.
    pub(crate) async fn heartbeat(&self, lease: Lease, lease_ms: i64) -> ApiResult<Outcome<bool>> {
        let row = sqlx::query(
            "UPDATE jobs SET lease_until_ms = ?3
             WHERE id = ?1 AND lease_token = ?2 AND state = 'running' RETURNING cancel_requested",
        )
        .bind(lease.job.to_string())
        .bind(lease.token)
        .bind(clock::now_ms() + lease_ms)
        .fetch_optional(&self.writer)
        .await?;
        Ok(match row {
            Some(row) => Ok(row.try_get::<i64, _>("cancel_requested")? != 0),
            None => Err(LeaseLost),
        })
    }

    /// Writes how far a job is, with the events that tell it.
    pub(crate) async fn report_progress(
        &self,
        lease: Lease,
        stage: &str,
        progress: &JobProgress,
        stages: &[JobStage],
        told: &[(&str, serde_json::Value)],
    ) -> ApiResult<Outcome<()>> {
        let mut tx = self.begin().await?;
        let result = sqlx::query(
            "UPDATE jobs SET stage = ?3, progress = ?4, stages = ?5
             WHERE id = ?1 AND lease_token = ?2 AND state = 'running'",
        )
        .bind(lease.job.to_string())
        .bind(lease.token)
        .bind(stage)
        .bind(serde_json::to_string(progress)?)
        .bind(serde_json::to_string(stages)?)
        .execute(&mut *tx)
        .await?;
        if result.rows_affected() == 0 {
            return Ok(Err(LeaseLost));
        }
        self.append_and_commit(tx, lease.job, told).await?;
        Ok(Ok(()))
    }

    /// Adds a line to the log of a running job.
    pub(crate) async fn log_job(
        &self,
        lease: Lease,
        level: &str,
        message: &str,
    ) -> ApiResult<Outcome<()>> {
        let mut tx = self.begin().await?;
        if held(&mut tx, lease).await?.is_none() {
            return Ok(Err(LeaseLost));
        }
        let data = value!({ "level": level, "message": message });
        self.append_and_commit(tx, lease.job, &[("job.log", data)]).await?;
        Ok(Ok(()))
    }

    async fn append_and_commit(
        &self,
        mut tx: Transaction<'static, Sqlite>,
        job: Uuid,
        told: &[(&str, serde_json::Value)],
    ) -> ApiResult<()> {
        let mut written = Vec::with_capacity(told.len());
        for (kind, data) in told {
            written.push(events::append(&mut tx, job, kind, data.clone()).await?);
        }
        tx.commit().await?;
        self.tell(job, written);
        Ok(())
    }

    /// Ends a run. A map becomes visible in the same transaction; whoever asked the job to stop
    /// before it gets none, however far the run came. Answers the state of the job from now on.
    pub(crate) async fn finish_job(
        &self,
        lease: Lease,
        finish: Finish,
    ) -> ApiResult<Outcome<JobState>> {
        let now = clock::now_ms();
        let mut tx = self.begin().await?;
        let Some(cancelled) = held(&mut tx, lease).await? else { return Ok(Err(LeaseLost)) };
        let finish = if cancelled { Finish::Cancelled } else { finish };
        let mut told = Vec::new();
        let (state, error, outputs, run_after, uncount) = match finish {
            Finish::Map { state, version, error, warnings } => {
                told = warnings;
                let number = maps::insert_version(&mut tx, &version, now).await?;
                (state, error, Some((version.map_id, number)), now, 0)
            }
            Finish::Failed(error) => (JobState::Failed, Some(error), None, now, 0),
            Finish::Cancelled => (JobState::Cancelled, None, None, now, 0),
            Finish::Retry { error, delay_ms } => {
                (JobState::Queued, Some(error), None, now + delay_ms, 0)
            }
            Finish::Interrupted(error) => (JobState::Queued, error, None, now, 1),
        };
        let error_text = error.as_ref().map(serde_json::to_string).transpose()?;
        sqlx::query(
            "UPDATE jobs SET state = ?2, error = ?3, map_id = COALESCE(?4, map_id),
             map_version = COALESCE(?5, map_version), run_after_ms = ?6, finished_ms = ?7,
             attempt = MAX(attempt - ?8, 0), interruptions = interruptions + ?8,
             warnings = ?9, lease_owner = NULL, lease_until_ms = NULL WHERE id = ?1",
        )
        .bind(lease.job.to_string())
        .bind(state.name())
        .bind(error_text)
        .bind(outputs.map(|(map, _)| map.to_string()))
        .bind(outputs.map(|(_, version)| version))
        .bind(run_after)
        .bind(state.is_final().then_some(now))
        .bind(uncount)
        .bind(serde_json::to_string(&told)?)
        .execute(&mut *tx)
        .await?;
        let mut data = value!({ "state": state.name() });
        if let Some(error) = &error {
            data["error"] = serde_json::to_value(error)?;
        }
        if let Some((map_id, version)) = outputs {
            data["outputs"] = value!({ "map_id": map_id, "version": version });
        }
        self.append_and_commit(tx, lease.job, &[("job.state", data)]).await?;
        Ok(Ok(state))
    }

    /// Fails every job whose worker vanished for the last time it may.
    pub(crate) async fn fail_lost_jobs(&self) -> ApiResult<()> {
        let now = clock::now_ms();
        let error = JobError {
            code: "worker_lost".to_owned(),
            detail: "the worker vanished in every run".to_owned(),
            hint: Some("the log may tell which photo or stage it was".to_owned()),
        };
        let mut tx = self.begin().await?;
        let rows = sqlx::query(
            "UPDATE jobs SET state = 'failed', error = ?2, finished_ms = ?1, lease_owner = NULL,
             lease_until_ms = NULL, lease_token = lease_token + 1
             WHERE state = 'running' AND lease_until_ms < ?1 AND attempt >= max_attempts
             RETURNING id",
        )
        .bind(now)
        .bind(serde_json::to_string(&error)?)
        .fetch_all(&mut *tx)
        .await?;
        let mut told: Vec<(Uuid, JobEvent)> = Vec::new();
        for row in &rows {
            let id = uuid(row.try_get("id")?)?;
            let data = value!({ "state": "failed", "error": error });
            told.push((id, events::append(&mut tx, id, "job.state", data).await?));
        }
        tx.commit().await?;
        for (id, event) in told {
            self.tell(id, [event]);
        }
        Ok(())
    }

    /// Queues again what ran when the last service over this data folder ended, or ends it if
    /// someone had asked for that. The end of the service is not the job's fault and costs it no
    /// attempt. Answers how many jobs go on.
    pub(crate) async fn recover_jobs(&self) -> ApiResult<u64> {
        let mut tx = self.begin().await?;
        let rows = sqlx::query(
            "UPDATE jobs SET state = IIF(cancel_requested, 'cancelled', 'queued'),
             finished_ms = IIF(cancel_requested, ?2, NULL), attempt = MAX(attempt - 1, 0),
             interruptions = interruptions + 1, lease_owner = NULL, lease_until_ms = NULL,
             lease_token = lease_token + 1
             WHERE state = 'running' AND interruptions < ?1 RETURNING id, state",
        )
        .bind(MAX_INTERRUPTIONS)
        .bind(clock::now_ms())
        .fetch_all(&mut *tx)
        .await?;
        let mut num_queued = 0;
        for row in &rows {
            let state: &str = row.try_get("state")?;
            num_queued += u64::from(state == JobState::Queued.name());
            let data = value!({ "state": state });
            events::append(&mut tx, uuid(row.try_get("id")?)?, "job.state", data).await?;
        }
        tx.commit().await?;
        Ok(num_queued)
    }
}

/// Whether someone asked the job to stop; `None` when the lease is lost.
async fn held(tx: &mut Transaction<'static, Sqlite>, lease: Lease) -> ApiResult<Option<bool>> {
    let row = sqlx::query(
        "SELECT cancel_requested FROM jobs WHERE id = ?1 AND lease_token = ?2 AND
         state = 'running'",
    )
    .bind(lease.job.to_string())
    .bind(lease.token)
    .fetch_optional(&mut **tx)
    .await?;
    Ok(row
        .map(|row| row.try_get::<i64, _>("cancel_requested"))
        .transpose()?
        .map(|asked| asked != 0))
}
