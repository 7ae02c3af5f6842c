//! Image sets and uploads.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use futures_util::{StreamExt, stream};
use reqwest::{Method, header};
use uuid::Uuid;
use volery_api::{
    CreateImageSet, Image, ImageSet, ModelReport, Prior, PriorsReport, PutPriors, UploadReport,
    UploadResult, UploadStatus,
};

use crate::{Client, ClientError, client::parsed};

/// Photos under way at once.
const PARALLEL_UPLOADS: usize = 4;

/// A photo to upload.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UploadFile {
    /// Its name in the set.
    pub name: String,
    /// Its bytes.
    pub path: PathBuf,
}

impl From<&str> for UploadFile {
    fn from(path: &str) -> Self {
        Path::new(path).into()
    }
}

impl From<&Path> for UploadFile {
    fn from(path: &Path) -> Self {
        let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
        Self { name, path: path.to_owned() }
    }
}

impl Client {
    /// A new image set.
    pub async fn create_imageset(
        &self,
        name: &str,
        camera_id: Option<Uuid>,
    ) -> Result<ImageSet, ClientError> {
        let body = CreateImageSet { name: name.to_owned(), camera_id, notes: None };
        self.call(Method::POST, "/v1/imagesets", &body).await
    }

    /// All image sets.
    pub async fn imagesets(&self) -> Result<Vec<ImageSet>, ClientError> {
        self.list("/v1/imagesets").await
    }

    /// All images of a set.
    pub async fn images(&self, imageset: Uuid) -> Result<Vec<Image>, ClientError> {
        self.list(&format!("/v1/imagesets/{imageset}/images")).await
    }

    /// The bytes of an image, as they were uploaded.
    pub async fn image_bytes(&self, id: Uuid) -> Result<bytes::Bytes, ClientError> {
        let path = format!("/v1/images/{id}/bytes");
        self.send(self.request(Method::GET, &path)).await
    }

    /// A small PNG of an image; `size` is its longest side: 64, 128, 256 (the default), 512 or
    /// 1024 pixels.
    pub async fn image_thumbnail(
        &self,
        id: Uuid,
        size: Option<u32>,
    ) -> Result<bytes::Bytes, ClientError> {
        let size = size.map_or(String::new(), |size| format!("?size={size}"));
        let path = format!("/v1/images/{id}/thumbnail{size}");
        self.send(self.request(Method::GET, &path)).await
    }

    /// Uploads one photo. Repeating is safe: the set knows its photos by their hash.
    pub async fn upload_bytes(
        &self,
        imageset: Uuid,
        name: &str,
        bytes: Vec<u8>,
        prior: Option<&Prior>,
    ) -> Result<UploadResult, ClientError> {
        let path = format!("/v1/imagesets/{imageset}/images");
        let name = header::HeaderValue::from_bytes(name.as_bytes())
            .map_err(|_| ClientError::BadArgument(format!("bad image name {name:?}")))?;
        let prior = prior
            .map(serde_json::to_string)
            .transpose()
            .map_err(|e| ClientError::BadArgument(e.to_string()))?;
        let mut request = self
            .request(Method::POST, &path)
            .header(header::CONTENT_TYPE, "application/octet-stream")
            .header("X-Image-Name", name)
            .body(bytes);
        if let Some(prior) = prior {
            request = request.header("X-Pose-Prior", prior);
        }
        let report: UploadReport = parsed(&self.send(request).await?)?;
        let result = report.results.into_iter().next();
        result.ok_or_else(|| ClientError::Protocol("an upload without result".to_owned()))
    }

    /// Uploads photos, several at a time, and reports after each how many are done and how it
    /// went. A photo that the server refuses does not stop the others; results are in the order
    /// of `files`.
    pub async fn upload_files(
        &self,
        imageset: Uuid,
        files: &[UploadFile],
        mut each: impl FnMut(usize, &UploadResult),
    ) -> Result<Vec<UploadResult>, ClientError> {
        let uploads = files.iter().map(|file| async move {
            let bytes =
                tokio::fs::read(&file.path).await.map_err(|e| ClientError::file(&file.path, e))?;
            match self.upload_bytes(imageset, &file.name, bytes, None).await {
                Err(ClientError::Problem(problem)) if is_about_the_file(problem.status) => {
                    Ok(UploadResult {
                        name: file.name.clone(),
                        status: UploadStatus::Rejected,
                        image_id: None,
                        sha256: None,
                        code: Some(problem.code),
                        detail: Some(problem.detail),
                        warnings: Vec::new(),
                    })
                }
                other => other,
            }
        });
        let mut uploads = stream::iter(uploads).buffered(PARALLEL_UPLOADS);
        let mut results = Vec::with_capacity(files.len());
        while let Some(result) = uploads.next().await {
            let result: UploadResult = result?;
            each(results.len() + 1, &result);
            results.push(result);
        }
        Ok(results)
    }

    /// Sets what is known of images before they are looked at.
    pub async fn put_priors(
        &self,
        imageset: Uuid,
        priors: BTreeMap<String, Prior>,
    ) -> Result<PriorsReport, ClientError> {
        let path = format!("/v1/imagesets/{imageset}/priors");
        self.call(Method::PUT, &path, &PutPriors { priors }).await
    }

    /// Sets the poses and cameras of images to those of another program's model: a zip archive with
    /// COLMAP's `cameras` and `images`, or the text of a `transforms.json`.
    pub async fn put_model(
        &self,
        imageset: Uuid,
        model: ModelFile,
    ) -> Result<ModelReport, ClientError> {
        let (media_type, bytes) = match model {
            ModelFile::ColmapZip(bytes) => ("application/zip", bytes),
            ModelFile::TransformsJson(text) => ("application/json", text.into_bytes()),
        };
        let path = format!("/v1/imagesets/{imageset}/model");
        let request = self.request(Method::PUT, &path);
        let request = request.header(header::CONTENT_TYPE, media_type).body(bytes);
        parsed(&self.send(request).await?)
    }
}

/// A model of another program.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ModelFile {
    /// A zip archive with `cameras` and `images`, `.txt` or `.bin`.
    ColmapZip(Vec<u8>),
    /// nerfstudio's document.
    TransformsJson(String),
}

/// Whether a refusal speaks of the photo rather than of the caller or the server.
fn is_about_the_file(status: u16) -> bool {
    matches!(status, 400 | 409 | 413 | 415 | 422)
}
