//! Single frames of drones' cameras.

use std::{
    sync::Arc,
    time::{Duration, Instant},
};

use axum::{
    Json,
    extract::{Request, State},
};
use volery_api::{FrameAnswer, FrameParams, LocalizeMethod};

use super::{
    drones::{drones, not_heard},
    localize::{Sent, localize_in, read_query},
};
use crate::{
    auth::Pilot,
    error::{ApiError, ApiResult, Code},
    extract::{Asked, At},
    state::App,
};

/// Takes one frame of a drone's camera, as at the end of a way: its place is found by the features
/// of the frame alone, told to the drone's estimator if it is fresh and can be true, and noted in
/// the drone's flight.
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
    _caller: Pilot,
    At(id): At<u8>,
    Asked(asked): Asked<FrameParams>,
    request: Request,
) -> ApiResult<Json<FrameAnswer>> {
    let arrived = Instant::now();
    drones(&app)?.get(id).ok_or_else(|| not_heard(id))?;
    let age = Duration::try_from_secs_f64(asked.age_ms.unwrap_or(0.0) / 1e3).map_err(|_| {
        ApiError::new(Code::Unprocessable("bad_number"), "age_ms is a time in the past")
    })?;
    let version = app.store.version(asked.map_id, None).await?;
    let Sent { mut query, .. } = read_query(&app, request).await?;
    query.method = LocalizeMethod::Pnp;
    let answer = localize_in(&app, &version, query, arrived).await?;
    let captured = arrived.checked_sub(age).unwrap_or(arrived);
    let is_metric = version.info["scale"]["metric"].as_bool().unwrap_or(false);
    let place = drones(&app)?.frame(id, captured, &answer.localization, is_metric);
    Ok(Json(FrameAnswer { answer, place }))
}
