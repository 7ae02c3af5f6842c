//! Cameras of drones that the service pulls.

use std::sync::Arc;

use axum::{Json, extract::State};
use volery_api::{DroneCamera, PutDroneCamera};

use crate::{
    answer::Deleted,
    auth::Pilot,
    error::{ApiError, ApiResult},
    extract::{At, Body},
    state::App,
};

fn not_pulled(id: u8) -> ApiError {
    ApiError::not_found("pulled camera of drone", id)
        .hint("PUT /v1/drones/{id}/camera has it pulled")
}

/// Has the camera of a drone pulled, in place of the one before: its pictures are followed in the
/// map as those of a stream with `track` and `drone_id`. It goes on until it is deleted, also after
/// a new start of the service; a camera that is gone is tried again.
#[utoipa::path(put, path = "/v1/drones/{id}/camera", tag = "drones", request_body = PutDroneCamera,
    params(("id" = u8, Path, description = "MAVLink system id")),
    responses((status = 200, description = "The camera", body = DroneCamera)))]
pub(crate) async fn put_drone_camera(
    State(app): State<Arc<App>>,
    _caller: Pilot,
    At(id): At<u8>,
    Body(camera): Body<PutDroneCamera>,
) -> ApiResult<Json<DroneCamera>> {
    app.sources.put(&app, id, camera).await.map(Json)
}

/// The camera of a drone that is pulled, and how that goes.
#[utoipa::path(get, path = "/v1/drones/{id}/camera", tag = "drones",
    params(("id" = u8, Path, description = "MAVLink system id")),
    responses((status = 200, description = "The camera", body = DroneCamera)))]
pub(crate) async fn drone_camera(
    State(app): State<Arc<App>>,
    _caller: Pilot,
    At(id): At<u8>,
) -> ApiResult<Json<DroneCamera>> {
    app.sources.get(id).map(Json).ok_or_else(|| not_pulled(id))
}

/// Pulls the camera of a drone no more.
#[utoipa::path(delete, path = "/v1/drones/{id}/camera", tag = "drones",
    params(("id" = u8, Path, description = "MAVLink system id")),
    responses((status = 204, description = "Gone")))]
pub(crate) async fn delete_drone_camera(
    State(app): State<Arc<App>>,
    _caller: Pilot,
    At(id): At<u8>,
) -> ApiResult<Deleted> {
    if app.sources.delete(&app, id).await? { Ok(Deleted) } else { Err(not_pulled(id)) }
}
