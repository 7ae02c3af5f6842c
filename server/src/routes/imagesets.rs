//! Image sets.

use std::sync::Arc;

use axum::{Json, extract::State, http::HeaderMap};
use uuid::Uuid;
use volery_api::{CreateImageSet, ImageSet, Page, PageQuery, PatchImageSet};

use super::tokens::check_name;
use crate::{
    answer::{Created, Deleted},
    auth::{Mapper, Viewer},
    error::{ApiError, ApiResult},
    extract::{Asked, At, Body},
    idempotency::Identity,
    state::App,
    store::PageAt,
};

/// Makes an empty image set.
#[utoipa::path(post, path = "/v1/imagesets", tag = "image sets", request_body = CreateImageSet,
    params(("Idempotency-Key" = Option<String>, Header, description = "Names this request")),
    responses((status = 201, description = "The image set", body = ImageSet)))]
pub(crate) async fn create_imageset(
    State(app): State<Arc<App>>,
    Mapper(caller): Mapper,
    headers: HeaderMap,
    Body(request): Body<CreateImageSet>,
) -> ApiResult<Created<ImageSet>> {
    check_name(&request.name)?;
    let identity = Identity::of(&caller, "imagesets", &headers)?;
    let set = app.store.insert_imageset(&identity, &request).await?;
    Ok(Created(format!("/v1/imagesets/{}", set.id), set))
}

/// Lists image sets.
#[utoipa::path(get, path = "/v1/imagesets", tag = "image sets", params(PageQuery),
    responses((status = 200, description = "Image sets", body = Page<ImageSet>)))]
pub(crate) async fn list_imagesets(
    State(app): State<Arc<App>>,
    _caller: Viewer,
    Asked(query): Asked<PageQuery>,
) -> ApiResult<Json<Page<ImageSet>>> {
    let at = PageAt::parse(query.limit, query.cursor.as_deref())?;
    Ok(Json(app.store.imagesets(at).await?))
}

/// One image set.
#[utoipa::path(get, path = "/v1/imagesets/{id}", tag = "image sets",
    params(("id" = Uuid, Path, description = "Of the image set")),
    responses((status = 200, description = "The image set", body = ImageSet)))]
pub(crate) async fn get_imageset(
    State(app): State<Arc<App>>,
    _caller: Viewer,
    At(id): At<Uuid>,
) -> ApiResult<Json<ImageSet>> {
    Ok(Json(app.store.imageset(id).await?))
}

/// Changes what the body names.
#[utoipa::path(patch, path = "/v1/imagesets/{id}", tag = "image sets",
    request_body = PatchImageSet,
    params(("id" = Uuid, Path, description = "Of the image set")),
    responses((status = 200, description = "The image set", body = ImageSet)))]
pub(crate) async fn patch_imageset(
    State(app): State<Arc<App>>,
    _caller: Mapper,
    At(id): At<Uuid>,
    Body(patch): Body<PatchImageSet>,
) -> ApiResult<Json<ImageSet>> {
    if let Some(name) = &patch.name {
        check_name(name)?;
    }
    Ok(Json(app.store.patch_imageset(id, &patch).await?))
}

/// Deletes an image set with its images. Maps made of them stay.
#[utoipa::path(delete, path = "/v1/imagesets/{id}", tag = "image sets",
    params(("id" = Uuid, Path, description = "Of the image set")),
    responses((status = 204, description = "It is gone")))]
pub(crate) async fn delete_imageset(
    State(app): State<Arc<App>>,
    _caller: Mapper,
    At(id): At<Uuid>,
) -> ApiResult<Deleted> {
    if app.store.delete_imageset(id).await? {
        Ok(Deleted)
    } else {
        Err(ApiError::not_found("image set", id))
    }
}
