//! Group flights and fences.

use std::sync::Arc;

use axum::{
    Json,
    extract::State,
    response::{IntoResponse, Response},
};
use uuid::Uuid;
use volery_api::{CreateFlight, CreateTarget, Flight, Geofence, MapVersion, Target};
use volery_flight::{VehicleId, group::Air};
use volery_formats::read_occupancy;

use super::drones::not_heard;
use crate::{
    answer::{Accepted, Created, Deleted},
    auth::{Caller, Pilot, Viewer},
    error::{ApiError, ApiResult, Code},
    extract::{At, Body},
    flights::{
        FlightRefusal, PlannedTarget, Space, Wish, parse_fence, plan, plan_target, under_way,
    },
    state::App,
};

/// Room that a drone needs to all sides, with what it strays. Meters.
const DRONE_RADIUS: f64 = 0.3;

/// Plans a flight and checks the plan as a whole: speeds, distances between drones, fence. A plan
/// that breaks a rule is refused with the rule, the drones, the time and the place.
#[utoipa::path(post, path = "/v1/flights", tag = "flights", request_body = CreateFlight,
    params(("Idempotency-Key" = Option<String>, Header, description = "Names this request")),
    responses((status = 201, description = "The flight, ready to start", body = Flight)))]
pub(crate) async fn create_flight(
    State(app): State<Arc<App>>,
    _caller: Pilot,
    Body(request): Body<CreateFlight>,
) -> ApiResult<Created<Flight>> {
    app.drones()?;
    let version = app.store.version(request.map_id, None).await?;
    let fence = app.store.geofence(request.map_id).await?;
    let mut space = Space::of(request.map_id, &version.info, fence.as_ref())?;
    space.air = air(&app, &version, request.allow_unseen).await?;
    let own: Vec<VehicleId> = request.drones.iter().map(|drone| VehicleId(drone.id)).collect();
    // Planning may take a second with many drones, and the drones' link must not wait for it.
    let (fleet, others) = app
        .drones()?
        .read_flights(|flights, fleet, _| (fleet.clone(), flights.others(&own, fleet)));
    let map = space.map;
    let planned = tokio::task::spawn_blocking(move || plan(&request, space, &fleet, others));
    let conductor = planned.await??;
    let id = Uuid::now_v7();
    let flight = app.drones()?.flights(|flights, _, _| flights.insert(id, map, conductor));
    Ok(Created(format!("/v1/flights/{id}"), flight.map_err(refused)?))
}

/// Flies a drone that hovers to a place, by legs that are checked before: `dry_run` only tells
/// them. A newer target takes the place of the one before.
#[utoipa::path(post, path = "/v1/drones/{id}/target", tag = "drones", request_body = CreateTarget,
    params(("id" = u8, Path, description = "MAVLink system id"),
        ("Idempotency-Key" = Option<String>, Header, description = "Names this request")),
    responses((status = 200, description = "The way, not flown (`dry_run`)", body = Target),
        (status = 202, description = "The way; its flight is at `Location`", body = Target)))]
pub(crate) async fn fly_to_target(
    State(app): State<Arc<App>>,
    Pilot(caller): Pilot,
    At(id): At<u8>,
    Body(request): Body<CreateTarget>,
) -> ApiResult<Response> {
    let vehicle = VehicleId(id);
    app.drones()?.get(id).ok_or_else(|| not_heard(id))?;
    let version = app.store.version(request.map_id, None).await?;
    let fence = app.store.geofence(request.map_id).await?;
    let mut space = Space::of(request.map_id, &version.info, fence.as_ref())?;
    space.air = air(&app, &version, request.allow_unseen).await?;
    let (fleet, others, now) = app.drones()?.read_flights(|flights, fleet, now| {
        (fleet.clone(), flights.others(&[vehicle], fleet), now)
    });
    let (map, dry_run) = (space.map, request.dry_run);
    let planned =
        tokio::task::spawn_blocking(move || plan_target(id, &request, space, &fleet, others, now));
    let PlannedTarget { target, flight } = planned.await??;
    if dry_run {
        return Ok(Json(target).into_response());
    }
    let flight = app.drones()?.fly_to(&caller, id, map, flight?).map_err(refused)?;
    tracing::info!(token = %caller.id, drone = id, flight = %flight.id, "drone {id} flies to a target");
    let target = under_way(target, flight.id);
    Ok(Accepted(format!("/v1/flights/{}", flight.id), target).into_response())
}

/// What a map says of room for drones.
async fn air(app: &App, version: &MapVersion, unseen: bool) -> ApiResult<Option<Air>> {
    let Some(file) = version.files.iter().find(|file| file.path == "freespace.bin") else {
        return Ok(None);
    };
    let sha256 = file.sha256.clone();
    let grid = app
        .with_blobs(move |blobs| {
            let bytes = std::fs::read(blobs.path(&sha256))?;
            read_occupancy(&bytes).map_err(std::io::Error::other)
        })
        .await?;
    Ok(Some(Air::new(Arc::new(grid), DRONE_RADIUS, unseen)))
}

/// All flights since the service started, the oldest first.
#[utoipa::path(get, path = "/v1/flights", tag = "flights",
    responses((status = 200, description = "Flights", body = Vec<Flight>)))]
pub(crate) async fn list_flights(
    State(app): State<Arc<App>>,
    _caller: Viewer,
) -> ApiResult<Json<Vec<Flight>>> {
    Ok(Json(app.drones()?.read_flights(|flights, _, _| flights.list())))
}

