//! Group flights and fences.

use std::sync::Arc;

use axum::{Json, extract::State};
use uuid::Uuid;
use volery_api::{CreateFlight, Flight, Geofence};

use super::drones::drones;
use crate::{
    answer::{Accepted, Created},
    auth::{Caller, Pilot, Viewer},
    error::{ApiError, ApiResult, Code},
    extract::{At, Body},
    flights::{FlightRefusal, Space, Wish, parse_fence, plan},
    state::App,
};

/// Plans a flight and checks the plan as a whole: speeds, distances between drones, fence. A plan
/// that breaks a rule is refused with the rule, the drones, the time and the place.
#[utoipa::path(post, path = "/v1/flights", tag = "flights", request_body = CreateFlight,
    responses((status = 201, description = "The flight, ready to start", body = Flight)))]
pub(crate) async fn create_flight(
    State(app): State<Arc<App>>,
    _caller: Pilot,
    Body(request): Body<CreateFlight>,
) -> ApiResult<Created<Flight>> {
    drones(&app)?;
    let version = app.store.version(request.map_id, None).await?;
    let fence = app.store.geofence(request.map_id).await?;
    let space = Space::of(request.map_id, &version.info, fence.as_ref())?;
    // Planning may take a second with many drones, and the drones' link must not wait for it.
    let fleet = drones(&app)?.flights(|_, fleet, _| fleet.clone());
    let map = space.map;
    let conductor = tokio::task::spawn_blocking(move || plan(&request, space, &fleet)).await??;
    let id = Uuid::now_v7();
    let flight = drones(&app)?.flights(|flights, _, _| flights.insert(id, map, conductor));
    Ok(Created(format!("/v1/flights/{id}"), flight.map_err(refused)?))
}

/// All flights since the service started, the oldest first.
#[utoipa::path(get, path = "/v1/flights", tag = "flights",
    responses((status = 200, description = "Flights", body = Vec<Flight>)))]
pub(crate) async fn list_flights(
    State(app): State<Arc<App>>,
    _caller: Viewer,
) -> ApiResult<Json<Vec<Flight>>> {
    Ok(Json(drones(&app)?.flights(|flights, _, _| flights.list())))
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
    let flight = drones(&app)?.flights(|flights, _, _| flights.get(id));
    flight.map(Json).ok_or_else(|| ApiError::not_found("flight", id))
}

/// Takes off with those who stand beneath their starts, and flies when all are there.
#[utoipa::path(post, path = "/v1/flights/{id}/start", tag = "flights",
    params(("id" = Uuid, Path, description = "Of the flight")),
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
    params(("id" = Uuid, Path, description = "Of the flight")),
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
    params(("id" = Uuid, Path, description = "Of the flight")),
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
    params(("id" = Uuid, Path, description = "Of the flight")),
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

fn wish(app: &App, caller: &Caller, id: Uuid, wish: Wish) -> ApiResult<Accepted<Flight>> {
    let flight = drones(app)?.wish(caller, id, wish).map_err(refused)?;
    Ok(Accepted(format!("/v1/flights/{id}"), flight))
}

fn refused(refusal: FlightRefusal) -> ApiError {
    let code = match &refusal {
        FlightRefusal::Unknown => Code::NotFound,
        refusal => Code::Conflict(refusal.code()),
    };
    ApiError::new(code, refusal.to_string())
}
