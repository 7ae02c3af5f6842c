//! The pose of a photo in a map.

use std::{sync::Arc, time::Instant};

use axum::{
    Json,
    body::Bytes,
    extract::{FromRequest, Multipart, Request, State},
};
use uuid::Uuid;
use volery_api::{
    Camera, ImageEncoding, Localization, LocalizeAnswer, LocalizePrior, LocalizeStatus, MapVersion,
    VersionQuery,
    worker::{LocalizeTask, WorkerRequest},
};

use super::{cameras::check_camera, uploads::check_length};
use crate::{
    auth::Viewer,
    error::{ApiError, ApiResult, Code},
    extract::{Asked, At, body_error, json_header, media_type, multipart_error, parse_json},
    metrics::add,
    state::App,
};

/// A photo and what is known of it.
#[derive(Debug, Default)]
pub(crate) struct Query {
    pub(crate) image: Bytes,
    pub(crate) camera: Option<Camera>,
    pub(crate) prior: Option<LocalizePrior>,
    pub(crate) encoding: ImageEncoding,
    pub(crate) width: Option<u32>,
    pub(crate) height: Option<u32>,
}

/// Finds the pose of a photo. A photo that cannot be placed is answered 200 with `not_found` or
/// `ambiguous` and the reason.
#[utoipa::path(post, path = "/v1/maps/{id}/localize", tag = "localization",
    params(VersionQuery, ("id" = Uuid, Path, description = "Of the map"),
        ("X-Camera" = Option<String>, Header, description = "`Camera` of a raw photo, as JSON"),
        ("X-Pose-Prior" = Option<String>, Header, description = "`LocalizePrior` of a raw photo, as JSON")),
    request_body(description = "A photo, or multipart parts `image`, `camera` and `prior`",
        content((Vec<u8> = "image/jpeg"), (Vec<u8> = "image/png"),
            (Vec<u8> = "application/octet-stream"), (Vec<u8> = "multipart/form-data"))),
    responses((status = 200, description = "The pose, or why there is none", body = LocalizeAnswer)))]
pub(crate) async fn localize(
    State(app): State<Arc<App>>,
    _caller: Viewer,
    At(id): At<Uuid>,
    Asked(asked): Asked<VersionQuery>,
    request: Request,
) -> ApiResult<Json<LocalizeAnswer>> {
    let start = Instant::now();
    check_length(request.headers(), app.config.limits.image_bytes)?;
    let version = app.store.version(id, asked.version).await?;
    let query = match media_type(request.headers()).as_deref() {
        Some("multipart/form-data") => read_parts(request).await?,
        Some("image/jpeg" | "image/png" | "application/octet-stream") => Query {
            camera: json_header(request.headers(), "x-camera")?,
            prior: json_header(request.headers(), "x-pose-prior")?,
            image: Bytes::from_request(request, &()).await.map_err(body_error)?,
            ..Query::default()
        },
        _ => {
            return Err(ApiError::new(
                Code::UnsupportedMediaType,
                "the body must be image/jpeg, image/png or multipart/form-data",
            ));
        }
    };
    Ok(Json(localize_in(&app, &version, query, start).await?))
}

async fn read_parts(request: Request) -> ApiResult<Query> {
    let mut parts = Multipart::from_request(request, &())
        .await
        .map_err(|error| ApiError::new(Code::BadRequest, error.body_text()))?;
    let mut query = Query::default();
    while let Some(part) = parts.next_field().await.map_err(|e| multipart_error(&e))? {
        let name = part.name().unwrap_or_default().to_owned();
        let bytes = part.bytes().await.map_err(|e| multipart_error(&e))?;
        match name.as_str() {
            "image" => query.image = bytes,
            "camera" => query.camera = Some(parse_json(&bytes)?),
            "prior" => query.prior = Some(parse_json(&bytes)?),
            _ => {
                let detail = format!("unknown part {name:?}");
                return Err(ApiError::new(Code::Unprocessable("unknown_field"), detail));
            }
        }
    }
    Ok(query)
}

/// Asks a localizer.
pub(crate) async fn localize_in(
    app: &Arc<App>,
    version: &MapVersion,
    query: Query,
    start: Instant,
) -> ApiResult<LocalizeAnswer> {
    if let Some(camera) = &query.camera {
        check_camera(camera)?;
    }
    if query.image.is_empty() {
        return Err(ApiError::new(Code::Unprocessable("empty_file"), "the image has no bytes"));
    }
    let map_dir = app.map_folder(version).await?;
    let task = LocalizeTask {
        map_dir: map_dir.display().to_string(),
        camera: query.camera,
        prior: query.prior,
        encoding: query.encoding,
        width: query.width,
        height: query.height,
    };
    let request = WorkerRequest::Localize(Box::new(task));
    let timeout = app.config.workers.localize_timeout;
    let asked = app.localizers.call::<Localization>(&request, &query.image, timeout).await;
    let mut localization = asked.inspect_err(|error| app.metrics.asked(error))?;
    let elapsed = start.elapsed();
    localization.timings.total_ms = Some(elapsed.as_secs_f64() * 1e3);
    app.metrics.localized(elapsed);
    let counter = match localization.status {
        LocalizeStatus::Ok => &app.metrics.localized_ok,
        LocalizeStatus::Ambiguous => &app.metrics.localized_ambiguous,
        LocalizeStatus::NotFound => &app.metrics.localized_not_found,
    };
    add(counter, 1);
    Ok(LocalizeAnswer {
        frame: "map".to_owned(),
        map_id: version.map_id,
        map_version: version.version,
        localization,
    })
}
