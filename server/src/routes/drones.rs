//! Drones.

use std::sync::Arc;

use axum::{
    Extension, Json,
    extract::State,
    response::{IntoResponse, Response},
};
use volery_api::{
    AllStopped, Drone, DroneCommand, DroneCommandStatus, DroneEvent, DronePose, DronePoseAnswer,
    DroneState, EventsQuery, Page, PatchDrone, PutDrone,
};
use volery_flight::CommandRefusal;

use super::{flights, jobs::at_most, leases, tokens::check_name};
use crate::{
    answer::{Accepted, Deleted},
    audit::Detail,
    auth::{Admin, Pilot, Stopper, Viewer},
    error::{ApiError, ApiResult, Code},
    extract::{Asked, At, Body},
    fleet::{NotCommanded, parse_key},
    state::App,
    streams::check_system_id,
};

pub(super) fn not_heard(id: u8) -> ApiError {
    ApiError::not_found("drone", id).hint("GET /v1/drones lists the drones that are heard")
}

/// Lists drones that are registered or were heard.
#[utoipa::path(get, path = "/v1/drones", tag = "drones",
    responses((status = 200, description = "Drones", body = Page<Drone>)))]
pub(crate) async fn list_drones(
    State(app): State<Arc<App>>,
    _caller: Viewer,
) -> ApiResult<Json<Page<Drone>>> {
    Ok(Json(Page { items: app.drones()?.list(), next_cursor: None }))
}

/// One drone.
#[utoipa::path(get, path = "/v1/drones/{id}", tag = "drones",
    params(("id" = u8, Path, description = "MAVLink system id")),
    responses((status = 200, description = "The drone", body = Drone)))]
pub(crate) async fn get_drone(
    State(app): State<Arc<App>>,
    _caller: Viewer,
    At(id): At<u8>,
) -> ApiResult<Json<Drone>> {
    app.drones()?.get(id).map(Json).ok_or_else(|| not_heard(id))
}

/// Registers a drone or replaces its settings. Drones need not be registered to be heard.
#[utoipa::path(put, path = "/v1/drones/{id}", tag = "drones", request_body = PutDrone,
    params(("id" = u8, Path, description = "MAVLink system id")),
    responses((status = 200, description = "The drone", body = Drone)))]
pub(crate) async fn put_drone(
    State(app): State<Arc<App>>,
    _caller: Admin,
    At(id): At<u8>,
    Body(drone): Body<PutDrone>,
) -> ApiResult<Json<Drone>> {
    save(&app, id, drone).await.map(Json)
}

/// Changes settings of a registered drone; what is not named stays, also its key.
#[utoipa::path(patch, path = "/v1/drones/{id}", tag = "drones", request_body = PatchDrone,
    params(("id" = u8, Path, description = "MAVLink system id")),
    responses((status = 200, description = "The drone", body = Drone)))]
pub(crate) async fn patch_drone(
    State(app): State<Arc<App>>,
    _caller: Admin,
    At(id): At<u8>,
    Body(change): Body<PatchDrone>,
) -> ApiResult<Json<Drone>> {
    let known = app.drones()?.settings(id).ok_or_else(|| {
        ApiError::not_found("registered drone", id).hint("PUT /v1/drones/{id} registers it")
    })?;
    save(&app, id, change.applied_to(known)).await.map(Json)
}

/// Keeps settings that make sense, and flies by them.
async fn save(app: &App, id: u8, drone: PutDrone) -> ApiResult<Drone> {
    let drones = app.drones()?;
    check_name(&drone.name)?;
    if drone.signing_key.as_deref().is_some_and(|key| parse_key(key).is_none()) {
        let code = Code::Unprocessable("bad_signing_key");
        return Err(ApiError::new(code, "a signing key has 64 hex digits"));
    }
    if let Some(problem) = drone.body_from_camera.problem() {
        return Err(ApiError::new(Code::Unprocessable("bad_camera_mount"), problem));
    }
    check_system_id(id)?;
    app.store.put_drone(id, &drone).await?;
    drones.register(id, drone);
    drones.get(id).ok_or_else(|| not_heard(id))
}

/// Takes the settings of a drone away, and its camera if it is pulled; one that is still heard stays in the list.
#[utoipa::path(delete, path = "/v1/drones/{id}", tag = "drones",
    params(("id" = u8, Path, description = "MAVLink system id")),
    responses((status = 204, description = "Gone")))]
pub(crate) async fn delete_drone(
    State(app): State<Arc<App>>,
    _caller: Admin,
    At(id): At<u8>,
) -> ApiResult<Deleted> {
    let drones = app.drones()?;
    app.sources.delete(&app, id).await?;
    app.store.delete_drone(id).await?;
    if drones.unregister(id) { Ok(Deleted) } else { Err(not_heard(id)) }
}

/// What a drone says of itself, and what it is told.
#[utoipa::path(get, path = "/v1/drones/{id}/state", tag = "drones",
    params(("id" = u8, Path, description = "MAVLink system id")),
    responses((status = 200, description = "Its state", body = DroneState)))]
