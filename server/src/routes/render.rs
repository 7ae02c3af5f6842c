//! What a virtual camera sees of a map.

use std::sync::Arc;

use axum::{
    extract::State,
    http::{HeaderName, header},
    response::{IntoResponse, Response},
};
use uuid::Uuid;
use volery_api::{
    RenderRequest, RenderWhat, VersionQuery,
    worker::{RenderReply, WorkerRequest},
};

use super::cameras::check_camera;
use crate::{
    auth::Viewer,
    error::ApiResult,
    extract::{Asked, At, Body},
    state::App,
};

/// What was drawn: `mesh` or `points`.
const SURFACE: HeaderName = HeaderName::from_static("x-surface");

/// Draws a view of a map: its mesh, or its points while it has none.
#[utoipa::path(post, path = "/v1/maps/{id}/render", tag = "maps",
    params(VersionQuery, ("id" = Uuid, Path, description = "Of the map")),
    request_body = RenderRequest,
    responses((status = 200, description = "The picture; `X-Surface` says what was drawn: `mesh` or `points`",
        content((Vec<u8> = "image/png"), (Vec<u8> = "application/octet-stream")))))]
pub(crate) async fn render(
    State(app): State<Arc<App>>,
    _caller: Viewer,
    At(id): At<Uuid>,
    Asked(asked): Asked<VersionQuery>,
    Body(render): Body<RenderRequest>,
) -> ApiResult<Response> {
    let version = app.store.version(id, asked.version).await?;
    if let Some(camera) = &render.camera {
        check_camera(camera)?;
    }
    let media_type = match render.what {
        RenderWhat::Color | RenderWhat::Depth => "image/png",
        RenderWhat::DepthF32 => "application/octet-stream",
    };
    let map_dir = app.map_folder(&version).await?.display().to_string();
    let request = WorkerRequest::Render { map_dir, render };
    let timeout = app.config.workers.localize_timeout;
    let asked = app.localizers.call_for_bytes::<RenderReply>(&request, &[], timeout).await;
    let (about, picture) = asked.inspect_err(|error| app.metrics.asked(error))?;
    Ok(([(header::CONTENT_TYPE, media_type.to_owned()), (SURFACE, about.surface)], picture)
        .into_response())
}
