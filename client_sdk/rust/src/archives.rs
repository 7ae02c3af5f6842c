//! Archives in parts, so that a broken connection or a server that starts again costs little.

use std::{
    path::Path,
    time::{Duration, Instant},
};

use reqwest::{Method, header};
use sha2::{Digest, Sha256};
use tokio::{
    fs::File,
    io::{AsyncReadExt, AsyncSeekExt, SeekFrom},
};
use uuid::Uuid;
use volery_api::{CreateUpload, UPLOAD_OFFSET, Upload, UploadReport};

use crate::{Client, ClientError, client::parsed};

/// Bytes of a part: what a broken connection costs at most.
const PART: u64 = 4 << 20;

/// So long a server may be away while an archive is uploaded.
const MAX_ABSENCE: Duration = Duration::from_secs(60);

/// Between two tries.
const PAUSE: Duration = Duration::from_millis(500);

impl Client {
    /// Uploads a zip archive of photos in parts, and reports after each how many bytes are safe. It
    /// goes on after a broken connection or a new start of the server.
    pub async fn upload_archive(
        &self,
        imageset: Uuid,
        path: &Path,
        mut each: impl FnMut(u64),
    ) -> Result<UploadReport, ClientError> {
        let failed = |error| ClientError::file(path, error);
        let mut file = File::open(path).await.map_err(failed)?;
        let sha256 = sha256_of(&mut file).await.map_err(failed)?;
        let size = file.metadata().await.map_err(failed)?.len();
        let request = CreateUpload { imageset_id: imageset, size, sha256 };
        let upload: Upload = self.call(Method::POST, "/v1/uploads", &request).await?;
        let path_of_upload = format!("/v1/uploads/{}", upload.id);
        let (mut offset, mut contact) = (upload.offset, Instant::now());
        while offset < size {
            let part = read_part(&mut file, offset).await.map_err(failed)?;
            let told = match self.append_part(&path_of_upload, offset, part).await {
                Err(error) if may_go_on(&error, contact) => {
                    tokio::time::sleep(PAUSE).await;
                    self.get(&path_of_upload).await
                }
                told => told,
            };
            let upload: Upload = match told {
                Err(error) if may_go_on(&error, contact) => continue,
                told => told?,
            };
            if upload.offset > offset {
                contact = Instant::now();
            }
            offset = upload.offset;
            each(offset);
        }
        let complete = format!("{path_of_upload}/complete");
        let contact = Instant::now();
        loop {
            match self.send(self.request(Method::POST, &complete)).await {
                Err(error) if may_go_on(&error, contact) => tokio::time::sleep(PAUSE).await,
                answer => return parsed(&answer?),
            }
        }
    }

    /// Sends a part once: where the next one begins has to be asked for.
    async fn append_part(
        &self,
        upload: &str,
        offset: u64,
        part: Vec<u8>,
    ) -> Result<Upload, ClientError> {
        let request = self
            .request(Method::PATCH, upload)
            .header(header::CONTENT_TYPE, "application/octet-stream")
            .header(UPLOAD_OFFSET, offset)
            .body(part);
        parsed(&self.send_once(request).await?)
    }
}

/// Whether what hinders an upload may pass: the server is away, or still at work on a part whose
/// connection broke.
fn may_go_on(error: &ClientError, contact: Instant) -> bool {
    let passes = error.is_passing()
        || matches!(error.code(), "upload_busy" | "wrong_offset" | "request_timeout");
    passes && contact.elapsed() < MAX_ABSENCE
}

async fn sha256_of(file: &mut File) -> std::io::Result<String> {
    let (mut hash, mut buffer) = (Sha256::new(), vec![0; 1 << 20]);
    loop {
        match file.read(&mut buffer).await? {
            0 => return Ok(hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()),
            len => hash.update(&buffer[..len]),
        }
    }
}

async fn read_part(file: &mut File, offset: u64) -> std::io::Result<Vec<u8>> {
    file.seek(SeekFrom::Start(offset)).await?;
    let mut part = Vec::new();
    file.take(PART).read_to_end(&mut part).await?;
    Ok(part)
}
