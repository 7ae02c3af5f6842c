//! Cameras that are pulled.

use sqlx::Row;
use volery_api::PutDroneCamera;

use super::{Store, json};
use crate::error::ApiResult;

impl Store {
    /// Keeps the camera of a drone.
    pub(crate) async fn put_drone_camera(
        &self,
        drone: u8,
        camera: &PutDroneCamera,
    ) -> ApiResult<()> {
        sqlx::query(
            "INSERT INTO drone_cameras (drone, settings) VALUES (?1, ?2)
             ON CONFLICT (drone) DO UPDATE SET settings = ?2",
        )
        .bind(drone)
        .bind(serde_json::to_string(camera)?)
        .execute(&self.writer)
        .await?;
        Ok(())
    }

    /// Forgets the camera of a drone.
    pub(crate) async fn delete_drone_camera(&self, drone: u8) -> ApiResult<()> {
        sqlx::query("DELETE FROM drone_cameras WHERE drone = ?1")
            .bind(drone)
            .execute(&self.writer)
            .await?;
        Ok(())
    }

    /// All cameras, by the system id of their drones.
    pub(crate) async fn drone_cameras(&self) -> ApiResult<Vec<(u8, PutDroneCamera)>> {
        let rows = sqlx::query("SELECT drone, settings FROM drone_cameras ORDER BY drone")
            .fetch_all(&self.readers)
            .await?;
        let cameras =
            rows.iter().map(|row| Ok((row.try_get("drone")?, json(row.try_get("settings")?)?)));
        Ok(cameras.collect::<Result<_, sqlx::Error>>()?)
    }
}