pub(crate) async fn drone_state(
    State(app): State<Arc<App>>,
    _caller: Viewer,
    At(id): At<u8>,
) -> ApiResult<Json<DroneState>> {
    app.drones()?.state(id).map(Json).ok_or_else(|| not_heard(id))
}

/// What happened to a drone lately.
#[utoipa::path(get, path = "/v1/drones/{id}/events", tag = "drones",
    params(("id" = u8, Path, description = "MAVLink system id"), EventsQuery),
    responses((status = 200, description = "Events", body = Page<DroneEvent>)))]
pub(crate) async fn drone_events(
    State(app): State<Arc<App>>,
    _caller: Viewer,
    At(id): At<u8>,
    Asked(query): Asked<EventsQuery>,
) -> ApiResult<Json<Page<DroneEvent>>> {
    let limit = at_most(&query)?;
    let mut items = app.drones()?.events(id, query.after.unwrap_or(0));
    items.truncate(limit as usize);
    Ok(Json(Page { items, next_cursor: None }))
}

/// Commands a drone. The newest command takes the place of the one before.
#[utoipa::path(post, path = "/v1/drones/{id}/commands", tag = "drones", request_body = DroneCommand,
    params(("id" = u8, Path, description = "MAVLink system id"),
        ("Idempotency-Key" = Option<String>, Header, description = "Names this request")),
    responses((status = 202, description = "It will be sent", body = DroneCommandStatus)))]
pub(crate) async fn command_drone(
    State(app): State<Arc<App>>,
    Pilot(caller): Pilot,
    At(id): At<u8>,
    Body(command): Body<DroneCommand>,
) -> ApiResult<Response> {
    let detail = Detail(serde_json::to_string(&command)?);
    let answer = match app.drones()?.command(&caller, id, &command) {
        Ok(status) => {
            tracing::info!(token = %caller.id, drone = id, ?command, "drone {id} is commanded");
            let location = format!("/v1/drones/{id}/commands/{}", status.id);
            Accepted(location, status).into_response()
        }
        Err(refusal) => refused(id, refusal).into_response(),
    };
    Ok((Extension(detail), answer).into_response())
}

/// How far a command is.
#[utoipa::path(get, path = "/v1/drones/{id}/commands/{command}", tag = "drones",
    params(("id" = u8, Path, description = "MAVLink system id"),
        ("command" = u64, Path, description = "As answered")),
    responses((status = 200, description = "How far it is", body = DroneCommandStatus)))]
pub(crate) async fn drone_command(
    State(app): State<Arc<App>>,
    _caller: Viewer,
    At((id, command)): At<(u8, u64)>,
) -> ApiResult<Json<DroneCommandStatus>> {
    app.drones()?
        .command_status(command)
        .filter(|status| status.drone == id)
        .map(Json)
        .ok_or_else(|| ApiError::not_found("command", command))
}

/// Tells where a drone is, from any source that knows it: the pose goes to the drone's estimator
/// if it is fresh and where the drone's own motion can have brought it.
#[utoipa::path(post, path = "/v1/drones/{id}/pose", tag = "drones", request_body = DronePose,
    params(("id" = u8, Path, description = "MAVLink system id")),
    responses((status = 200, description = "Whether it was sent", body = DronePoseAnswer)))]
pub(crate) async fn drone_pose(
    State(app): State<Arc<App>>,
    _caller: Pilot,
    At(id): At<u8>,
    Body(pose): Body<DronePose>,
) -> ApiResult<Json<DronePoseAnswer>> {
    let sent = app.drones()?.pose(id, &pose);
    let reason = sent.err().map(|refusal| refusal.to_string());
    Ok(Json(DronePoseAnswer { sent: reason.is_none(), reason }))
}

/// Stops every drone: those in flight stay where they are, motors on the ground go off. It waits
/// for nothing.
#[utoipa::path(post, path = "/v1/all-stop", tag = "drones",
    responses((status = 200, description = "What was commanded", body = AllStopped)))]
pub(crate) async fn all_stop(
    State(app): State<Arc<App>>,
    Stopper(caller): Stopper,
) -> ApiResult<Json<AllStopped>> {
    let stopped = app.drones()?.all_stop();
    tracing::warn!(token = %caller.id, drones = stopped.commands.len(), "all drones are stopped");
    Ok(Json(stopped))
}

fn refused(id: u8, refusal: NotCommanded) -> ApiError {
    let refusal = match refusal {
        NotCommanded::Leased(refusal) => return leases::refused(refusal),
        NotCommanded::Busy(refusal) => return flights::refused(refusal),
        NotCommanded::Refused(refusal) => refusal,
    };
    match refusal {
        CommandRefusal::UnknownVehicle => not_heard(id),
        CommandRefusal::BadNumber => {
            ApiError::new(Code::Unprocessable(refusal.code()), refusal.to_string())
        }
        refusal => ApiError::new(Code::Conflict(refusal.code()), refusal.to_string()),
    }
}
