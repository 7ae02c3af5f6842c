//! Cameras.

use sqlx::{Row, sqlite::SqliteRow};
use uuid::Uuid;
use volery_api::{CreateCamera, Page, StoredCamera};

use super::{PageAt, Store, json, uuid};
use crate::{
    clock,
    error::{ApiError, ApiResult},
    idempotency::{Identity, same_request},
};

impl Store {
    /// Keeps a camera; the same identity and request gives the same camera again.
    pub(crate) async fn insert_camera(
        &self,
        identity: &Identity,
        request: &CreateCamera,
    ) -> ApiResult<StoredCamera> {
        let text = serde_json::to_string(request)?;
        sqlx::query(
            "INSERT INTO cameras (id, request, name, camera, created_ms)
             VALUES (?1, ?2, ?3, ?4, ?5) ON CONFLICT (id) DO NOTHING",
        )
        .bind(identity.id.to_string())
        .bind(&text)
        .bind(&request.name)
        .bind(serde_json::to_string(&request.camera)?)
        .bind(clock::now_ms())
        .execute(&self.writer)
        .await?;
        let row = sqlx::query("SELECT * FROM cameras WHERE id = ?1")
            .bind(identity.id.to_string())
            .fetch_one(&self.writer)
            .await?;
        same_request(row.try_get("request")?, &text)?;
        Ok(camera(&row)?)
    }

    /// Another name and other intrinsics.
    pub(crate) async fn replace_camera(
        &self,
        id: Uuid,
        request: &CreateCamera,
    ) -> ApiResult<StoredCamera> {
        let row =
            sqlx::query("UPDATE cameras SET name = ?2, camera = ?3 WHERE id = ?1 RETURNING *")
                .bind(id.to_string())
                .bind(&request.name)
                .bind(serde_json::to_string(&request.camera)?)
                .fetch_optional(&self.writer)
                .await?
                .ok_or_else(|| ApiError::not_found("camera", id))?;
        Ok(camera(&row)?)
    }

    /// By id.
    pub(crate) async fn camera(&self, id: Uuid) -> ApiResult<StoredCamera> {
        let row = sqlx::query("SELECT * FROM cameras WHERE id = ?1")
            .bind(id.to_string())
            .fetch_optional(&self.readers)
            .await?
            .ok_or_else(|| ApiError::not_found("camera", id))?;
        Ok(camera(&row)?)
    }

    /// In the order of their making.
    pub(crate) async fn cameras(&self, at: PageAt) -> ApiResult<Page<StoredCamera>> {
        let rows = sqlx::query("SELECT * FROM cameras WHERE seq > ?1 ORDER BY seq LIMIT ?2")
            .bind(at.after)
            .bind(at.limit + 1)
            .fetch_all(&self.readers)
            .await?;
        let cameras = rows.iter().map(|row| Ok((row.try_get("seq")?, camera(row)?)));
        Ok(at.page(cameras.collect::<Result<_, sqlx::Error>>()?))
    }
}

fn camera(row: &SqliteRow) -> Result<StoredCamera, sqlx::Error> {
    Ok(StoredCamera {
        id: uuid(row.try_get("id")?)?,
        name: row.try_get("name")?,
        camera: json(row.try_get("camera")?)?,
        created: clock::rfc3339(row.try_get("created_ms")?),
    })
}
