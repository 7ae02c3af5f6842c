//! Maps and their immutable versions.

use sqlx::{Row, SqliteConnection, sqlite::SqliteRow};
use uuid::Uuid;
use volery_api::{Map, MapFile, MapVersion, Page};

use super::{PageAt, Store, imagesets::insert_blob, json, uuid};
use crate::{
    clock,
    error::{ApiError, ApiResult, Code},
    idempotency::{Identity, same_request},
};

/// A version to be made visible; its files are safe on the disk.
pub(crate) struct NewVersion {
    pub(crate) map_id: Uuid,
    /// Of the map, if it is new.
    pub(crate) name: String,
    pub(crate) job_id: Option<Uuid>,
    pub(crate) parent_version: Option<u32>,
    pub(crate) info: serde_json::Value,
    pub(crate) residuals: Option<serde_json::Value>,
    pub(crate) files: Vec<MapFile>,
    /// Whether it answers from now on; the first version always does.
    pub(crate) activate: bool,
    /// Key and text of the request that made it.
    pub(crate) request: Option<(String, String)>,
}

const SELECT_MAP: &str = "SELECT m.*, (SELECT MAX(version) FROM map_versions v WHERE
    v.map_id = m.id) AS latest_version FROM maps m WHERE m.id = ?1";

impl Store {
    /// Whether there is such a map.
    pub(crate) async fn has_map(&self, id: Uuid) -> ApiResult<bool> {
        let row = sqlx::query("SELECT EXISTS (SELECT 1 FROM maps WHERE id = ?1) AS known")
            .bind(id.to_string())
            .fetch_one(&self.readers)
            .await?;
        Ok(row.try_get::<i64, _>("known")? != 0)
    }

    /// By id.
    pub(crate) async fn map(&self, id: Uuid) -> ApiResult<Map> {
        let row = sqlx::query(SELECT_MAP)
            .bind(id.to_string())
            .fetch_optional(&self.readers)
            .await?
            .ok_or_else(|| ApiError::not_found("map", id))?;
        self.with_active(&row).await
    }

    async fn with_active(&self, row: &SqliteRow) -> ApiResult<Map> {
        let id = uuid(row.try_get("id")?)?;
        let active_version = row.try_get("active_version")?;
        Ok(Map {
            id,
            name: row.try_get("name")?,
            active_version,
            latest_version: row.try_get("latest_version")?,
            active: self.version(id, Some(active_version)).await?,
            created: clock::rfc3339(row.try_get("created_ms")?),
        })
    }

    /// In the order of their making.
    pub(crate) async fn maps(&self, at: PageAt) -> ApiResult<Page<Map>> {
        let rows = sqlx::query(
            "SELECT m.*, (SELECT MAX(version) FROM map_versions v WHERE v.map_id = m.id)
             AS latest_version FROM maps m WHERE m.seq > ?1 ORDER BY m.seq LIMIT ?2",
        )
        .bind(at.after)
        .bind(at.limit + 1)
        .fetch_all(&self.readers)
        .await?;
        let mut maps = Vec::with_capacity(rows.len());
        for row in &rows {
            maps.push((row.try_get("seq")?, self.with_active(row).await?));
        }
        Ok(at.page(maps))
    }

    /// A version; the active one when none is named.
    pub(crate) async fn version(&self, map: Uuid, version: Option<u32>) -> ApiResult<MapVersion> {
        let row = sqlx::query(
            "SELECT * FROM map_versions WHERE map_id = ?1 AND version =
             COALESCE(?2, (SELECT active_version FROM maps WHERE id = ?1))",
        )
        .bind(map.to_string())
        .bind(version)
        .fetch_optional(&self.readers)
        .await?
        .ok_or_else(|| match version {
            Some(version) => ApiError::not_found("map version", format!("{map}/{version}")),
            None => ApiError::not_found("map", map),
        })?;
        self.with_files(&row).await
    }

    async fn with_files(&self, row: &SqliteRow) -> ApiResult<MapVersion> {
        let map_id = uuid(row.try_get("map_id")?)?;
        let version: u32 = row.try_get("version")?;
        let files = sqlx::query(
            "SELECT path, sha256, size FROM map_files WHERE map_id = ?1 AND version = ?2
             ORDER BY path",
        )
        .bind(map_id.to_string())
        .bind(version)
        .fetch_all(&self.readers)
        .await?;
        let files = files.iter().map(|row| {
            Ok(MapFile {
                path: row.try_get("path")?,
                sha256: row.try_get("sha256")?,
                size: row.try_get::<i64, _>("size")? as u64,
            })
        });
        Ok(MapVersion {
            map_id,
            version,
            job_id: row.try_get::<Option<&str>, _>("job_id")?.map(uuid).transpose()?,
            parent_version: row.try_get("parent_version")?,
            info: json(row.try_get("info")?)?,
            files: files.collect::<Result<_, sqlx::Error>>()?,
            created: clock::rfc3339(row.try_get("created_ms")?),
        })
    }

