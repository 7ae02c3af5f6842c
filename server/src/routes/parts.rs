//! Archives that come in parts: a broken connection costs what was on its way.

use std::{
    fs::File,
    io::{self, Read},
    sync::Arc,
};

use axum::{
    Json, RequestExt,
    extract::{Request, State},
    http::HeaderMap,
    response::{IntoResponse, Response},
};
use futures_util::StreamExt;
use sha2::{Digest, Sha256};
use tokio::io::AsyncWriteExt;
use uuid::Uuid;
use volery_api::{CreateUpload, UPLOAD_OFFSET, Upload, UploadReport};

use super::{
    ingest::report,
    uploads::{answer_report, check_length},
    zips::ingest_archive,
};
use crate::{
    answer::{Created, Deleted},
    auth::{Mapper, Viewer},
    clock,
    error::{ApiError, ApiResult, Code},
    extract::{At, Body, json_header, stream_error},
    idempotency::Identity,
    state::App,
    store::{UploadRow, blobs::hex},
};

/// Begins the upload of a zip archive in parts.
///
/// `PATCH` adds parts, one after another; what is answered of a part survives any crash. After a
/// broken connection `GET` (or `HEAD`, by the header `Upload-Offset`) tells where to go on.
/// `complete` takes the photos into the set. An upload that is three days old is forgotten.
#[utoipa::path(post, path = "/v1/uploads", tag = "image sets", request_body = CreateUpload,
    params(("Idempotency-Key" = Option<String>, Header, description = "Names this request")),
    responses((status = 201, description = "The upload", body = Upload)))]
pub(crate) async fn create_upload(
    State(app): State<Arc<App>>,
    Mapper(caller): Mapper,
    headers: HeaderMap,
    Body(request): Body<CreateUpload>,
) -> ApiResult<Created<Upload>> {
    let is_hash = |text: &str| {
        text.len() == 64 && text.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f'))
    };
    if !is_hash(&request.sha256) {
        let detail = "sha256 has 64 lower-case hex digits";
        return Err(ApiError::new(Code::Unprocessable("bad_hash"), detail));
    }
    let limit = app.config.limits.archive_bytes;
    if !(1..=limit).contains(&request.size) {
        let detail = format!("an archive has 1 to {limit} bytes, not {}", request.size);
        return Err(ApiError::new(Code::TooLarge, detail).hint("/v1/info lists the limits"));
    }
    app.store.imageset(request.imageset_id).await?;
    app.blobs.check_space(request.size)?;
    let identity = Identity::of(&caller, "uploads", &headers)?;
    let row = app.store.insert_upload(&identity, &request).await?;
    let upload = upload(&app, row)?;
    Ok(Created(format!("/v1/uploads/{}", upload.id), upload))
}

/// How far an upload is.
#[utoipa::path(get, path = "/v1/uploads/{id}", tag = "image sets",
    params(("id" = Uuid, Path, description = "Of the upload")),
    responses((status = 200, description = "The upload", body = Upload,
        headers(("Upload-Offset" = u64, description = "Where the next part begins")))))]
pub(crate) async fn get_upload(
    State(app): State<Arc<App>>,
    _caller: Viewer,
    At(id): At<Uuid>,
) -> ApiResult<Response> {
    let row = app.store.upload(id).await?;
    Ok(told(upload(&app, row)?))
}

/// Adds a part to an upload, at the byte that `Upload-Offset` names: the one after the last that
/// is there. Also of a part that breaks off, what came is kept.
#[utoipa::path(patch, path = "/v1/uploads/{id}", tag = "image sets",
    params(("id" = Uuid, Path, description = "Of the upload"),
        ("Upload-Offset" = u64, Header, description = "Where in the file the part begins")),
    request_body(content = Vec<u8>, content_type = "application/octet-stream"),
    responses((status = 200, description = "It is on the disk", body = Upload,
        headers(("Upload-Offset" = u64, description = "Where the next part begins")))))]
pub(crate) async fn append_part(
    State(app): State<Arc<App>>,
    _caller: Mapper,
    At(id): At<Uuid>,
    request: Request,
) -> ApiResult<Response> {
    let row = app.store.upload(id).await?;
    let start: u64 = json_header(request.headers(), UPLOAD_OFFSET)?.ok_or_else(|| {
        ApiError::new(Code::BadRequest, format!("the header {UPLOAD_OFFSET} is missing"))
    })?;
    let file = take(&app, &row)?;
    let offset = file.metadata()?.len();
    if start != offset {
        let detail = format!("the part begins at {start}, and the upload has {offset} bytes");
        return Err(ApiError::new(Code::Conflict("wrong_offset"), detail)
            .hint("GET the upload and go on at its offset"));
    }
    let left = row.request.size - offset;
    check_length(request.headers(), left)?;
    app.blobs.check_space(left)?;
    let mut file = tokio::fs::File::from_std(file);
    let came = append(&mut file, request, left).await;
    file.flush().await?;
    let (file, files) = (file.into_std().await, app.upload_files.clone());
    tokio::task::spawn_blocking(move || files.keep(&file)).await??;
    came?;
    Ok(told(upload(&app, row)?))
}

