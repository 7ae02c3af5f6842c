//! Photos into a set: many in one multipart body, one as it is, or an archive.

use std::{path::Path, sync::Arc};

use axum::{
    Json, RequestExt,
    body::Body,
    extract::{FromRequest, Multipart, Request, State},
    http::{HeaderMap, header},
    response::{IntoResponse, Response},
};
use futures_util::StreamExt;
use tokio::io::AsyncWriteExt;
use uuid::Uuid;
use volery_api::{Prior, UploadReport, UploadResult, UploadStatus};

use super::{
    ingest::{Incoming, TemporaryFile, ingest, reject, report},
    priors::check_prior,
    zips::ingest_archive,
};
use crate::{
    answer::PartlyDone,
    auth::Mapper,
    error::{ApiError, ApiResult, Code},
    extract::{At, json_header, media_type, multipart_error, stream_error},
    state::App,
};

/// Adds photos to a set.
///
/// A `multipart/form-data` body holds any number of files; each answers for itself. An `image/jpeg`,
/// `image/png` or `application/octet-stream` body is one photo. What is answered `stored` or
/// `duplicate` survives any crash.
#[utoipa::path(post, path = "/v1/imagesets/{id}/images", tag = "image sets",
    params(("id" = Uuid, Path, description = "Of the image set"),
        ("X-Image-Name" = Option<String>, Header, description = "Name of a single photo"),
        ("X-Pose-Prior" = Option<String>, Header, description = "`Prior` of a single photo, as JSON"),
        ("X-Capture-Time-Ns" = Option<u64>, Header, description = "Of a single photo, Unix epoch")),
    request_body(content((Vec<u8> = "multipart/form-data"), (Vec<u8> = "image/jpeg"),
        (Vec<u8> = "image/png"), (Vec<u8> = "application/octet-stream"))),
    responses((status = 200, description = "Every file is in the set", body = UploadReport),
        (status = 207, description = "Some files were rejected", body = UploadReport)))]
pub(crate) async fn upload_images(
    State(app): State<Arc<App>>,
    _caller: Mapper,
    At(id): At<Uuid>,
    request: Request,
) -> ApiResult<Response> {
    app.store.imageset(id).await?;
    match media_type(request.headers()).as_deref() {
        Some("multipart/form-data") => {
            check_length(request.headers(), app.config.limits.upload_bytes)?;
            let multipart = Multipart::from_request(request, &())
                .await
                .map_err(|error| ApiError::new(Code::BadRequest, error.body_text()))?;
            upload_multipart(&app, id, multipart).await
        }
        Some("image/jpeg" | "image/png" | "application/octet-stream") => {
            check_length(request.headers(), app.config.limits.image_bytes)?;
            upload_one(&app, id, request).await
        }
        _ => Err(ApiError::new(
            Code::UnsupportedMediaType,
            "the body must be multipart/form-data, image/jpeg or image/png",
        )),
    }
}

/// Adds the photos of a zip archive to a set. Entries that are no photos, links and names that
/// lead out of the archive are rejected one by one.
#[utoipa::path(post, path = "/v1/imagesets/{id}/archive", tag = "image sets",
    params(("id" = Uuid, Path, description = "Of the image set")),
    request_body(content = Vec<u8>, content_type = "application/zip"),
    responses((status = 200, description = "Every entry is in the set", body = UploadReport),
        (status = 207, description = "Some entries were rejected", body = UploadReport)))]
pub(crate) async fn upload_archive(
    State(app): State<Arc<App>>,
    _caller: Mapper,
    At(id): At<Uuid>,
    request: Request,
) -> ApiResult<Response> {
    app.store.imageset(id).await?;
    if !matches!(
        media_type(request.headers()).as_deref(),
        Some("application/zip" | "application/x-zip-compressed" | "application/octet-stream")
    ) {
        return Err(ApiError::new(Code::UnsupportedMediaType, "the body must be application/zip"));
    }
    let limit = app.config.limits.archive_bytes;
    check_length(request.headers(), limit)?;
    let file = TemporaryFile(app.blobs.temporary());
    match save(request.into_limited_body(), &file.0, limit).await? {
        Saved::Whole(_) => answer(ingest_archive(&app, id, &file.0).await?),
        Saved::TooLong => Err(ApiError::new(Code::TooLarge, "the archive is too large")),
    }
}

