//! The page of the ground station, built into the program.

use axum::{
    Router,
    body::{Body, Bytes},
    extract::Path,
    http::{HeaderMap, HeaderName, HeaderValue, header},
    response::{IntoResponse, Response},
    routing::get,
};

use super::files::unchanged;
use crate::error::{ApiError, ApiResult, Code};

/// First parts of the addresses that the page itself makes something of.
const AREAS: [&str; 5] = ["photos", "jobs", "maps", "fly", "docs"];

/// The page runs its own scripts, shows pictures that it has fetched, and reaches nobody else.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; \
    img-src 'self' blob:; connect-src 'self' blob:; base-uri 'none'; form-action 'none'; \
    frame-ancestors 'none'";

/// Names in `assets` carry a hash of their content.
const FOREVER: &str = "public, max-age=31536000, immutable";

/// One file of `web/dist`.
struct File {
    name: &'static str,
    /// Changes with its content.
    tag: &'static str,
    plain: &'static [u8],
    gzip: &'static [u8],
}

const FILES: &[File] = include!(concat!(env!("OUT_DIR"), "/page_files.rs"));

/// The page of the ground station.
#[utoipa::path(get, path = "/", tag = "service", security(()),
    responses((status = 200, description = "A page", body = String, content_type = "text/html"),
        (status = 304, description = "It is what the client has")))]
pub(crate) async fn front_page(headers: HeaderMap) -> ApiResult<Response> {
    answer("index.html", "no-cache", &headers)
}

/// Scripts and styles, and the addresses that lead into the page; no part of the API.
pub(crate) fn router<S: Clone + Send + Sync + 'static>() -> Router<S> {
    AREAS.iter().fold(Router::new().route("/assets/{name}", get(asset)), |router, area| {
        router
            .route(&format!("/{area}"), get(front_page))
            .route(&format!("/{area}/{{*rest}}"), get(front_page))
    })
}

async fn asset(Path(name): Path<String>, headers: HeaderMap) -> ApiResult<Response> {
    answer(&format!("assets/{name}"), FOREVER, &headers)
}

fn answer(name: &str, keep: &'static str, headers: &HeaderMap) -> ApiResult<Response> {
    let file = FILES.iter().find(|file| file.name == name);
    let file = file.ok_or_else(|| ApiError::new(Code::NoSuchRoute, "the page has no such file"))?;
    let packed = takes_gzip(headers);
    let tag = format!("\"{}{}\"", file.tag, if packed { "-gz" } else { "" });
    let mut response = unchanged(&tag, headers).unwrap_or_else(|| {
        let bytes = Bytes::from_static(if packed { file.gzip } else { file.plain });
        Body::from(bytes).into_response()
    });
    let mut set = |name: HeaderName, value: &'static str| {
        response.headers_mut().insert(name, HeaderValue::from_static(value));
    };
    set(header::CONTENT_TYPE, media_type(name));
    set(header::CACHE_CONTROL, keep);
    set(header::VARY, "accept-encoding");
    set(header::CONTENT_SECURITY_POLICY, POLICY);
    set(header::REFERRER_POLICY, "no-referrer");
    if packed {
        set(header::CONTENT_ENCODING, "gzip");
    }
    response
        .headers_mut()
        .insert(header::ETAG, HeaderValue::try_from(tag).map_err(ApiError::internal)?);
    Ok(response)
}

fn takes_gzip(headers: &HeaderMap) -> bool {
    let accepted = headers.get_all(header::ACCEPT_ENCODING).iter();
    accepted.filter_map(|value| value.to_str().ok()).flat_map(|value| value.split(',')).any(
        |coding| {
            let (name, weight) = coding.split_once(';').unwrap_or((coding, ""));
            name.trim() == "gzip" && !matches!(weight.trim(), "q=0" | "q=0.0")
        },
    )
}

fn media_type(name: &str) -> &'static str {
    match name.rsplit_once('.').map_or("", |(_, extension)| extension) {
        "html" => "text/html; charset=utf-8",
        "js" => "text/javascript; charset=utf-8",
        "css" => "text/css; charset=utf-8",
        "svg" => "image/svg+xml",
        "png" => "image/png",
        "webp" => "image/webp",
        _ => "application/octet-stream",
    }
}