async fn append(file: &mut tokio::fs::File, request: Request, mut left: u64) -> ApiResult<()> {
    let mut chunks = request.into_limited_body().into_data_stream();
    while let Some(chunk) = chunks.next().await {
        let chunk = chunk.map_err(|error| stream_error(&error))?;
        left = left.checked_sub(chunk.len() as u64).ok_or_else(|| {
            ApiError::new(Code::TooLarge, "the part goes beyond the end of the file")
        })?;
        file.write_all(&chunk).await?;
    }
    Ok(())
}

/// Takes the photos of an uploaded archive into its set. Asked again, it answers the same.
#[utoipa::path(post, path = "/v1/uploads/{id}/complete", tag = "image sets",
    params(("id" = Uuid, Path, description = "Of the upload")),
    responses((status = 200, description = "Every entry is in the set", body = UploadReport),
        (status = 207, description = "Some entries were rejected", body = UploadReport)))]
pub(crate) async fn complete_upload(
    State(app): State<Arc<App>>,
    _caller: Mapper,
    At(id): At<Uuid>,
) -> ApiResult<Response> {
    let row = app.store.upload(id).await?;
    if let Some(report) = row.report {
        return Ok(answer_report(report));
    }
    let file = take(&app, &row)?;
    let CreateUpload { imageset_id, size, sha256 } = row.request;
    let offset = file.metadata()?.len();
    if offset != size {
        let detail = format!("{offset} of {size} bytes are there");
        return Err(ApiError::new(Code::Conflict("upload_incomplete"), detail));
    }
    // The file stays locked to the end.
    let (_locked, hash) = tokio::task::spawn_blocking(move || hashed(file)).await??;
    if hash != sha256 {
        let detail = format!("the bytes that came have the SHA-256 {hash}");
        return Err(ApiError::new(Code::Unprocessable("wrong_hash"), detail)
            .hint("delete the upload and begin again"));
    }
    app.store.imageset(imageset_id).await?;
    let report = report(ingest_archive(&app, imageset_id, &app.upload_files.path(id)).await?);
    app.store.finish_upload(id, &report).await?;
    app.upload_files.remove(id)?;
    Ok(answer_report(report))
}

/// Forgets an upload. Photos that are in their set stay.
#[utoipa::path(delete, path = "/v1/uploads/{id}", tag = "image sets",
    params(("id" = Uuid, Path, description = "Of the upload")),
    responses((status = 204, description = "It is gone")))]
pub(crate) async fn delete_upload(
    State(app): State<Arc<App>>,
    _caller: Mapper,
    At(id): At<Uuid>,
) -> ApiResult<Deleted> {
    if !app.store.delete_upload(id).await? {
        return Err(ApiError::not_found("upload", id));
    }
    app.upload_files.remove(id)?;
    Ok(Deleted)
}

/// The file of an upload for one request alone.
fn take(app: &App, row: &UploadRow) -> ApiResult<File> {
    if row.report.is_some() {
        return Err(ApiError::new(Code::Conflict("upload_finished"), "its photos are in the set"));
    }
    app.upload_files.take(row.id)?.ok_or_else(|| {
        ApiError::new(Code::Conflict("upload_busy"), "another request works on this upload")
            .hint("come again when that has ended")
    })
}

fn upload(app: &App, row: UploadRow) -> ApiResult<Upload> {
    let CreateUpload { imageset_id, size, sha256 } = row.request;
    let offset = if row.report.is_some() { size } else { app.upload_files.len(row.id)? };
    let created = clock::rfc3339(row.created_ms);
    Ok(Upload { id: row.id, imageset_id, size, sha256, offset, created })
}

fn told(upload: Upload) -> Response {
    ([(UPLOAD_OFFSET, upload.offset.to_string())], Json(upload)).into_response()
}

fn hashed(mut file: File) -> io::Result<(File, String)> {
    let (mut hash, mut buffer) = (Sha256::new(), vec![0; 256 << 10]);
    loop {
        match file.read(&mut buffer)? {
            0 => return Ok((file, hex(&hash.finalize()))),
            len => hash.update(&buffer[..len]),
        }
    }
}
