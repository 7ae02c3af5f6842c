//! Images.

use std::{path::Path, sync::Arc};

use axum::{Json, extract::State, http::HeaderMap, response::Response};
use uuid::Uuid;
use volery_api::{Image, Page, PageQuery, ThumbnailQuery, worker::WorkerRequest};

use super::files::{FileAnswer, answer_file};
use crate::{
    answer::Deleted,
    auth::{Mapper, Viewer},
    error::{ApiError, ApiResult, Code},
    extract::{Asked, At},
    state::App,
    store::{PageAt, thumbnails::THUMBNAIL_SIZES},
};

/// Longest side of a thumbnail when none is asked for, pixels.
const DEFAULT_THUMBNAIL_SIZE: u32 = 256;

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
    responses((status = 200, description = "The bytes", content((Vec<u8> = "image/jpeg"), (Vec<u8> = "image/png"))),
        (status = 206, description = "A range of the bytes", content((Vec<u8> = "image/jpeg"), (Vec<u8> = "image/png"))),
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

/// A small PNG of an image, upright, never enlarged.
#[utoipa::path(get, path = "/v1/images/{id}/thumbnail", tag = "image sets",
    params(ThumbnailQuery, ("id" = Uuid, Path, description = "Of the image")),
    responses((status = 200, description = "The picture", body = Vec<u8>, content_type = "image/png"),
        (status = 206, description = "A range of its bytes", body = Vec<u8>, content_type = "image/png"),
        (status = 304, description = "It is what the client has")))]
pub(crate) async fn image_thumbnail(
    State(app): State<Arc<App>>,
    _caller: Viewer,
    At(id): At<Uuid>,
    Asked(query): Asked<ThumbnailQuery>,
    headers: HeaderMap,
) -> ApiResult<Response> {
    let size = query.size.unwrap_or(DEFAULT_THUMBNAIL_SIZE);
    if !THUMBNAIL_SIZES.contains(&size) {
        let detail = format!("{size} is not a size of thumbnails");
        return Err(ApiError::new(Code::Unprocessable("bad_size"), detail)
            .hint(format!("there are {THUMBNAIL_SIZES:?}")));
    }
    let image = app.store.image(id).await?;
    let path = app.blobs.thumbnail(&image.sha256, size);
    if !tokio::fs::try_exists(&path).await? {
        make_thumbnail(&app, &image.sha256, size, &path).await?;
    }
    let file =
        FileAnswer { path, etag: format!("{}-{size}", image.sha256), media_type: "image/png" };
    answer_file(file, &headers).await
}

async fn make_thumbnail(app: &App, sha256: &str, size: u32, path: &Path) -> ApiResult<()> {
    let _held = app.held_files.acquire().await.map_err(ApiError::internal)?;
    if tokio::fs::try_exists(path).await? {
        // Made while this one waited.
        return Ok(());
    }
    let photo = tokio::fs::read(app.blobs.path(sha256)).await?;
    let request = WorkerRequest::Thumbnail { max_side: size };
    let timeout = app.config.workers.decode_timeout;
    let asked = app.decoders.call_for_bytes::<serde_json::Value>(&request, &photo, timeout).await;
    let (_, png) = asked.inspect_err(|error| app.metrics.asked(error))?;
    let sha256 = sha256.to_owned();
    app.with_blobs(move |blobs| blobs.put_thumbnail(&sha256, size, &png)).await
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
