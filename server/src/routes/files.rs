//! Files over HTTP: `ETag`, `If-None-Match`, `Range`, `If-Range`.

use std::path::PathBuf;

use axum::{
    body::Body,
    http::{HeaderMap, HeaderValue, StatusCode, header},
    response::{IntoResponse, Response},
};
use tokio::io::{AsyncReadExt, AsyncSeekExt};
use tokio_util::io::ReaderStream;

use crate::error::{ApiError, ApiResult, Code};

/// A file that never changes under its tag.
pub(super) struct FileAnswer {
    pub(super) path: PathBuf,
    /// Hash of its content, hex.
    pub(super) etag: String,
    pub(super) media_type: &'static str,
}

/// The file, a range of it, or that the client has it.
pub(super) async fn answer_file(file: FileAnswer, headers: &HeaderMap) -> ApiResult<Response> {
    let etag = format!("\"{}\"", file.etag);
    if let Some(response) = unchanged(&etag, headers) {
        return Ok(response);
    }
    let etag_value = HeaderValue::try_from(&etag).map_err(ApiError::internal)?;
    let mut opened = tokio::fs::File::open(&file.path).await?;
    let size = opened.metadata().await?.len();
    let same =
        headers.get(header::IF_RANGE).is_none_or(|value| value.as_bytes() == etag.as_bytes());
    let asked = headers.get(header::RANGE).filter(|_| same).and_then(|value| value.to_str().ok());
    let range = asked.and_then(|text| parse_range(text, size));
    let (status, start, len) = match range {
        None => (StatusCode::OK, 0, size),
        Some(None) => {
            let detail = format!("the file has {size} bytes");
            return Err(ApiError::new(Code::RangeNotSatisfiable, detail));
        }
        Some(Some((start, len))) => (StatusCode::PARTIAL_CONTENT, start, len),
    };
    opened.seek(std::io::SeekFrom::Start(start)).await?;
    let stream = ReaderStream::with_capacity(opened.take(len), 64 << 10);
    let mut response = (status, Body::from_stream(stream)).into_response();
    let answer = response.headers_mut();
    answer.insert(header::CONTENT_TYPE, HeaderValue::from_static(file.media_type));
    answer.insert(header::CONTENT_LENGTH, HeaderValue::from(len));
    answer.insert(header::ACCEPT_RANGES, HeaderValue::from_static("bytes"));
    answer.insert(header::ETAG, etag_value);
    // Pages made of uploads run no scripts and reach nothing.
    answer.insert(
        header::CONTENT_SECURITY_POLICY,
        HeaderValue::from_static(
            "sandbox; default-src 'none'; img-src data:; style-src 'unsafe-inline'",
        ),
    );
    if status == StatusCode::PARTIAL_CONTENT {
        let text = format!("bytes {start}-{}/{size}", start + len - 1);
        let value = HeaderValue::try_from(text).map_err(ApiError::internal)?;
        answer.insert(header::CONTENT_RANGE, value);
    }
    Ok(response)
}

/// The answer to a client that has what the tag (with its quotes) stands for.
pub(super) fn unchanged(etag: &str, headers: &HeaderMap) -> Option<Response> {
    let known = headers.get(header::IF_NONE_MATCH)?.to_str().ok()?;
    let tag = HeaderValue::try_from(etag).ok()?;
    matches(known, etag).then(|| (StatusCode::NOT_MODIFIED, [(header::ETAG, tag)]).into_response())
}

/// Whether a list of tags holds `etag`; weak ones count, as for every GET.
fn matches(list: &str, etag: &str) -> bool {
    list.split(',').map(str::trim).any(|tag| tag == "*" || tag.trim_start_matches("W/") == etag)
}

/// Start and length of a single range. `None` when it is to be ignored, `Some(None)` when it lies
/// outside of the file.
fn parse_range(text: &str, size: u64) -> Option<Option<(u64, u64)>> {
    let (first, last) = text.strip_prefix("bytes=")?.trim().split_once('-')?;
    let (start, end) = match (first.trim(), last.trim()) {
        ("", suffix) => {
            let len: u64 = suffix.parse().ok()?;
            (size.saturating_sub(len), if len == 0 { 0 } else { size })
        }
        (first, "") => (first.parse().ok()?, size),
        (first, last) => {
            let (first, last): (u64, u64) = (first.parse().ok()?, last.parse().ok()?);
            if last < first {
                return None;
            }
            (first, last.saturating_add(1).min(size))
        }
    };
    Some((start < end).then(|| (start, end - start)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_read_as_the_standard_says() {
        for (text, range) in [
            ("bytes=0-0", Some(Some((0, 1)))),
            ("bytes=2-", Some(Some((2, 8)))),
            ("bytes=-3", Some(Some((7, 3)))),
            ("bytes=-30", Some(Some((0, 10)))),
            ("bytes=5-99", Some(Some((5, 5)))),
            ("bytes=10-", Some(None)),
            ("bytes=-0", Some(None)),
            ("bytes=5-4", None),
            ("bytes=0-1,3-4", None),
            ("lines=0-1", None),
        ] {
            assert_eq!(parse_range(text, 10), range, "{text}");
        }
    }

    #[test]
    fn tags_match_in_lists_and_weakly() {
        for (list, expected) in
            [("\"a\"", true), ("\"b\", W/\"a\"", true), ("*", true), ("\"b\"", false)]
        {
            assert_eq!(matches(list, "\"a\""), expected, "{list}");
        }
    }
}
