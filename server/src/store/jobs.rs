//! Jobs as their clients see them.

use serde_json::json as value;
use sqlx::{Row, sqlite::SqliteRow};
use uuid::Uuid;
use volery_api::{CreateJob, Job, JobKind, JobOutputs, JobState, Page};

use super::{PageAt, Store, events, json, uuid};
use crate::{
    clock,
    error::{ApiError, ApiResult, Code},
    idempotency::{Identity, same_request},
};

/// A claimed job.
#[derive(Debug, Clone)]
pub(crate) struct JobRow {
    pub(crate) id: Uuid,
    pub(crate) request: CreateJob,
    pub(crate) attempt: u32,
    pub(crate) max_attempts: u32,
    pub(crate) lease_token: i64,
    /// The first stage that is done anew, until what was finished is forgotten.
    pub(crate) from_stage: Option<String>,
}

const SELECT_JOB: &str = "SELECT j.*, (SELECT COUNT(*) FROM jobs q WHERE q.state = 'queued' AND
    (q.priority > j.priority OR (q.priority = j.priority AND q.seq < j.seq))) AS queue_position
    FROM jobs j WHERE j.id = ?1";

impl Store {
    /// Queues a job; the same identity and request gives the same job again.
    pub(crate) async fn insert_job(
        &self,
        identity: &Identity,
        request: &CreateJob,
        max_attempts: u32,
        max_queued: u64,
    ) -> ApiResult<Job> {
        let text = serde_json::to_string(request)?;
        let mut tx = self.begin().await?;
        let known = sqlx::query("SELECT request FROM jobs WHERE id = ?1")
            .bind(identity.id.to_string())
            .fetch_optional(&mut *tx)
            .await?;
        if let Some(row) = known {
            same_request(row.try_get("request")?, &text)?;
            drop(tx);
            return self.job(identity.id).await;
        }
        let row = sqlx::query("SELECT COUNT(*) AS queued FROM jobs WHERE state = 'queued'")
            .fetch_one(&mut *tx)
            .await?;
        if row.try_get::<i64, _>("queued")? as u64 >= max_queued {
            let code = Code::TooMany { code: "queue_full", retry_after_s: 30 };
            return Err(ApiError::new(code, format!("{max_queued} jobs are waiting already")));
        }
        let now = clock::now_ms();
        sqlx::query(
            "INSERT INTO jobs (id, kind, request, state, priority, run_after_ms, max_attempts,
             created_ms) VALUES (?1, ?6, ?2, 'queued', ?3, ?4, ?5, ?4)",
        )
        .bind(identity.id.to_string())
        .bind(&text)
        .bind(request.priority)
        .bind(now)
        .bind(max_attempts)
        .bind(request.kind.name())
        .execute(&mut *tx)
        .await?;
        let queued = value!({ "state": "queued" });
        let event = events::append(&mut tx, identity.id, "job.state", queued).await?;
        tx.commit().await?;
        self.tell(identity.id, [event]);
        self.job(identity.id).await
    }

    /// By id.
    pub(crate) async fn job(&self, id: Uuid) -> ApiResult<Job> {
        let row = sqlx::query(SELECT_JOB)
            .bind(id.to_string())
            .fetch_optional(&self.readers)
            .await?
            .ok_or_else(|| ApiError::not_found("job", id))?;
        Ok(job(&row)?)
    }

    /// Newest last.
    pub(crate) async fn jobs(
        &self,
        state: Option<JobState>,
        kind: Option<JobKind>,
        at: PageAt,
    ) -> ApiResult<Page<Job>> {
        let rows = sqlx::query(
            "SELECT j.*, (SELECT COUNT(*) FROM jobs q WHERE q.state = 'queued' AND
             (q.priority > j.priority OR (q.priority = j.priority AND q.seq < j.seq)))
             AS queue_position FROM jobs j
             WHERE j.seq > ?1 AND (?2 IS NULL OR j.state = ?2) AND (?4 IS NULL OR j.kind = ?4)
             ORDER BY j.seq LIMIT ?3",
        )
        .bind(at.after)
        .bind(state.map(JobState::name))
        .bind(at.limit + 1)
        .bind(kind.map(JobKind::name))
        .fetch_all(&self.readers)
        .await?;
        let jobs = rows.iter().map(|row| Ok((row.try_get("seq")?, job(row)?)));
        Ok(at.page(jobs.collect::<Result<_, sqlx::Error>>()?))
    }

    /// Number of jobs per state.
    pub(crate) async fn job_counts(&self) -> ApiResult<Vec<(String, i64)>> {
        let rows = sqlx::query("SELECT state, COUNT(*) AS number FROM jobs GROUP BY state")
            .fetch_all(&self.readers)
            .await?;
        let counts = rows.iter().map(|row| Ok((row.try_get("state")?, row.try_get("number")?)));
        Ok(counts.collect::<Result<_, sqlx::Error>>()?)
    }

    /// Ends a waiting job; asks a running one to stop. A finished job is a conflict.
    pub(crate) async fn cancel_job(&self, id: Uuid) -> ApiResult<Job> {
        let mut tx = self.begin().await?;
        let state = state_of(&mut tx, id).await?;
        let events = match state {
            JobState::Queued => {
                sqlx::query(
                    "UPDATE jobs SET state = 'cancelled', cancel_requested = 1, finished_ms = ?2
                     WHERE id = ?1",
                )
                .bind(id.to_string())
                .bind(clock::now_ms())
                .execute(&mut *tx)
                .await?;
                let cancelled = value!({ "state": "cancelled" });
                vec![events::append(&mut tx, id, "job.state", cancelled).await?]
            }
            JobState::Running => {
                sqlx::query("UPDATE jobs SET cancel_requested = 1 WHERE id = ?1")
                    .bind(id.to_string())
                    .execute(&mut *tx)
                    .await?;
                Vec::new()
            }
            state => {
                let detail = format!("job {id} is {} already", state.name());
                return Err(ApiError::new(Code::Conflict("job_finished"), detail));
            }
        };
        tx.commit().await?;
        self.tell(id, events);
        self.job(id).await
    }

    /// Queues a job again that failed, was cancelled or is partial; `from_stage` and what comes
    /// after it is done anew.
    pub(crate) async fn retry_job(&self, id: Uuid, from_stage: Option<&str>) -> ApiResult<Job> {
        let mut tx = self.begin().await?;
        let state = state_of(&mut tx, id).await?;
        if !matches!(state, JobState::Failed | JobState::Cancelled | JobState::Partial) {
            let detail = format!("job {id} is {}", state.name());
            return Err(ApiError::new(Code::Conflict("job_not_retryable"), detail)
                .hint("only failed, cancelled and partial jobs can run again"));
        }
        sqlx::query(
            "UPDATE jobs SET state = 'queued', attempt = 0, interruptions = 0, error = NULL,
             cancel_requested = 0, run_after_ms = ?2, finished_ms = NULL, stage = NULL,
             progress = '{}', stages = '[]', warnings = '[]', from_stage = ?3 WHERE id = ?1",
        )
        .bind(id.to_string())
        .bind(clock::now_ms())
        .bind(from_stage)
        .execute(&mut *tx)
        .await?;
        let queued = value!({ "state": "queued" });
        let event = events::append(&mut tx, id, "job.state", queued).await?;
        tx.commit().await?;
        self.tell(id, [event]);
        self.job(id).await
    }

    /// Forgets a finished job. Its map stays.
    pub(crate) async fn delete_job(&self, id: Uuid) -> ApiResult<()> {
        let mut tx = self.begin().await?;
        let state = state_of(&mut tx, id).await?;
        if !state.is_final() {
            let detail = format!("job {id} is {}", state.name());
            return Err(ApiError::new(Code::Conflict("job_active"), detail).hint("cancel it first"));
        }
        sqlx::query("DELETE FROM jobs WHERE id = ?1")
            .bind(id.to_string())
            .execute(&mut *tx)
            .await?;
        tx.commit().await?;
        Ok(())
    }
}

