//! Leases of drones.

use std::sync::Arc;

use axum::{Json, extract::State, http::HeaderMap};
use uuid::Uuid;
use volery_api::{CreateLease, Lease, Page};

use crate::{
    answer::{Created, Deleted},
    auth::{Caller, Pilot, Viewer},
    error::{ApiError, ApiResult, Code},
    extract::{At, Body},
    fleet::LeaseRefusal,
    idempotency::Identity,
    state::App,
};

/// Takes drones: nobody else commands them while the lease lasts, and they hold when it is over.
/// `POST /v1/all-stop` needs no lease.
#[utoipa::path(post, path = "/v1/leases", tag = "drones", request_body = CreateLease,
    params(("Idempotency-Key" = Option<String>, Header, description = "Names this request")),
    responses((status = 201, description = "The lease, to be renewed in time", body = Lease)))]
pub(crate) async fn create_lease(
    State(app): State<Arc<App>>,
    Pilot(caller): Pilot,
    headers: HeaderMap,
    Body(request): Body<CreateLease>,
) -> ApiResult<Created<Lease>> {
    let identity = Identity::of(&caller, "/v1/leases", &headers)?;
    let lease = take(&app, &caller, identity, &request)?;
    Ok(Created(format!("/v1/leases/{}", lease.id), lease))
}

/// Takes a lease for a caller who may command drones.
pub(crate) fn take(
    app: &App,
    caller: &Caller,
    identity: Identity,
    request: &CreateLease,
) -> ApiResult<Lease> {
    let lease = app.drones()?.lease(caller, identity, request).map_err(refused)?;
    tracing::info!(token = %caller.id, lease = %lease.id, drones = ?lease.drones, ttl_ms = lease.ttl_ms,
        "drones {:?} are leased by {}", lease.drones, lease.holder);
    Ok(lease)
}

/// Leases that are not over.
#[utoipa::path(get, path = "/v1/leases", tag = "drones",
    responses((status = 200, description = "Leases", body = Page<Lease>)))]
pub(crate) async fn list_leases(
    State(app): State<Arc<App>>,
    _caller: Viewer,
) -> ApiResult<Json<Page<Lease>>> {
    Ok(Json(Page { items: app.drones()?.leases(), next_cursor: None }))
}

/// Renews a lease: from now on it lasts for its whole time again.
#[utoipa::path(post, path = "/v1/leases/{id}/renew", tag = "drones",
    params(("id" = Uuid, Path, description = "Of the lease")),
    responses((status = 200, description = "The lease", body = Lease)))]
pub(crate) async fn renew_lease(
    State(app): State<Arc<App>>,
    Pilot(caller): Pilot,
    At(id): At<Uuid>,
) -> ApiResult<Json<Lease>> {
    renew(&app, &caller, id).map(Json)
}

/// Renews a lease of a caller.
pub(crate) fn renew(app: &App, caller: &Caller, id: Uuid) -> ApiResult<Lease> {
    app.drones()?.renew_lease(caller, id).map_err(refused)
}

/// Ends a lease: its drones hold.
#[utoipa::path(delete, path = "/v1/leases/{id}", tag = "drones",
    params(("id" = Uuid, Path, description = "Of the lease")),
    responses((status = 204, description = "It is over")))]
pub(crate) async fn delete_lease(
    State(app): State<Arc<App>>,
    Pilot(caller): Pilot,
    At(id): At<Uuid>,
) -> ApiResult<Deleted> {
    release(&app, &caller, id).map(|()| Deleted)
}

/// Ends a lease of a caller.
pub(crate) fn release(app: &App, caller: &Caller, id: Uuid) -> ApiResult<()> {
    app.drones()?.release(caller, id).map_err(refused)?;
    tracing::info!(token = %caller.id, lease = %id, "lease {id} is given back");
    Ok(())
}

pub(super) fn refused(refusal: LeaseRefusal) -> ApiError {
    let code = match &refusal {
        LeaseRefusal::Leased { .. } => Code::Conflict("drone_leased"),
        LeaseRefusal::NotHolder(_) => Code::Conflict("not_lease_holder"),
        LeaseRefusal::Bad => Code::Unprocessable("bad_lease"),
        LeaseRefusal::NotHeard(_) | LeaseRefusal::Over(_) => Code::NotFound,
    };
    ApiError::new(code, refusal.to_string())
}
