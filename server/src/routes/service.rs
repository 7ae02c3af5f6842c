//! The service itself.

use std::sync::Arc;

use axum::{
    Json,
    extract::State,
    http::header,
    response::{IntoResponse, Response},
};
use volery_api::{AuditEntry, Capabilities, Health, HealthCheck, Info, JobKind, Page, PageQuery};

use super::exports::EXPORTS;
use crate::{
    answer::Unready,
    app,
    auth::{Admin, Viewer},
    clock,
    error::ApiResult,
    extract::Asked,
    state::App,
    store::PageAt,
};

/// Whether the process lives.
#[utoipa::path(get, path = "/healthz", tag = "service", security(()),
    responses((status = 200, description = "It lives", body = Health)))]
pub(crate) async fn healthz() -> Json<Health> {
    Json(Health { status: "ok".to_owned(), checks: Vec::new() })
}

/// Whether the service can work: database, disk, worker program.
#[utoipa::path(get, path = "/readyz", tag = "service", security(()),
    responses((status = 200, description = "Ready", body = Health),
        (status = 503, description = "Not ready; the checks say why", body = Health)))]
pub(crate) async fn readyz(State(app): State<Arc<App>>) -> Response {
    let check = |name: &str, problem: Option<String>| HealthCheck {
        name: name.to_owned(),
        ok: problem.is_none(),
        detail: problem,
    };
    let database = app.store.ping().await.err().map(|error| error.detail);
    let disk = app.with_blobs(|blobs| blobs.check_space(0)).await.err().map(|error| error.detail);
    let program = &app.config.worker_program;
    let worker = match tokio::fs::metadata(program).await {
        Ok(file) if file.is_file() => None,
        _ => Some(format!("{} is not a program", program.display())),
    };
    let checks = vec![check("database", database), check("disk", disk), check("worker", worker)];
    let ready = checks.iter().all(|check| check.ok) && !app.closing.is_cancelled();
    let status = if ready { "ok" } else { "unavailable" };
    let health = Health { status: status.to_owned(), checks };
    if ready { Json(health).into_response() } else { Unready(health).into_response() }
}

/// What the service is, can do, and refuses.
#[utoipa::path(get, path = "/v1/info", tag = "service",
    responses((status = 200, description = "Facts and limits", body = Info)))]
pub(crate) async fn info(State(app): State<Arc<App>>, _caller: Viewer) -> Json<Info> {
    let owned = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect();
    Json(Info {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        api: "v1".to_owned(),
        t_ns: clock::now_ns(),
        capabilities: Capabilities {
            stages: owned(&["sfm", "dense", "mesh"]),
            localizers: owned(&["pnp", "template"]),
            exports: owned(&EXPORTS),
            jobs: owned(&JobKind::ALL.map(JobKind::name)),
            mavlink: app.drones.is_some(),
        },
        limits: app.config.limits.clone(),
    })
}

/// Counters in the text format of Prometheus.
#[utoipa::path(get, path = "/metrics", tag = "service",
    responses((status = 200, description = "Counters", body = String, content_type = "text/plain")))]
pub(crate) async fn metrics(State(app): State<Arc<App>>, _caller: Viewer) -> ApiResult<Response> {
    let text = app.metrics.render(&app.store.job_counts().await?);
    Ok(([(header::CONTENT_TYPE, "text/plain; version=0.0.4")], text).into_response())
}

/// This description.
#[utoipa::path(get, path = "/openapi.yaml", tag = "service", security(()),
    responses((status = 200, description = "OpenAPI", content_type = "application/yaml", body = serde_json::Value)))]
pub(crate) async fn openapi_yaml() -> Response {
    ([(header::CONTENT_TYPE, "application/yaml")], app::openapi_yaml()).into_response()
}

/// Who did what when, newest first: every request that changed something or would have, but for
/// what comes many times a second (poses, frames, renewals of leases). Kept for 90 days.
#[utoipa::path(get, path = "/v1/audit", tag = "service", params(PageQuery),
    responses((status = 200, description = "Requests", body = Page<AuditEntry>)))]
pub(crate) async fn audit(
    State(app): State<Arc<App>>,
    _caller: Admin,
    Asked(query): Asked<PageQuery>,
) -> ApiResult<Json<Page<AuditEntry>>> {
    let at = PageAt::parse(query.limit, query.cursor.as_deref())?;
    Ok(Json(app.store.audit(at).await?))
}