async fn state_of(connection: &mut sqlx::SqliteConnection, id: Uuid) -> ApiResult<JobState> {
    let row = sqlx::query("SELECT state FROM jobs WHERE id = ?1")
        .bind(id.to_string())
        .fetch_optional(connection)
        .await?
        .ok_or_else(|| ApiError::not_found("job", id))?;
    Ok(state(&row)?)
}

fn state(row: &SqliteRow) -> Result<JobState, sqlx::Error> {
    let name: &str = row.try_get("state")?;
    JobState::from_name(name).ok_or_else(|| sqlx::Error::Decode(format!("state {name:?}").into()))
}

fn job(row: &SqliteRow) -> Result<Job, sqlx::Error> {
    let state = state(row)?;
    let map_id = row.try_get::<Option<&str>, _>("map_id")?.map(uuid).transpose()?;
    let version = row.try_get::<Option<u32>, _>("map_version")?;
    let progress: &str = row.try_get("progress")?;
    let request: CreateJob = json(row.try_get("request")?)?;
    Ok(Job {
        id: uuid(row.try_get("id")?)?,
        kind: request.kind,
        state,
        stage: row.try_get("stage")?,
        progress: if progress == "{}" { Default::default() } else { json(progress)? },
        queue_position: match state {
            JobState::Queued => Some(row.try_get::<i64, _>("queue_position")? as u64),
            _ => None,
        },
        stages: json(row.try_get("stages")?)?,
        attempt: row.try_get("attempt")?,
        cancel_requested: row.try_get::<i64, _>("cancel_requested")? != 0,
        warnings: json(row.try_get("warnings")?)?,
        error: row.try_get::<Option<&str>, _>("error")?.map(json).transpose()?,
        outputs: map_id.zip(version).map(|(map_id, version)| JobOutputs { map_id, version }),
        request,
        last_event: row.try_get::<i64, _>("last_event")? as u64,
        created: clock::rfc3339(row.try_get("created_ms")?),
        started: row.try_get::<Option<i64>, _>("started_ms")?.map(clock::rfc3339),
        finished: row.try_get::<Option<i64>, _>("finished_ms")?.map(clock::rfc3339),
    })
}
