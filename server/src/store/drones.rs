//! Drones that are registered.

use sqlx::Row;
use volery_api::PutDrone;

use super::{Store, json};
use crate::error::ApiResult;

impl Store {
    /// Keeps the settings of a drone.
    pub(crate) async fn put_drone(&self, id: u8, drone: &PutDrone) -> ApiResult<()> {
        sqlx::query(
            "INSERT INTO drones (id, settings) VALUES (?1, ?2)
             ON CONFLICT (id) DO UPDATE SET settings = ?2",
        )
        .bind(id)
        .bind(serde_json::to_string(drone)?)
        .execute(&self.writer)
        .await?;
        Ok(())
    }

    /// Forgets the settings of a drone.
    pub(crate) async fn delete_drone(&self, id: u8) -> ApiResult<()> {
        sqlx::query("DELETE FROM drones WHERE id = ?1").bind(id).execute(&self.writer).await?;
        Ok(())
    }

    /// All settings, by system id.
    pub(crate) async fn drones(&self) -> ApiResult<Vec<(u8, PutDrone)>> {
        let rows = sqlx::query("SELECT id, settings FROM drones ORDER BY id")
            .fetch_all(&self.readers)
            .await?;
        let drones =
            rows.iter().map(|row| Ok((row.try_get("id")?, json(row.try_get("settings")?)?)));
        Ok(drones.collect::<Result<_, sqlx::Error>>()?)
    }
}
