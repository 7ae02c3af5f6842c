//! Archives that come in parts: a row, and a file that grows. What is acknowledged of it is on the
//! disk.

use std::{
    fs::{File, TryLockError},
    io,
    path::{Path, PathBuf},
    time::Duration,
};

use sqlx::Row;
use uuid::Uuid;
use volery_api::{CreateUpload, UploadReport};

use super::{Store, blobs::sync_folder, json};
use crate::{
    clock,
    error::{ApiError, ApiResult, Code},
    idempotency::{Identity, same_request},
};

/// Uploads that wait for their end at once.
const MAX_UPLOADS: i64 = 64;

/// An upload as it was asked for.
#[derive(Debug, Clone)]
pub(crate) struct UploadRow {
    pub(crate) id: Uuid,
    pub(crate) request: CreateUpload,
    pub(crate) created_ms: i64,
    /// What became of its photos; they are in their set.
    pub(crate) report: Option<UploadReport>,
}

impl Store {
    /// Keeps an upload; the same identity and request gives the same upload again.
    pub(crate) async fn insert_upload(
        &self,
        identity: &Identity,
        request: &CreateUpload,
    ) -> ApiResult<UploadRow> {
        let text = serde_json::to_string(request)?;
        let mut tx = self.begin().await?;
        let row = sqlx::query("SELECT COUNT(*) AS waiting FROM uploads WHERE report IS NULL")
            .fetch_one(&mut *tx)
            .await?;
        if row.try_get::<i64, _>("waiting")? >= MAX_UPLOADS {
            let code = Code::TooMany { code: "too_many_uploads", retry_after_s: 600 };
            return Err(ApiError::new(code, format!("{MAX_UPLOADS} uploads are under way"))
                .hint("complete or delete one of them"));
        }
        sqlx::query(
            "INSERT INTO uploads (id, request, created_ms) VALUES (?1, ?2, ?3)
             ON CONFLICT (id) DO NOTHING",
        )
        .bind(identity.id.to_string())
        .bind(&text)
        .bind(clock::now_ms())
        .execute(&mut *tx)
        .await?;
        tx.commit().await?;
        let row = self.upload(identity.id).await?;
        same_request(&serde_json::to_string(&row.request)?, &text)?;
        Ok(row)
    }

    /// By id.
    pub(crate) async fn upload(&self, id: Uuid) -> ApiResult<UploadRow> {
        let row = sqlx::query("SELECT * FROM uploads WHERE id = ?1")
            .bind(id.to_string())
            .fetch_optional(&self.readers)
            .await?
            .ok_or_else(|| ApiError::not_found("upload", id))?;
        Ok(UploadRow {
            id,
            request: json(row.try_get("request")?)?,
            created_ms: row.try_get("created_ms")?,
            report: row.try_get::<Option<&str>, _>("report")?.map(json).transpose()?,
        })
    }

    /// Remembers that the photos are in their set.
    pub(crate) async fn finish_upload(&self, id: Uuid, report: &UploadReport) -> ApiResult<()> {
        sqlx::query("UPDATE uploads SET report = ?2 WHERE id = ?1")
            .bind(id.to_string())
            .bind(serde_json::to_string(report)?)
            .execute(&self.writer)
            .await?;
        Ok(())
    }

    /// Forgets an upload; answers whether there was one.
    pub(crate) async fn delete_upload(&self, id: Uuid) -> ApiResult<bool> {
        let result = sqlx::query("DELETE FROM uploads WHERE id = ?1")
            .bind(id.to_string())
            .execute(&self.writer)
            .await?;
        Ok(result.rows_affected() > 0)
    }

    /// Forgets uploads that began longer ago than `age`, with their files.
    pub(crate) async fn forget_old_uploads(
        &self,
        files: &UploadFiles,
        age: Duration,
    ) -> ApiResult<()> {
        sqlx::query("DELETE FROM uploads WHERE created_ms < ?1")
            .bind(clock::now_ms() - age.as_millis() as i64)
            .execute(&self.writer)
            .await?;
        for id in files.ids()? {
            if matches!(self.upload(id).await, Err(ApiError { code: Code::NotFound, .. })) {
                files.remove(id)?;
            }
        }
        Ok(())
    }
}

/// The files of uploads. All of it blocks.
#[derive(Debug, Clone)]
pub(crate) struct UploadFiles {
    folder: PathBuf,
}

impl UploadFiles {
    /// In a data folder.
    pub(crate) fn open(data: &Path) -> io::Result<Self> {
        let folder = data.join("uploads");
        std::fs::create_dir_all(&folder)?;
        sync_folder(data)?;
        Ok(Self { folder })
    }

    /// Bytes that are there.
    pub(crate) fn len(&self, id: Uuid) -> io::Result<u64> {
        match std::fs::metadata(self.path(id)) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(0),
            file => Ok(file?.len()),
        }
    }

    /// The file, to add to it; `None` while somebody else does.
    pub(crate) fn take(&self, id: Uuid) -> io::Result<Option<File>> {
        let file = File::options().read(true).append(true).create(true).open(self.path(id))?;
        match file.try_lock() {
            Ok(()) => Ok(Some(file)),
            Err(TryLockError::WouldBlock) => Ok(None),
            Err(TryLockError::Error(error)) => Err(error),
        }
    }

    /// Brings what was added to the disk.
    pub(crate) fn keep(&self, file: &File) -> io::Result<()> {
        file.sync_data()?;
        sync_folder(&self.folder)
    }

    fn ids(&self) -> io::Result<Vec<Uuid>> {
        let mut ids = Vec::new();
        for entry in std::fs::read_dir(&self.folder)? {
            ids.extend(entry?.file_name().to_str().and_then(|name| Uuid::parse_str(name).ok()));
        }
        Ok(ids)
    }

    /// Deletes a file that may not be there.
    pub(crate) fn remove(&self, id: Uuid) -> io::Result<()> {
        match std::fs::remove_file(self.path(id)) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
            _ => Ok(()),
        }
    }

    pub(crate) fn path(&self, id: Uuid) -> PathBuf {
        self.folder.join(id.to_string())
    }
}
