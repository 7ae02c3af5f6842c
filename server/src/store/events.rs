//! Events of jobs: written in the transaction of what they tell, told after it.

use sqlx::{Row, Sqlite, Transaction};
use uuid::Uuid;
use volery_api::JobEvent;

use super::{Store, json};
use crate::{clock, error::ApiResult};

impl Store {
    /// Events after a number, in order.
    pub(crate) async fn events(
        &self,
        job: Uuid,
        after: u64,
        limit: u32,
    ) -> ApiResult<Vec<JobEvent>> {
        const ALL: &str = "SELECT seq, time_ms, kind, data FROM job_events
             WHERE job_id = ?1 AND seq > ?2 ORDER BY seq LIMIT ?3";
        self.select_events(ALL, job, after, limit).await
    }

    /// Events after a number that make up the log: all but progress, in order.
    pub(crate) async fn log_events(
        &self,
        job: Uuid,
        after: u64,
        limit: u32,
    ) -> ApiResult<Vec<JobEvent>> {
        const LOG: &str = "SELECT seq, time_ms, kind, data FROM job_events
             WHERE job_id = ?1 AND seq > ?2 AND kind <> 'job.progress' ORDER BY seq LIMIT ?3";
        self.select_events(LOG, job, after, limit).await
    }

    async fn select_events(
        &self,
        sql: &'static str,
        job: Uuid,
        after: u64,
        limit: u32,
    ) -> ApiResult<Vec<JobEvent>> {
        let rows = sqlx::query(sql)
            .bind(job.to_string())
            .bind(i64::try_from(after).unwrap_or(i64::MAX))
            .bind(limit)
            .fetch_all(&self.readers)
            .await?;
        let events = rows.iter().map(|row| {
            Ok(JobEvent {
                seq: row.try_get::<i64, _>("seq")? as u64,
                time: clock::rfc3339(row.try_get("time_ms")?),
                kind: row.try_get("kind")?,
                data: json(row.try_get("data")?)?,
            })
        });
        Ok(events.collect::<Result<_, sqlx::Error>>()?)
    }
}

/// Adds an event with the next number of its job.
pub(super) async fn append(
    tx: &mut Transaction<'static, Sqlite>,
    job: Uuid,
    kind: &str,
    data: serde_json::Value,
) -> Result<JobEvent, sqlx::Error> {
    let row = sqlx::query(
        "UPDATE jobs SET last_event = last_event + 1 WHERE id = ?1 RETURNING last_event",
    )
    .bind(job.to_string())
    .fetch_one(&mut **tx)
    .await?;
    let seq: i64 = row.try_get("last_event")?;
    let time_ms = clock::now_ms();
    sqlx::query(
        "INSERT INTO job_events (job_id, seq, time_ms, kind, data) VALUES (?1, ?2, ?3, ?4, ?5)",
    )
    .bind(job.to_string())
    .bind(seq)
    .bind(time_ms)
    .bind(kind)
    .bind(data.to_string())
    .execute(&mut **tx)
    .await?;
    Ok(JobEvent { seq: seq as u64, time: clock::rfc3339(time_ms), kind: kind.to_owned(), data })
}