    /// The photos, by their SHA-256, of every job that made a version of a map, or of a map that
    /// was joined to it; without those that were deleted since.
    pub(crate) async fn photos_of_map(&self, map: Uuid) -> ApiResult<Vec<String>> {
        let rows = sqlx::query(
            "WITH RECURSIVE source (map) AS (
                 VALUES (?1) UNION
                 SELECT joined.value FROM source JOIN jobs ON jobs.map_id = source.map,
                 json_each(jobs.request, '$.map_ids') AS joined)
             SELECT DISTINCT images.sha256 FROM source JOIN jobs ON jobs.map_id = source.map,
             json_each(jobs.request, '$.imageset_ids') AS used
             JOIN images ON images.imageset_id = used.value ORDER BY images.sha256",
        )
        .bind(map.to_string())
        .fetch_all(&self.readers)
        .await?;
        Ok(rows.iter().map(|row| row.try_get("sha256")).collect::<Result<_, _>>()?)
    }

    /// In rising order.
    pub(crate) async fn versions(&self, map: Uuid, at: PageAt) -> ApiResult<Page<MapVersion>> {
        let rows = sqlx::query(
            "SELECT * FROM map_versions WHERE map_id = ?1 AND version > ?2 ORDER BY version
             LIMIT ?3",
        )
        .bind(map.to_string())
        .bind(at.after)
        .bind(at.limit + 1)
        .fetch_all(&self.readers)
        .await?;
        let mut versions = Vec::with_capacity(rows.len());
        for row in &rows {
            versions.push((row.try_get("version")?, self.with_files(row).await?));
        }
        Ok(at.page(versions))
    }

    /// Makes a version answer from now on.
    pub(crate) async fn activate_version(&self, map: Uuid, version: u32) -> ApiResult<Map> {
        self.version(map, Some(version)).await?;
        sqlx::query("UPDATE maps SET active_version = ?2 WHERE id = ?1")
            .bind(map.to_string())
            .bind(version)
            .execute(&self.writer)
            .await?;
        self.map(map).await
    }

    /// Renames a map.
    pub(crate) async fn rename_map(&self, map: Uuid, name: &str) -> ApiResult<Map> {
        sqlx::query("UPDATE maps SET name = ?2 WHERE id = ?1")
            .bind(map.to_string())
            .bind(name)
            .execute(&self.writer)
            .await?;
        self.map(map).await
    }

    /// Whether there was one to delete.
    pub(crate) async fn delete_map(&self, map: Uuid) -> ApiResult<bool> {
        let result = sqlx::query("DELETE FROM maps WHERE id = ?1")
            .bind(map.to_string())
            .execute(&self.writer)
            .await?;
        Ok(result.rows_affected() > 0)
    }

    /// What an identity has made already: version and residuals.
    pub(crate) async fn version_by_key(
        &self,
        identity: &Identity,
        request: &str,
    ) -> ApiResult<Option<(MapVersion, serde_json::Value)>> {
        let row = sqlx::query("SELECT * FROM map_versions WHERE request_key = ?1")
            .bind(identity.id.to_string())
            .fetch_optional(&self.readers)
            .await?;
        let Some(row) = row else { return Ok(None) };
        same_request(row.try_get("request")?, request)?;
        let residuals = row.try_get::<Option<&str>, _>("residuals")?.map(json).transpose()?;
        Ok(Some((self.with_files(&row).await?, residuals.unwrap_or_default())))
    }

    /// Makes a version of an existing map visible.
    pub(crate) async fn insert_map_version(&self, new: &NewVersion) -> ApiResult<MapVersion> {
        let mut tx = self.begin().await?;
        let row = sqlx::query("SELECT EXISTS (SELECT 1 FROM maps WHERE id = ?1) AS known")
            .bind(new.map_id.to_string())
            .fetch_one(&mut *tx)
            .await?;
        if row.try_get::<i64, _>("known")? == 0 {
            return Err(ApiError::new(Code::NotFound, "the map was deleted meanwhile"));
        }
        let version = insert_version(&mut tx, new, clock::now_ms()).await?;
        tx.commit().await?;
        self.version(new.map_id, Some(version)).await
    }
}

/// Makes a version visible once the transaction commits; the map too, if it is new.
pub(super) async fn insert_version(
    tx: &mut SqliteConnection,
    new: &NewVersion,
    now: i64,
) -> Result<u32, sqlx::Error> {
    let map = new.map_id.to_string();
    let row = sqlx::query(
        "SELECT COALESCE(MAX(version), 0) + 1 AS next FROM map_versions WHERE map_id = ?1",
    )
    .bind(&map)
    .fetch_one(&mut *tx)
    .await?;
    let version: u32 = row.try_get("next")?;
    sqlx::query(
        "INSERT INTO maps (id, name, active_version, created_ms) VALUES (?1, ?2, ?3, ?4)
         ON CONFLICT (id) DO UPDATE SET active_version = IIF(?5, ?3, active_version)",
    )
    .bind(&map)
    .bind(&new.name)
    .bind(version)
    .bind(now)
    .bind(new.activate || version == 1)
    .execute(&mut *tx)
    .await?;
    sqlx::query(
        "INSERT INTO map_versions (map_id, version, job_id, parent_version, request_key, request,
         info, residuals, created_ms) VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9)",
    )
    .bind(&map)
    .bind(version)
    .bind(new.job_id.map(|id| id.to_string()))
    .bind(new.parent_version)
    .bind(new.request.as_ref().map(|(key, _)| key))
    .bind(new.request.as_ref().map(|(_, text)| text))
    .bind(new.info.to_string())
    .bind(new.residuals.as_ref().map(|residuals| residuals.to_string()))
    .bind(now)
    .execute(&mut *tx)
    .await?;
    for file in &new.files {
        insert_blob(tx, &file.sha256, file.size, now).await?;
        sqlx::query(
            "INSERT INTO map_files (map_id, version, path, sha256, size)
             VALUES (?1, ?2, ?3, ?4, ?5)",
        )
        .bind(&map)
        .bind(version)
        .bind(&file.path)
        .bind(&file.sha256)
        .bind(file.size as i64)
        .execute(&mut *tx)
        .await?;
    }
    Ok(version)
}
