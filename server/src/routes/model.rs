//! Poses of photos as another program found them.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs::File,
    io::Read,
    path::Path,
    sync::Arc,
};

use axum::{
    Json, RequestExt,
    extract::{Request, State},
};
use uuid::Uuid;
use volery_api::{
    Limits, ModelReport,
    worker::{MODEL_FILES, ModelPoses, WorkerRequest},
};

use super::{
    ingest::TemporaryFile,
    uploads::{Saved, check_length, save},
    zip_directory::open_archive,
};
use crate::{
    auth::Mapper,
    error::{ApiError, ApiResult, Code},
    extract::{At, media_type},
    state::App,
};

/// Unpacked files of a model, bytes: what a decoder takes.
const MAX_MODEL_BYTES: u64 = 256 << 20;

/// Files by name.
type Files = Vec<(String, Vec<u8>)>;

/// Sets the poses and cameras of images to those of another program's model of them.
///
/// An `application/zip` body holds COLMAP's `cameras` and `images`, `.txt` or `.bin`, in any folder;
/// `application/json` is a `transforms.json`. Names of images may differ in folders and extensions.
/// Other priors of the images stay. Jobs look at the poses with `poses: given` or `given_metric`.
#[utoipa::path(put, path = "/v1/imagesets/{id}/model", tag = "image sets",
    params(("id" = Uuid, Path, description = "Of the image set")),
    request_body(content((Vec<u8> = "application/zip"), (Object = "application/json"))),
    responses((status = 200, description = "What became of them", body = ModelReport)))]
pub(crate) async fn put_model(
    State(app): State<Arc<App>>,
    _caller: Mapper,
    At(id): At<Uuid>,
    request: Request,
) -> ApiResult<Json<ModelReport>> {
    app.store.imageset(id).await?;
    let is_zip = match media_type(request.headers()).as_deref() {
        Some("application/zip" | "application/x-zip-compressed") => true,
        Some("application/json") => false,
        _ => {
            let detail = "the body must be application/zip or application/json";
            return Err(ApiError::new(Code::UnsupportedMediaType, detail));
        }
    };
    let limit = app.config.limits.archive_bytes;
    check_length(request.headers(), limit)?;
    let file = TemporaryFile(app.blobs.temporary());
    if matches!(save(request.into_limited_body(), &file.0, limit).await?, Saved::TooLong) {
        return Err(ApiError::new(Code::TooLarge, format!("a model has at most {limit} bytes")));
    }
    let limits = app.config.limits.clone();
    let files = tokio::task::spawn_blocking(move || {
        if is_zip { unpack(&file.0, &limits) } else { Ok(vec![whole(&file.0)?]) }
    });
    let model = read(&app, id, files.await??).await?;
    Ok(Json(keep(&app, id, model).await?))
}

/// A child reads the files.
async fn read(app: &App, imageset: Uuid, files: Files) -> ApiResult<ModelPoses> {
    let photos: BTreeSet<String> =
        app.store.images_by_name(imageset).await?.into_iter().map(|image| image.name).collect();
    let request = WorkerRequest::ReadModel {
        files: files.iter().map(|(name, bytes)| (name.clone(), bytes.len() as u64)).collect(),
        photos,
    };
    let payload: Vec<u8> = files.into_iter().flat_map(|(_, bytes)| bytes).collect();
    let timeout = app.config.workers.decode_timeout;
    Ok(app.decoders.call(&request, &payload, timeout).await?)
}

/// Adds poses and cameras to what else is known of the images.
async fn keep(app: &App, imageset: Uuid, mut model: ModelPoses) -> ApiResult<ModelReport> {
    let mut report = ModelReport { unknown: model.unknown, ..ModelReport::default() };
    let mut priors = BTreeMap::new();
    for image in app.store.images_by_name(imageset).await? {
        let Some((pose, camera)) = model.images.remove(&image.name) else {
            report.missing.push(image.name);
            continue;
        };
        let mut prior = image.prior.unwrap_or_default();
        prior.pose = Some(pose);
        prior.camera = Some(camera);
        priors.insert(image.name, prior);
    }
    report.updated = app.store.put_priors(imageset, &priors).await?.updated;
    Ok(report)
}

fn whole(path: &Path) -> ApiResult<(String, Vec<u8>)> {
    let mut bytes = Vec::new();
    File::open(path)?.take(MAX_MODEL_BYTES + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > MAX_MODEL_BYTES {
        return Err(too_large());
    }
    Ok(("transforms.json".to_owned(), bytes))
}

/// The files of an archive that tell poses; what else is in it is not unpacked.
fn unpack(archive: &Path, limits: &Limits) -> ApiResult<Files> {
    let bad = |code, detail: String| ApiError::new(Code::Unprocessable(code), detail);
    let mut zip = open_archive(archive, limits)?;
    let mut files = Files::new();
    let mut left = MAX_MODEL_BYTES;
    for index in 0..zip.len() {
        let entry = zip
            .by_index(index)
            .map_err(|error| bad("not_an_archive", format!("entry {index}: {error}")))?;
        let name = entry.name().to_owned();
        let base = name.rsplit('/').next().unwrap_or_default();
        if !MODEL_FILES.contains(&base) {
            continue;
        }
        let mut bytes = Vec::new();
        entry
            .take(left + 1)
            .read_to_end(&mut bytes)
            .map_err(|error| bad("archive_entry_unreadable", format!("{name}: {error}")))?;
        left = left.checked_sub(bytes.len() as u64).ok_or_else(too_large)?;
        files.push((name, bytes));
    }
    Ok(files)
}

fn too_large() -> ApiError {
    ApiError::new(
        Code::TooLarge,
        format!("the files of a model have at most {MAX_MODEL_BYTES} bytes"),
    )
}
