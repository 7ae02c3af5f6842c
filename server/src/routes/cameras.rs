//! Cameras.

use std::sync::Arc;

use axum::{Json, extract::State, http::HeaderMap};
use uuid::Uuid;
use volery_api::{CAMERA_MODELS, Camera, CameraModel, CreateCamera, Page, PageQuery, StoredCamera};

use super::tokens::check_name;
use crate::{
    answer::Created,
    auth::{Mapper, Viewer},
    error::{ApiError, ApiResult, Code},
    extract::{Asked, At, Body},
    idempotency::Identity,
    state::App,
    store::PageAt,
};

/// Keeps the intrinsics of a calibrated camera.
#[utoipa::path(post, path = "/v1/cameras", tag = "cameras", request_body = CreateCamera,
    params(("Idempotency-Key" = Option<String>, Header, description = "Names this request")),
    responses((status = 201, description = "The camera", body = StoredCamera)))]
pub(crate) async fn create_camera(
    State(app): State<Arc<App>>,
    Mapper(caller): Mapper,
    headers: HeaderMap,
    Body(request): Body<CreateCamera>,
) -> ApiResult<Created<StoredCamera>> {
    check_name(&request.name)?;
    check_camera(&request.camera)?;
    let identity = Identity::of(&caller, "cameras", &headers)?;
    let camera = app.store.insert_camera(&identity, &request).await?;
    Ok(Created(format!("/v1/cameras/{}", camera.id), camera))
}

/// Lists cameras.
#[utoipa::path(get, path = "/v1/cameras", tag = "cameras", params(PageQuery),
    responses((status = 200, description = "Cameras", body = Page<StoredCamera>)))]
pub(crate) async fn list_cameras(
    State(app): State<Arc<App>>,
    _caller: Viewer,
    Asked(query): Asked<PageQuery>,
) -> ApiResult<Json<Page<StoredCamera>>> {
    let at = PageAt::parse(query.limit, query.cursor.as_deref())?;
    Ok(Json(app.store.cameras(at).await?))
}

/// One camera.
#[utoipa::path(get, path = "/v1/cameras/{id}", tag = "cameras",
    params(("id" = Uuid, Path, description = "Of the camera")),
    responses((status = 200, description = "The camera", body = StoredCamera)))]
pub(crate) async fn get_camera(
    State(app): State<Arc<App>>,
    _caller: Viewer,
    At(id): At<Uuid>,
) -> ApiResult<Json<StoredCamera>> {
    Ok(Json(app.store.camera(id).await?))
}

/// Replaces the name and the intrinsics of a camera. Jobs that start from now on use them; maps
/// keep what they were made with.
#[utoipa::path(put, path = "/v1/cameras/{id}", tag = "cameras", request_body = CreateCamera,
    params(("id" = Uuid, Path, description = "Of the camera")),
    responses((status = 200, description = "The camera", body = StoredCamera)))]
pub(crate) async fn put_camera(
    State(app): State<Arc<App>>,
    _caller: Mapper,
    At(id): At<Uuid>,
    Body(request): Body<CreateCamera>,
) -> ApiResult<Json<StoredCamera>> {
    check_name(&request.name)?;
    check_camera(&request.camera)?;
    Ok(Json(app.store.replace_camera(id, &request).await?))
}

/// Camera models with the order of their parameters.
#[utoipa::path(get, path = "/v1/cameras/models", tag = "cameras",
    responses((status = 200, description = "Models", body = Vec<CameraModel>)))]
pub(crate) async fn camera_models(_caller: Viewer) -> Json<Vec<CameraModel>> {
    let models = CAMERA_MODELS.iter().map(|(model, params)| CameraModel {
        model: (*model).to_owned(),
        params: params.iter().map(|&param| param.to_owned()).collect(),
    });
    Json(models.collect())
}

/// Intrinsics that make sense.
pub(crate) fn check_camera(camera: &Camera) -> ApiResult<()> {
    match camera.problem() {
        None => Ok(()),
        Some(problem) => Err(ApiError::new(Code::Unprocessable("bad_camera"), problem)
            .hint("GET /v1/cameras/models lists the models and their parameters")),
    }
}
