//! Single frames of drones' cameras.

use std::{
    sync::Arc,
    time::{Duration, Instant},
};

use axum::{
    Json,
    extract::{Request, State},
    http::{HeaderMap, HeaderValue, header},
    response::{IntoResponse, Response},
};
use bytes::Bytes;
use sha2::{Digest, Sha256};
use uuid::Uuid;
use volery_api::{
    Camera, CreateImageSet, CreateJob, FrameAnswer, FrameParams, JobKind, LocalizeMethod,
    LocalizeStatus, UploadStatus,
};

use super::{
    drones::not_heard,
    files::unchanged,
    ingest::{Incoming, TemporaryFile, ingest},
    jobs::submit,
    localize::{Sent, localize_in, read_query},
};
use crate::{
    auth::{Caller, Pilot, Viewer},
    error::{ApiError, ApiResult, Code},
    extract::{Asked, At},
    idempotency::Identity,
    state::App,
    store::blobs::hex,
};

/// Age of a picture when it was answered, milliseconds.
const FRAME_AGE: &str = "x-frame-age-ms";

/// Takes one frame of a drone's camera, as at the end of a way: its place is found by the features
/// of the frame alone, told to the drone's estimator if it is fresh and can be true, and noted in
/// the drone's flight. With `extend` a frame that has a place joins the map by a job.
#[utoipa::path(post, path = "/v1/drones/{id}/frames", tag = "drones",
    params(FrameParams, ("id" = u8, Path, description = "MAVLink system id"),
        ("X-Camera" = Option<String>, Header, description = "`Camera` of the frame, as JSON"),
        ("X-Pose-Prior" = Option<String>, Header, description = "`LocalizePrior` of the frame, as JSON")),
    request_body(description = "A photo, or multipart parts `image`, `camera` and `prior`",
        content((Vec<u8> = "image/jpeg"), (Vec<u8> = "image/png"),
            (Vec<u8> = "application/octet-stream"), (Vec<u8> = "multipart/form-data"))),
    responses((status = 200, description = "The pose, and what became of it", body = FrameAnswer)))]
pub(crate) async fn drone_frame(
    State(app): State<Arc<App>>,
    Pilot(caller): Pilot,
    At(id): At<u8>,
    Asked(asked): Asked<FrameParams>,
    request: Request,
) -> ApiResult<Json<FrameAnswer>> {
    let arrived = Instant::now();
    app.drones()?.get(id).ok_or_else(|| not_heard(id))?;
    let age = Duration::try_from_secs_f64(asked.age_ms.unwrap_or(0.0) / 1e3).map_err(|_| {
        ApiError::new(Code::Unprocessable("bad_number"), "age_ms is a time in the past")
    })?;
    let version = app.store.version(asked.map_id, None).await?;
    let Sent { mut query, .. } = read_query(&app, request).await?;
    query.method = LocalizeMethod::Pnp;
    let captured = arrived.checked_sub(age).unwrap_or(arrived);
    app.pictures.put(id, &query.image, captured);
    let (image, camera) = (query.image.clone(), query.camera.clone());
    let answer = localize_in(&app, &version, query, arrived).await?;
    let is_metric = version.info["scale"]["metric"].as_bool().unwrap_or(false);
    let place = app.drones()?.frame(id, captured, &answer.localization, is_metric);
    let has_place = answer.localization.status == LocalizeStatus::Ok;
    let job_id = if asked.extend && has_place {
        Some(extend(&app, &caller, id, asked.map_id, image, camera).await?)
    } else {
        None
    };
    Ok(Json(FrameAnswer { answer, place, job_id }))
}

/// Starts a job by which a frame joins a map.
async fn extend(
    app: &App,
    caller: &Caller,
    drone: u8,
    map_id: Uuid,
    image: Bytes,
    camera: Option<Camera>,
) -> ApiResult<Uuid> {
    let fresh = || Identity::of(caller, "frames", &HeaderMap::new());
    let set = CreateImageSet { name: format!("frame of drone {drone}"), ..Default::default() };
    let set = app.store.insert_imageset(&fresh()?, &set).await?.id;
    let file = TemporaryFile(app.blobs.temporary());
    tokio::fs::write(&file.0, &image).await?;
    let name = format!("frame_{}", Uuid::now_v7());
    let incoming =
        Incoming { imageset: set, name: &name, file: &file.0, prior: None, capture_time_ns: None };
    let kept = ingest(app, &incoming).await?;
    if kept.status == UploadStatus::Rejected {
        let code = Code::Refused(kept.code.unwrap_or_default());
        return Err(ApiError::new(code, kept.detail.unwrap_or_default()));
    }
    let job = CreateJob {
        kind: JobKind::ExtendMap,
        map_id: Some(map_id),
        imageset_ids: vec![set],
        camera,
        ..CreateJob::default()
    };
    Ok(submit(app, &fresh()?, &job).await?.1.id)
}

/// The newest picture of a drone's camera, as it came: by a stream of a pilot that names the drone,
/// from its camera that is pulled, or by `POST /v1/drones/{id}/frames`.
#[utoipa::path(get, path = "/v1/drones/{id}/frame", tag = "drones",
    params(("id" = u8, Path, description = "MAVLink system id")),
    responses((status = 200, description = "The picture",
            content((Vec<u8> = "image/jpeg"), (Vec<u8> = "image/png")),
            headers(("X-Frame-Age-Ms" = f64, description = "Since it was taken, milliseconds"))),
        (status = 304, description = "It is what the client has")))]
pub(crate) async fn newest_frame(
    State(app): State<Arc<App>>,
    _caller: Viewer,
    At(id): At<u8>,
    headers: HeaderMap,
) -> ApiResult<Response> {
    let picture = app.pictures.get(id).ok_or_else(|| {
        ApiError::not_found("frame of drone", id).hint(
            "frames come by POST /v1/drones/{id}/frames, a stream with drone_id, or a pulled camera",
        )
    })?;
    let etag = format!("\"{}\"", hex(&Sha256::digest(&picture.bytes)));
    let mut answer = unchanged(&etag, &headers).unwrap_or_else(|| {
        let kind = HeaderValue::from_static(picture.media_type);
        ([(header::CONTENT_TYPE, kind)], picture.bytes).into_response()
    });
    let headers = answer.headers_mut();
    headers.insert(header::ETAG, HeaderValue::try_from(etag).map_err(ApiError::internal)?);
    let age_ms = picture.taken.elapsed().as_millis();
    headers
        .insert(FRAME_AGE, HeaderValue::try_from(age_ms.to_string()).map_err(ApiError::internal)?);
    Ok(answer)
}
