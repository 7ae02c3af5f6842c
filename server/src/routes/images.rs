//! Images.

use std::sync::Arc;

use axum::{Json, extract::State, http::HeaderMap, response::Response};
use uuid::Uuid;
use volery_api::{Image, Page, PageQuery};

use super::files::{FileAnswer, answer_file};
use crate::{
    answer::Deleted,
    auth::{Mapper, Viewer},
    error::{ApiError, ApiResult},
    extract::{Asked, At},
    state::App,
    store::PageAt,
};

/// Lists the images of a set.
#[utoipa::path(get, path = "/v1/imagesets/{id}/images", tag = "image sets",
    params(PageQuery, ("id" = Uuid, Path, description = "Of the image set")),
    responses((status = 200, description = "Images", body = Page<Image>)))]
pub(crate) async fn list_images(
    State(app): State<Arc<App>>,
    _caller: Viewer,
    At(id): At<Uuid>,
    Asked(query): Asked<PageQuery>,
) -> ApiResult<Json<Page<Image>>> {
    let at = PageAt::parse(query.limit, query.cursor.as_deref())?;
    app.store.imageset(id).await?;
    Ok(Json(app.store.images(id, at).await?))
}

/// One image.
#[utoipa::path(get, path = "/v1/images/{id}", tag = "image sets",
    params(("id" = Uuid, Path, description = "Of the image")),
    responses((status = 200, description = "The image", body = Image)))]
pub(crate) async fn get_image(
    State(app): State<Arc<App>>,
    _caller: Viewer,
    At(id): At<Uuid>,
) -> ApiResult<Json<Image>> {
    Ok(Json(app.store.image(id).await?))
}

/// The bytes of an image, as they were sent.
#[utoipa::path(get, path = "/v1/images/{id}/bytes", tag = "image sets",
    params(("id" = Uuid, Path, description = "Of the image")),
    responses((status = 200, description = "The bytes", body = Vec<u8>, content_type = "application/octet-stream"),
        (status = 206, description = "A range of the bytes", body = Vec<u8>, content_type = "application/octet-stream"),
        (status = 304, description = "They are what the client has")))]
pub(crate) async fn image_bytes(
    State(app): State<Arc<App>>,
    _caller: Viewer,
    At(id): At<Uuid>,
    headers: HeaderMap,
) -> ApiResult<Response> {
    let image = app.store.image(id).await?;
    let file = FileAnswer {
        path: app.blobs.path(&image.sha256),
        etag: image.sha256,
        media_type: if image.format == "png" { "image/png" } else { "image/jpeg" },
    };
    answer_file(file, &headers).await
}

/// Deletes an image. Maps made of it stay.
#[utoipa::path(delete, path = "/v1/images/{id}", tag = "image sets",
    params(("id" = Uuid, Path, description = "Of the image")),
    responses((status = 204, description = "It is gone")))]
pub(crate) async fn delete_image(
    State(app): State<Arc<App>>,
    _caller: Mapper,
    At(id): At<Uuid>,
) -> ApiResult<Deleted> {
    if app.store.delete_image(id).await? {
        Ok(Deleted)
    } else {
        Err(ApiError::not_found("image", id))
    }
}
