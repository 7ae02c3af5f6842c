//! The pose of a photo in a map.

use std::{sync::Arc, time::Instant};

use axum::{
    Json,
    body::Bytes,
    extract::{FromRequest, Multipart, Request, State},
};
use futures_util::future::try_join_all;
use uuid::Uuid;
use volery_api::{
    Camera, ImageEncoding, Localization, LocalizeAnswer, LocalizeManyAnswer, LocalizeMethod,
    LocalizeParams, LocalizePrior, LocalizeStatus, MapVersion, MapsQuery,
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

/// Maps that one photo may be looked for in.
const MAX_MAPS: usize = 8;

/// A second map with this part of the best map's inliers makes the answer ambiguous. Maps differ
/// in their number of points, so this asks for more distance than rivals within a map.
const RIVAL_SUPPORT: f64 = 0.5;

/// A photo and what is known of it.
#[derive(Debug, Clone, Default)]
pub(crate) struct Query {
    pub(crate) image: Bytes,
    pub(crate) camera: Option<Camera>,
    pub(crate) prior: Option<LocalizePrior>,
    pub(crate) method: LocalizeMethod,
    pub(crate) encoding: ImageEncoding,
    pub(crate) width: Option<u32>,
    pub(crate) height: Option<u32>,
}

/// Finds the pose of a photo. A photo that cannot be placed is answered 200 with `not_found` or
/// `ambiguous` and the reason.
#[utoipa::path(post, path = "/v1/maps/{id}/localize", tag = "localization",
    params(LocalizeParams, ("id" = Uuid, Path, description = "Of the map"),
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
    Asked(asked): Asked<LocalizeParams>,
    request: Request,
) -> ApiResult<Json<LocalizeAnswer>> {
    let start = Instant::now();
    let version = app.store.version(id, asked.version).await?;
    let Sent { mut query, map_ids } = read_query(&app, request).await?;
    query.method = asked.method.unwrap_or_default();
    if map_ids.is_some() {
        return Err(unknown_part("map_ids"));
    }
    Ok(Json(localize_in(&app, &version, query, start).await?))
}

/// Finds the pose of a photo in one of several maps.
#[utoipa::path(post, path = "/v1/localize", tag = "localization",
    params(MapsQuery,
        ("X-Camera" = Option<String>, Header, description = "`Camera` of a raw photo, as JSON"),
        ("X-Pose-Prior" = Option<String>, Header, description = "`LocalizePrior` of a raw photo, as JSON")),
    request_body(description = "A photo, or multipart parts `image`, `map_ids`, `camera` and `prior`",
        content((Vec<u8> = "image/jpeg"), (Vec<u8> = "image/png"),
            (Vec<u8> = "application/octet-stream"), (Vec<u8> = "multipart/form-data"))),
    responses((status = 200, description = "The answer of the best map and of each", body = LocalizeManyAnswer)))]
pub(crate) async fn localize_in_maps(
    State(app): State<Arc<App>>,
    _caller: Viewer,
    Asked(asked): Asked<MapsQuery>,
    request: Request,
) -> ApiResult<Json<LocalizeManyAnswer>> {
    let start = Instant::now();
    let Sent { mut query, map_ids } = read_query(&app, request).await?;
    query.method = asked.method.unwrap_or_default();
    let ids = match (asked.map_ids, map_ids) {
        (Some(ids), None) | (None, Some(ids)) => parse_ids(&ids)?,
        _ => return Err(bad_ids("map_ids must come once, in the query or in the form")),
    };
    let mut versions = Vec::new();
    for id in ids {
        versions.push(app.store.version(id, None).await?);
    }
    let asked = versions.iter().map(|version| localize_in(&app, version, query.clone(), start));
    Ok(Json(choose(try_join_all(asked).await?)?))
}

/// The answer of the best map, unless a second one is as good.
fn choose(answers: Vec<LocalizeAnswer>) -> ApiResult<LocalizeManyAnswer> {
    let rank = |answer: &LocalizeAnswer| {
        let rank = match answer.localization.status {
            LocalizeStatus::Ok => 2,
            LocalizeStatus::Ambiguous => 1,
            LocalizeStatus::NotFound => 0,
        };
        (rank, answer.localization.num_inliers)
    };
    // The first of equals.
    let best = answers.iter().rev().max_by_key(|answer| rank(answer));
    let mut best = best.ok_or_else(|| bad_ids("no map was named"))?.clone();
    let is_rival = |other: &LocalizeAnswer| {
        let support = f64::from(other.localization.num_inliers);
        other.map_id != best.map_id
            && other.localization.status != LocalizeStatus::NotFound
            && support >= RIVAL_SUPPORT * f64::from(best.localization.num_inliers)
    };
    if best.localization.status == LocalizeStatus::Ok && answers.iter().any(is_rival) {
        best.localization.status = LocalizeStatus::Ambiguous;
        best.localization.reason = Some("several_maps".to_owned());
        best.localization.pose = None;
        best.localization.covariance = None;
    }
    Ok(LocalizeManyAnswer { best, answers })
}

fn parse_ids(text: &str) -> ApiResult<Vec<Uuid>> {
    let ids = text.split(',').map(|id| Uuid::parse_str(id.trim()));
    let ids: Vec<Uuid> =
        ids.collect::<Result<_, _>>().map_err(|error| bad_ids(&error.to_string()))?;
    let mut different = ids.clone();
    different.sort_unstable();
    different.dedup();
    if ids.len() > MAX_MAPS || different.len() < ids.len() {
        return Err(bad_ids(&format!("at most {MAX_MAPS} maps, each once")));
    }
    Ok(ids)
}

fn bad_ids(detail: &str) -> ApiError {
    ApiError::new(Code::Unprocessable("bad_map_ids"), detail)
        .hint("ids of maps, separated by commas")
}

/// What came with a question.
pub(super) struct Sent {
    pub(super) query: Query,
    pub(super) map_ids: Option<String>,
}

pub(super) async fn read_query(app: &App, request: Request) -> ApiResult<Sent> {
    check_length(request.headers(), app.config.limits.image_bytes)?;
    let query = match media_type(request.headers()).as_deref() {
        Some("multipart/form-data") => return read_parts(request).await,
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
    Ok(Sent { query, map_ids: None })
}

async fn read_parts(request: Request) -> ApiResult<Sent> {
    let mut parts = Multipart::from_request(request, &())
        .await
        .map_err(|error| ApiError::new(Code::BadRequest, error.body_text()))?;
    let (mut query, mut map_ids) = (Query::default(), None);
    while let Some(part) = parts.next_field().await.map_err(|e| multipart_error(&e))? {
        let name = part.name().unwrap_or_default().to_owned();
        let bytes = part.bytes().await.map_err(|e| multipart_error(&e))?;
        match name.as_str() {
            "image" => query.image = bytes,
            "camera" => query.camera = Some(parse_json(&bytes)?),
            "prior" => query.prior = Some(parse_json(&bytes)?),
            "map_ids" => map_ids = Some(String::from_utf8_lossy(&bytes).into_owned()),
            _ => return Err(unknown_part(&name)),
        }
    }
    Ok(Sent { query, map_ids })
}

fn unknown_part(name: &str) -> ApiError {
    ApiError::new(Code::Unprocessable("unknown_field"), format!("unknown part {name:?}"))
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
        method: query.method,
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
