//! Tokens.

use std::sync::Arc;

use axum::{Json, extract::State};
use uuid::Uuid;
use volery_api::{CreateToken, CreatedToken, Page, PageQuery, Token};

use crate::{
    answer::{Created, Deleted},
    auth::{Admin, hash_secret, new_secret},
    clock,
    error::{ApiError, ApiResult, Code},
    extract::{Asked, At, Body},
    state::App,
    store::PageAt,
};

/// Makes a token. Its secret is in this answer and nowhere else.
#[utoipa::path(post, path = "/v1/tokens", tag = "tokens", request_body = CreateToken,
    responses((status = 201, description = "The token with its secret", body = CreatedToken)))]
pub(crate) async fn create_token(
    State(app): State<Arc<App>>,
    _caller: Admin,
    Body(request): Body<CreateToken>,
) -> ApiResult<Created<CreatedToken>> {
    check_name(&request.name)?;
    let expires_ms = match request.expires_in_s {
        None => None,
        Some(seconds) => Some(
            i64::try_from(seconds)
                .ok()
                .and_then(|seconds| seconds.checked_mul(1000))
                .and_then(|span| span.checked_add(clock::now_ms()))
                .ok_or_else(|| {
                    ApiError::new(Code::Unprocessable("bad_expiry"), "the end is too far away")
                })?,
        ),
    };
    let secret = new_secret()?;
    let hash = hash_secret(&secret);
    let token = app.store.insert_token(&request.name, request.role, &hash, expires_ms).await?;
    let location = format!("/v1/tokens/{}", token.id);
    Ok(Created(location, CreatedToken { token, secret }))
}

/// Lists tokens without their secrets.
#[utoipa::path(get, path = "/v1/tokens", tag = "tokens", params(PageQuery),
    responses((status = 200, description = "Tokens", body = Page<Token>)))]
pub(crate) async fn list_tokens(
    State(app): State<Arc<App>>,
    _caller: Admin,
    Asked(query): Asked<PageQuery>,
) -> ApiResult<Json<Page<Token>>> {
    let at = PageAt::parse(query.limit, query.cursor.as_deref())?;
    Ok(Json(app.store.tokens(at).await?))
}

/// Ends a token at once.
#[utoipa::path(delete, path = "/v1/tokens/{id}", tag = "tokens",
    params(("id" = Uuid, Path, description = "Of the token")),
    responses((status = 204, description = "It is gone")))]
pub(crate) async fn delete_token(
    State(app): State<Arc<App>>,
    _caller: Admin,
    At(id): At<Uuid>,
) -> ApiResult<Deleted> {
    if app.store.delete_token(id).await? {
        app.guard.forget(id);
        Ok(Deleted)
    } else {
        Err(ApiError::not_found("token", id))
    }
}

/// Names are for people: short and printable.
pub(super) fn check_name(name: &str) -> ApiResult<()> {
    let bad = if name.trim().is_empty() {
        "is empty"
    } else if name.len() > 200 {
        "is longer than 200 bytes"
    } else if name.chars().any(char::is_control) {
        "holds control characters"
    } else {
        return Ok(());
    };
    Err(ApiError::new(Code::Unprocessable("bad_name"), format!("the name {bad}")))
}