/// One flight: its plan, its state, what happened.
#[utoipa::path(get, path = "/v1/flights/{id}", tag = "flights",
    params(("id" = Uuid, Path, description = "Of the flight")),
    responses((status = 200, description = "The flight", body = Flight)))]
pub(crate) async fn get_flight(
    State(app): State<Arc<App>>,
    _caller: Viewer,
    At(id): At<Uuid>,
) -> ApiResult<Json<Flight>> {
    let flight = app.drones()?.read_flights(|flights, _, _| flights.get(id));
    flight.map(Json).ok_or_else(|| ApiError::not_found("flight", id))
}

/// Takes off with those who stand beneath their starts, and flies when all are there.
#[utoipa::path(post, path = "/v1/flights/{id}/start", tag = "flights",
    params(("id" = Uuid, Path, description = "Of the flight"),
        ("Idempotency-Key" = Option<String>, Header, description = "Names this request")),
    responses((status = 202, description = "The flight", body = Flight)))]
pub(crate) async fn start_flight(
    State(app): State<Arc<App>>,
    Pilot(caller): Pilot,
    At(id): At<Uuid>,
) -> ApiResult<Accepted<Flight>> {
    wish(&app, &caller, id, Wish::Start)
}

/// Everybody waits in the air.
#[utoipa::path(post, path = "/v1/flights/{id}/pause", tag = "flights",
    params(("id" = Uuid, Path, description = "Of the flight"),
        ("Idempotency-Key" = Option<String>, Header, description = "Names this request")),
    responses((status = 202, description = "The flight", body = Flight)))]
pub(crate) async fn pause_flight(
    State(app): State<Arc<App>>,
    Pilot(caller): Pilot,
    At(id): At<Uuid>,
) -> ApiResult<Accepted<Flight>> {
    wish(&app, &caller, id, Wish::Pause)
}

/// Goes on after a pause.
#[utoipa::path(post, path = "/v1/flights/{id}/resume", tag = "flights",
    params(("id" = Uuid, Path, description = "Of the flight"),
        ("Idempotency-Key" = Option<String>, Header, description = "Names this request")),
    responses((status = 202, description = "The flight", body = Flight)))]
pub(crate) async fn resume_flight(
    State(app): State<Arc<App>>,
    Pilot(caller): Pilot,
    At(id): At<Uuid>,
) -> ApiResult<Accepted<Flight>> {
    wish(&app, &caller, id, Wish::Resume)
}

/// Everybody lands, one above another waiting until the place beneath is free.
#[utoipa::path(post, path = "/v1/flights/{id}/abort", tag = "flights",
    params(("id" = Uuid, Path, description = "Of the flight"),
        ("Idempotency-Key" = Option<String>, Header, description = "Names this request")),
    responses((status = 202, description = "The flight", body = Flight)))]
pub(crate) async fn abort_flight(
    State(app): State<Arc<App>>,
    Pilot(caller): Pilot,
    At(id): At<Uuid>,
) -> ApiResult<Accepted<Flight>> {
    wish(&app, &caller, id, Wish::Abort)
}

/// The fences of all maps that have one.
#[utoipa::path(get, path = "/v1/geofences", tag = "flights",
    responses((status = 200, description = "Fences", body = Vec<Geofence>)))]
pub(crate) async fn list_geofences(
    State(app): State<Arc<App>>,
    _caller: Viewer,
) -> ApiResult<Json<Vec<Geofence>>> {
    Ok(Json(app.store.geofences().await?))
}

/// Sets the fence of a map for flights planned from now on. Without one, flights keep 0.5 m inside
/// the bounds of the map.
#[utoipa::path(put, path = "/v1/geofences", tag = "flights", request_body = Geofence,
    responses((status = 200, description = "The fence", body = Geofence)))]
pub(crate) async fn put_geofence(
    State(app): State<Arc<App>>,
    _caller: Pilot,
    Body(fence): Body<Geofence>,
) -> ApiResult<Json<Geofence>> {
    parse_fence(&fence)?;
    app.store.put_geofence(&fence).await?;
    Ok(Json(fence))
}

/// Takes the fence of a map away: flights planned from now on keep inside the bounds of the map.
#[utoipa::path(delete, path = "/v1/geofences/{id}", tag = "flights",
    params(("id" = Uuid, Path, description = "Of the map")),
    responses((status = 204, description = "Gone")))]
pub(crate) async fn delete_geofence(
    State(app): State<Arc<App>>,
    _caller: Pilot,
    At(id): At<Uuid>,
) -> ApiResult<Deleted> {
    if app.store.delete_geofence(id).await? {
        Ok(Deleted)
    } else {
        Err(ApiError::not_found("fence of map", id))
    }
}

fn wish(app: &App, caller: &Caller, id: Uuid, wish: Wish) -> ApiResult<Accepted<Flight>> {
    let flight = app.drones()?.wish(caller, id, wish).map_err(refused)?;
    Ok(Accepted(format!("/v1/flights/{id}"), flight))
}

pub(super) fn refused(refusal: FlightRefusal) -> ApiError {
    let code = match &refusal {
        FlightRefusal::Unknown => Code::NotFound,
        refusal => Code::Conflict(refusal.code()),
    };
    ApiError::new(code, refusal.to_string())
}