async fn upload_one(app: &App, id: Uuid, request: Request) -> ApiResult<Response> {
    let headers = request.headers();
    let prior: Option<Prior> = json_header(headers, "x-pose-prior")?;
    prior.as_ref().map_or(Ok(()), check_prior)?;
    let capture_time_ns = json_header(headers, "x-capture-time-ns")?;
    let name = match headers.get("x-image-name") {
        Some(name) => String::from_utf8_lossy(name.as_bytes()).into_owned(),
        None => format!("{}.jpg", Uuid::now_v7()),
    };
    let limit = app.config.limits.image_bytes;
    let file = TemporaryFile(app.blobs.temporary());
    if matches!(save(request.into_limited_body(), &file.0, limit).await?, Saved::TooLong) {
        return Err(ApiError::new(Code::TooLarge, format!("a photo has at most {limit} bytes")));
    }
    let incoming = Incoming { imageset: id, name: &name, file: &file.0, prior, capture_time_ns };
    let result = ingest(app, &incoming).await?;
    if result.status == UploadStatus::Rejected {
        let code = Code::Refused(result.code.unwrap_or_default());
        return Err(ApiError::new(code, result.detail.unwrap_or_default()));
    }
    answer(vec![result])
}

async fn upload_multipart(app: &App, id: Uuid, mut parts: Multipart) -> ApiResult<Response> {
    let mut results = Vec::new();
    while let Some(mut field) = parts.next_field().await.map_err(|e| multipart_error(&e))? {
        let name = field.file_name().or(field.name()).unwrap_or_default().to_owned();
        let file = TemporaryFile(app.blobs.temporary());
        let mut writer = Writer::create(&file.0, app.config.limits.image_bytes).await?;
        while let Some(chunk) = field.chunk().await.map_err(|e| multipart_error(&e))? {
            writer.write(&chunk).await?;
        }
        results.push(match writer.finish().await? {
            Saved::TooLong => {
                let detail = format!("a photo has at most {} bytes", app.config.limits.image_bytes);
                reject(app, &name, "too_large", detail)
            }
            Saved::Whole(_) => {
                let incoming = Incoming {
                    imageset: id,
                    name: &name,
                    file: &file.0,
                    prior: None,
                    capture_time_ns: None,
                };
                ingest(app, &incoming).await?
            }
        });
    }
    answer(results)
}

fn answer(results: Vec<UploadResult>) -> ApiResult<Response> {
    if results.is_empty() {
        return Err(ApiError::new(Code::Unprocessable("no_files"), "the body holds no file"));
    }
    Ok(answer_report(report(results)))
}

pub(super) fn answer_report(report: UploadReport) -> Response {
    match report.rejected {
        0 => Json(report).into_response(),
        _ => PartlyDone(report).into_response(),
    }
}

/// Refuses a body that says that it is too long before a byte of it is read.
pub(super) fn check_length(headers: &HeaderMap, limit: u64) -> ApiResult<()> {
    let length = headers.get(header::CONTENT_LENGTH).and_then(|value| value.to_str().ok());
    match length.and_then(|length| length.parse::<u64>().ok()) {
        Some(length) if length > limit => {
            let detail = format!("the body has {length} bytes; at most {limit} are taken");
            Err(ApiError::new(Code::TooLarge, detail).hint("/v1/info lists the limits"))
        }
        _ => Ok(()),
    }
}

/// What became of a body.
pub(super) enum Saved {
    Whole(#[allow(dead_code, reason = "for logs")] u64),
    TooLong,
}

/// A file that grows up to a limit; what comes beyond is read and forgotten.
struct Writer {
    file: tokio::fs::File,
    size: u64,
    limit: u64,
}

impl Writer {
    async fn create(path: &Path, limit: u64) -> ApiResult<Self> {
        Ok(Self { file: tokio::fs::File::create_new(path).await?, size: 0, limit })
    }

    async fn write(&mut self, chunk: &[u8]) -> ApiResult<()> {
        self.size += chunk.len() as u64;
        if self.size <= self.limit {
            self.file.write_all(chunk).await?;
        }
        Ok(())
    }

    async fn finish(mut self) -> ApiResult<Saved> {
        self.file.flush().await?;
        Ok(if self.size > self.limit { Saved::TooLong } else { Saved::Whole(self.size) })
    }
}

pub(super) async fn save(body: Body, path: &Path, limit: u64) -> ApiResult<Saved> {
    let mut writer = Writer::create(path, limit).await?;
    let mut chunks = body.into_data_stream();
    while let Some(chunk) = chunks.next().await {
        writer.write(&chunk.map_err(|error| stream_error(&error))?).await?;
        if writer.size > limit {
            return Ok(Saved::TooLong);
        }
    }
    writer.finish().await
}
