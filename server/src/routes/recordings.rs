//! Recordings of drones' links.

use std::sync::Arc;

use axum::{Json, extract::State, http::HeaderMap, response::Response};
use uuid::Uuid;
use volery_api::{CreateRecording, Page, Recording};

use super::{
    drones::not_heard,
    files::{FileAnswer, answer_file},
};
use crate::{
    answer::{Created, Deleted},
    auth::{Pilot, Viewer},
    error::{ApiError, ApiResult, Code},
    extract::{At, Body},
    fleet::{Drones, RecordingError},
    state::App,
};

/// Records everything that a drone's link sends and receives, from now on.
#[utoipa::path(post, path = "/v1/recordings", tag = "drones", request_body = CreateRecording,
    params(("Idempotency-Key" = Option<String>, Header, description = "Names this request")),
    responses((status = 201, description = "It runs", body = Recording)))]
pub(crate) async fn start_recording(
    State(app): State<Arc<App>>,
    _caller: Pilot,
    Body(CreateRecording { drone }): Body<CreateRecording>,
) -> ApiResult<Created<Recording>> {
    let started = app.drones()?.start_recording(drone);
    let recording = started.map_err(|error| match error {
        RecordingError::NotHeard => not_heard(drone),
        error => refused(error),
    })?;
    Ok(Created(format!("/v1/recordings/{}", recording.id), recording))
}

/// All recordings, the oldest first.
#[utoipa::path(get, path = "/v1/recordings", tag = "drones",
    responses((status = 200, description = "Recordings", body = Page<Recording>)))]
pub(crate) async fn list_recordings(
    State(app): State<Arc<App>>,
    _caller: Viewer,
) -> ApiResult<Json<Page<Recording>>> {
    let items = on_disk(app, Drones::recordings).await?;
    Ok(Json(Page { items, next_cursor: None }))
}

/// Ends a recording.
#[utoipa::path(post, path = "/v1/recordings/{id}/stop", tag = "drones",
    params(("id" = Uuid, Path, description = "Of the recording"),
        ("Idempotency-Key" = Option<String>, Header, description = "Names this request")),
    responses((status = 200, description = "The recording", body = Recording)))]
pub(crate) async fn stop_recording(
    State(app): State<Arc<App>>,
    _caller: Pilot,
    At(id): At<Uuid>,
) -> ApiResult<Json<Recording>> {
    on_disk(app, move |drones| drones.stop_recording(id)).await.map(Json)
}

/// The file of a recording: a telemetry log as ground stations and pymavlink read it.
#[utoipa::path(get, path = "/v1/recordings/{id}", tag = "drones",
    params(("id" = Uuid, Path, description = "Of the recording")),
    responses((status = 200, description = "The log", body = Vec<u8>, content_type = "application/octet-stream"),
        (status = 206, description = "A range of its bytes", body = Vec<u8>, content_type = "application/octet-stream"),
        (status = 304, description = "It is what the client has")))]
pub(crate) async fn recording_file(
    State(app): State<Arc<App>>,
    _caller: Viewer,
    At(id): At<Uuid>,
    headers: HeaderMap,
) -> ApiResult<Response> {
    let (recording, path) = on_disk(app, move |drones| drones.recording(id)).await?;
    // A log only grows.
    let etag = format!("{id}-{}", recording.size);
    let file = FileAnswer { path, etag, media_type: "application/octet-stream" };
    answer_file(file, &headers).await
}

/// Ends a recording and deletes its file.
#[utoipa::path(delete, path = "/v1/recordings/{id}", tag = "drones",
    params(("id" = Uuid, Path, description = "Of the recording")),
    responses((status = 204, description = "Gone")))]
pub(crate) async fn delete_recording(
    State(app): State<Arc<App>>,
    _caller: Pilot,
    At(id): At<Uuid>,
) -> ApiResult<Deleted> {
    on_disk(app, move |drones| drones.delete_recording(id)).await.map(|()| Deleted)
}

/// What waits for the disk.
async fn on_disk<T: Send + 'static>(
    app: Arc<App>,
    work: impl FnOnce(&Drones) -> Result<T, RecordingError> + Send + 'static,
) -> ApiResult<T> {
    tokio::task::spawn_blocking(move || work(app.drones()?).map_err(refused)).await?
}

fn refused(error: RecordingError) -> ApiError {
    let code = match error {
        RecordingError::Running(_) => Code::Conflict("recording_runs"),
        RecordingError::NotHeard | RecordingError::Unknown => Code::NotFound,
        RecordingError::Io(error) => return error.into(),
    };
    ApiError::new(code, error.to_string())
}
