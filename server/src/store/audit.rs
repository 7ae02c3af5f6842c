//! Who did what when.

use std::time::Duration;

use sqlx::{Row, sqlite::SqliteRow};
use volery_api::{AuditEntry, Page, Role};

use super::{PageAt, Store, uuid};
use crate::{auth::Caller, clock, error::ApiResult};

/// A request that was answered.
#[derive(Debug, Clone)]
pub(crate) struct NewAuditEntry {
    pub(crate) time_ms: i64,
    pub(crate) caller: Caller,
    pub(crate) method: String,
    pub(crate) path: String,
    pub(crate) status: u16,
    pub(crate) detail: Option<String>,
}

impl Store {
    /// Keeps entries in their order.
    pub(crate) async fn insert_audit(&self, entries: &[NewAuditEntry]) -> ApiResult<()> {
        let mut tx = self.begin().await?;
        for entry in entries {
            sqlx::query(
                "INSERT INTO audit (time_ms, token_id, name, role, method, path, status, detail)
                 VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8)",
            )
            .bind(entry.time_ms)
            .bind(entry.caller.id.to_string())
            .bind(&entry.caller.name)
            .bind(entry.caller.role.name())
            .bind(&entry.method)
            .bind(&entry.path)
            .bind(entry.status)
            .bind(&entry.detail)
            .execute(&mut *tx)
            .await?;
        }
        tx.commit().await?;
        Ok(())
    }

    /// Newest first.
    pub(crate) async fn audit(&self, at: PageAt) -> ApiResult<Page<AuditEntry>> {
        let rows =
            sqlx::query("SELECT * FROM audit WHERE ?1 = 0 OR seq < ?1 ORDER BY seq DESC LIMIT ?2")
                .bind(at.after)
                .bind(at.limit + 1)
                .fetch_all(&self.readers)
                .await?;
        let entries = rows.iter().map(|row| Ok((row.try_get("seq")?, entry(row)?)));
        Ok(at.page(entries.collect::<Result<_, sqlx::Error>>()?))
    }

    /// Forgets entries that are older than `age`.
    pub(crate) async fn forget_old_audit(&self, age: Duration) -> ApiResult<()> {
        sqlx::query("DELETE FROM audit WHERE time_ms < ?1")
            .bind(clock::now_ms() - age.as_millis() as i64)
            .execute(&self.writer)
            .await?;
        Ok(())
    }
}

fn entry(row: &SqliteRow) -> Result<AuditEntry, sqlx::Error> {
    let role: &str = row.try_get("role")?;
    let id = uuid(row.try_get("token_id")?)?;
    Ok(AuditEntry {
        time: clock::rfc3339(row.try_get("time_ms")?),
        token_id: (!id.is_nil()).then_some(id),
        name: row.try_get("name")?,
        role: Role::from_name(role)
            .ok_or_else(|| sqlx::Error::Decode(format!("role {role:?}").into()))?,
        method: row.try_get("method")?,
        path: row.try_get("path")?,
        status: row.try_get("status")?,
        detail: row.try_get("detail")?,
    })
}
