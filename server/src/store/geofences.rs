//! Where drones may fly.

use sqlx::Row;
use uuid::Uuid;
use volery_api::Geofence;

use super::{Store, json};
use crate::error::{ApiError, ApiResult};

impl Store {
    /// Keeps the fence of a map in place of the one before.
    pub(crate) async fn put_geofence(&self, fence: &Geofence) -> ApiResult<()> {
        if !self.has_map(fence.map_id).await? {
            return Err(ApiError::not_found("map", fence.map_id));
        }
        sqlx::query(
            "INSERT INTO geofences (map_id, fence) VALUES (?1, ?2)
             ON CONFLICT (map_id) DO UPDATE SET fence = excluded.fence",
        )
        .bind(fence.map_id.to_string())
        .bind(serde_json::to_string(fence)?)
        .execute(&self.writer)
        .await?;
        Ok(())
    }

    /// Whether there was one to delete.
    pub(crate) async fn delete_geofence(&self, map: Uuid) -> ApiResult<bool> {
        let result = sqlx::query("DELETE FROM geofences WHERE map_id = ?1")
            .bind(map.to_string())
            .execute(&self.writer)
            .await?;
        Ok(result.rows_affected() > 0)
    }

    /// The fence of a map.
    pub(crate) async fn geofence(&self, map: Uuid) -> ApiResult<Option<Geofence>> {
        let row = sqlx::query("SELECT fence FROM geofences WHERE map_id = ?1")
            .bind(map.to_string())
            .fetch_optional(&self.readers)
            .await?;
        Ok(row.map(|row| json(row.try_get("fence")?)).transpose()?)
    }

    /// The fences of all maps.
    pub(crate) async fn geofences(&self) -> ApiResult<Vec<Geofence>> {
        let rows = sqlx::query("SELECT fence FROM geofences ORDER BY map_id")
            .fetch_all(&self.readers)
            .await?;
        let fences = rows.iter().map(|row| json(row.try_get("fence")?));
        Ok(fences.collect::<Result<_, sqlx::Error>>()?)
    }
}
