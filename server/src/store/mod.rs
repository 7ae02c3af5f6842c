//! What lasts: rows in SQLite, bytes in content-addressed files. SQL and paths live here only.

mod audit;
pub(crate) mod blobs;
mod cameras;
mod collect;
mod drone_cameras;
mod drones;
mod events;
mod geofences;
mod imagesets;
mod jobs;
mod leases;
mod maps;
pub(crate) mod thumbnails;
mod tokens;
mod uploads;

use std::{path::Path, time::Duration};

use sqlx::{
    Sqlite, SqlitePool, Transaction,
    migrate::{Migration, MigrationType, Migrator},
    sqlite::{SqliteConnectOptions, SqliteJournalMode, SqlitePoolOptions, SqliteSynchronous},
};
use tokio::sync::broadcast;
use uuid::Uuid;
use volery_api::JobEvent;

use crate::error::{ApiError, ApiResult, Code};

pub(crate) use audit::NewAuditEntry;
pub(crate) use imagesets::{NewImage, StoredImage};
pub(crate) use jobs::JobRow;
pub(crate) use leases::{Finish, Lease, LeaseLost};
pub(crate) use maps::NewVersion;
pub(crate) use uploads::{UploadFiles, UploadRow};

const MIGRATIONS: [(i64, &str, &str); 7] = [
    (1, "spine", include_str!("../../../migrations/sqlite/0001_spine.sql")),
    (2, "drones", include_str!("../../../migrations/sqlite/0002_drones.sql")),
    (3, "geofences", include_str!("../../../migrations/sqlite/0003_geofences.sql")),
    (4, "job details", include_str!("../../../migrations/sqlite/0004_job_details.sql")),
    (5, "uploads", include_str!("../../../migrations/sqlite/0005_uploads.sql")),
    (6, "audit", include_str!("../../../migrations/sqlite/0006_audit.sql")),
    (7, "drone cameras", include_str!("../../../migrations/sqlite/0007_drone_cameras.sql")),
];

/// The rows. Writes go through one connection, so a transaction never waits for another.
#[derive(Debug, Clone)]
pub(crate) struct Store {
    writer: SqlitePool,
    readers: SqlitePool,
    news: broadcast::Sender<News>,
}

/// An event of a job, told after it was written.
#[derive(Debug, Clone)]
pub(crate) struct News {
    pub(crate) job: Uuid,
    pub(crate) event: JobEvent,
}

impl Store {
    /// Opens or creates `database` and brings its schema up to date.
    pub(crate) async fn open(database: &Path) -> Result<Self, sqlx::Error> {
        let options = SqliteConnectOptions::new()
            .filename(database)
            .create_if_missing(true)
            .journal_mode(SqliteJournalMode::Wal)
            .synchronous(SqliteSynchronous::Full)
            .foreign_keys(true)
            .busy_timeout(Duration::from_secs(10));
        let writer =
            SqlitePoolOptions::new().max_connections(1).connect_with(options.clone()).await?;
        let migrations = MIGRATIONS
            .into_iter()
            .map(|(version, name, sql)| {
                let sql = sqlx::SqlSafeStr::into_sql_str(sql);
                Migration::new(version, name.into(), MigrationType::Simple, sql, false)
            })
            .collect();
        Migrator::with_migrations(migrations).run(&writer).await?;
        let readers = SqlitePoolOptions::new()
            .max_connections(4)
            .connect_with(options.read_only(true).create_if_missing(false))
            .await?;
        Ok(Self { writer, readers, news: broadcast::channel(1024).0 })
    }

    async fn begin(&self) -> Result<Transaction<'static, Sqlite>, sqlx::Error> {
        self.writer.begin_with("BEGIN IMMEDIATE").await
    }

    /// Events from now on.
    pub(crate) fn listen(&self) -> broadcast::Receiver<News> {
        self.news.subscribe()
    }

    fn tell(&self, job: Uuid, events: impl IntoIterator<Item = JobEvent>) {
        for event in events {
            // Nobody needs to listen.
            let _ = self.news.send(News { job, event });
        }
    }

    /// Whether the database answers.
    pub(crate) async fn ping(&self) -> ApiResult<()> {
        sqlx::query("SELECT 1").execute(&self.readers).await?;
        Ok(())
    }

    /// Ends every connection.
    pub(crate) async fn close(&self) {
        self.readers.close().await;
        self.writer.close().await;
    }
}

/// Where a page begins and how long it is.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PageAt {
    pub(crate) after: i64,
    pub(crate) limit: i64,
}

impl PageAt {
    /// From what the client sent.
    pub(crate) fn parse(limit: Option<u32>, cursor: Option<&str>) -> ApiResult<Self> {
        let limit = limit.unwrap_or(100);
        if !(1..=1000).contains(&limit) {
            let detail = format!("limit must be 1 to 1000, got {limit}");
            return Err(ApiError::new(Code::Unprocessable("bad_limit"), detail));
        }
        let after = match cursor {
            None => 0,
            Some(cursor) => cursor
                .strip_prefix('c')
                .and_then(|seq| i64::from_str_radix(seq, 16).ok())
                .ok_or_else(|| {
                    ApiError::new(Code::Unprocessable("bad_cursor"), "unknown cursor")
                })?,
        };
        Ok(Self { after, limit: i64::from(limit) })
    }

    /// Items and the cursor behind them, from rows of which one more than `limit` was asked for.
    pub(crate) fn page<T>(&self, mut rows: Vec<(i64, T)>) -> volery_api::Page<T> {
        let more = rows.len() as i64 > self.limit;
        rows.truncate(self.limit as usize);
        let next_cursor = rows.last().filter(|_| more).map(|(seq, _)| format!("c{seq:x}"));
        volery_api::Page { items: rows.into_iter().map(|(_, item)| item).collect(), next_cursor }
    }
}

/// A column that holds a UUID as text.
fn uuid(text: &str) -> Result<Uuid, sqlx::Error> {
    Uuid::parse_str(text).map_err(|error| sqlx::Error::Decode(error.into()))
}

/// A column that holds JSON as text.
fn json<T: serde::de::DeserializeOwned>(text: &str) -> Result<T, sqlx::Error> {
    serde_json::from_str(text).map_err(|error| sqlx::Error::Decode(error.into()))
}
