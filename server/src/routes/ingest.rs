//! One uploaded file: from a temporary file to an image of a set, or the reason why not.

use std::path::{Path, PathBuf};

use uuid::Uuid;
use volery_api::{
    Prior, UploadReport, UploadResult, UploadStatus,
    worker::{ImageCheck, WorkerRequest},
};

use crate::{
    error::{ApiError, ApiResult},
    metrics::add,
    state::App,
    store::{NewImage, StoredImage},
    workers::PoolError,
};

/// Longest side and number of pixels that are taken.
const MAX_SIDE: u32 = 16_384;
const MAX_PIXELS: u64 = 64_000_000;

/// A file that is deleted when its handle is dropped.
#[derive(Debug)]
pub(super) struct TemporaryFile(pub(super) PathBuf);

impl Drop for TemporaryFile {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

/// An uploaded file.
pub(super) struct Incoming<'a> {
    pub(super) imageset: Uuid,
    pub(super) name: &'a str,
    pub(super) file: &'a Path,
    pub(super) prior: Option<Prior>,
    pub(super) capture_time_ns: Option<u64>,
}

/// Checks a file and keeps it. An error means that the service failed, not the file.
pub(super) async fn ingest(app: &App, incoming: &Incoming<'_>) -> ApiResult<UploadResult> {
    let name = incoming.name;
    if let Some(problem) = name_problem(name) {
        return Ok(reject(app, name, "unsafe_name", problem));
    }
    let _held = app.held_files.acquire().await.map_err(ApiError::internal)?;
    let bytes = tokio::fs::read(incoming.file).await?;
    if let Err((code, detail)) = sniff(&bytes) {
        return Ok(reject(app, name, code, detail));
    }
    let timeout = app.config.workers.decode_timeout;
    let asked = app.decoders.call(&WorkerRequest::CheckImage {}, &bytes, timeout).await;
    let check: ImageCheck = match asked {
        Ok(check) => check,
        Err(PoolError::Refused(failure)) => {
            return Ok(reject(app, name, &failure.code, failure.detail));
        }
        Err(error @ (PoolError::Died | PoolError::TimedOut(_))) => {
            add(&app.metrics.worker_deaths, 1);
            return Ok(reject(app, name, "undecodable", format!("decoding it failed: {error}")));
        }
        Err(error) => return Err(error.into()),
    };
    let blob = app.with_blobs(move |blobs| blobs.put(&bytes)).await?;
    let new = NewImage {
        imageset: incoming.imageset,
        name,
        blob: &blob,
        check: &check,
        prior: incoming.prior.as_ref(),
        capture_time_ns: incoming.capture_time_ns,
    };
    let max_images = app.config.limits.imageset_images;
    let (status, image_id) = match app.store.insert_image(&new, max_images).await? {
        StoredImage::Stored(id) => {
            add(&app.metrics.images_stored, 1);
            (UploadStatus::Stored, id)
        }
        StoredImage::Duplicate(id) => (UploadStatus::Duplicate, id),
        StoredImage::NameTaken => {
            let detail = "the set has another image of this name";
            return Ok(reject(app, name, "name_taken", detail));
        }
        StoredImage::SetFull => {
            let detail = format!("a set holds at most {max_images} images");
            return Ok(reject(app, name, "imageset_full", detail));
        }
    };
    Ok(UploadResult {
        name: name.to_owned(),
        status,
        image_id: Some(image_id),
        sha256: Some(blob.sha256),
        code: None,
        detail: None,
        warnings: check.warnings,
    })
}

/// A file that is not kept.
pub(super) fn reject(app: &App, name: &str, code: &str, detail: impl Into<String>) -> UploadResult {
    add(&app.metrics.images_rejected, 1);
    UploadResult {
        name: name.chars().take(255).collect(),
        status: UploadStatus::Rejected,
        image_id: None,
        sha256: None,
        code: Some(code.to_owned()),
        detail: Some(detail.into()),
        warnings: Vec::new(),
    }
}

/// With the counts.
pub(super) fn report(results: Vec<UploadResult>) -> UploadReport {
    let count = |status| results.iter().filter(|result| result.status == status).count() as u64;
    UploadReport {
        stored: count(UploadStatus::Stored),
        duplicates: count(UploadStatus::Duplicate),
        rejected: count(UploadStatus::Rejected),
        results,
    }
}

/// Names never become paths here, but they do in exports.
pub(super) fn name_problem(name: &str) -> Option<&'static str> {
    if name.is_empty() {
        Some("the name is empty")
    } else if name.len() > 255 {
        Some("the name is longer than 255 bytes")
    } else if name.chars().any(|c| c.is_control() || matches!(c, '\\' | ',' | '"' | ':')) {
        Some("the name holds a control character, backslash, comma, colon or quote")
    } else if name.split('/').any(|part| matches!(part, "" | "." | "..")) {
        Some("the name leads out of its folder")
    } else {
        None
    }
}

/// What the first bytes tell.
fn sniff(bytes: &[u8]) -> Result<(), (&'static str, String)> {
    if bytes.is_empty() {
        return Err(("empty_file", "the file has no bytes".to_owned()));
    }
    if let Some(ihdr) = bytes.strip_prefix(b"\x89PNG\r\n\x1a\n") {
        let side = |at| {
            let bytes = ihdr.get(at..at + 4)?;
            Some(u32::from_be_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))
        };
        let (Some(width), Some(height)) = (side(8), side(12)) else {
            return Err(("truncated", "the file ends within its header".to_owned()));
        };
        let pixels = u64::from(width) * u64::from(height);
        if width.max(height) > MAX_SIDE || pixels > MAX_PIXELS {
            let detail = format!(
                "{width} x {height} pixels; at most {MAX_SIDE} a side and {MAX_PIXELS} in all"
            );
            return Err(("too_large", detail));
        }
    } else if !bytes.starts_with(b"\xff\xd8\xff") {
        return Err(("not_an_image", "the file is neither JPEG nor PNG".to_owned()));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stay_in_their_folder() {
        for good in ["a.jpg", "flight 1/0001.png", "..jpg", "ä.jpg"] {
            assert_eq!(name_problem(good), None, "{good}");
        }
        for bad in ["", "/a", "../a", "a/../b", "a//b", "a\\b", "C:a", "a\nb", "a,b"] {
            assert!(name_problem(bad).is_some(), "{bad}");
        }
        assert!(name_problem(&"a".repeat(256)).is_some());
    }

    #[test]
    fn huge_and_foreign_files_are_named_without_decoding() {
        let mut huge = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR".to_vec();
        huge.extend(60_000_u32.to_be_bytes());
        huge.extend(60_000_u32.to_be_bytes());
        assert_eq!(sniff(&huge).unwrap_err().0, "too_large");
        assert_eq!(sniff(&huge[..20]).unwrap_err().0, "truncated");
        assert_eq!(sniff(b"").unwrap_err().0, "empty_file");
        assert_eq!(sniff(b"hello").unwrap_err().0, "not_an_image");
    }
}
