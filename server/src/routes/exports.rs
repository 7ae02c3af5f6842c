//! A map in the formats of others.

use std::{
    fs::File,
    io::{self, Write},
    path::Path,
    sync::Arc,
};

use axum::{extract::State, http::HeaderMap, response::Response};
use uuid::Uuid;
use volery_api::{MapVersion, VersionQuery, worker::WorkerRequest};

use super::files::{FileAnswer, answer_file};
use crate::{
    auth::Viewer,
    error::{ApiError, ApiResult, Code},
    extract::{Asked, At},
    state::App,
    store::blobs::Blob,
};

/// Names under `export/`.
pub(crate) const EXPORTS: [&str; 15] = [
    "poses.csv",
    "sparse.ply",
    "dense.ply",
    "freespace.bin",
    "mesh.ply",
    "map.glb",
    "transforms.json",
    "colmap.zip",
    "colmap_bin.zip",
    "map.json",
    "report.json",
    "report.html",
    "localization.bin",
    "points.ply",
    "zones.zip",
];

/// A file of a map. `ETag`, `Range` and `If-None-Match` are honored.
#[utoipa::path(get, path = "/v1/maps/{id}/export/{name}", tag = "maps",
    params(VersionQuery, ("id" = Uuid, Path, description = "Of the map"),
        ("name" = String, Path, description = "One of the exports that `/v1/info` lists")),
    responses((status = 200, description = "The file", body = Vec<u8>, content_type = "*/*"),
        (status = 206, description = "A range of the file", body = Vec<u8>, content_type = "*/*"),
        (status = 304, description = "It is what the client has")))]
pub(crate) async fn export(
    State(app): State<Arc<App>>,
    _caller: Viewer,
    At((id, name)): At<(Uuid, String)>,
    Asked(query): Asked<VersionQuery>,
    headers: HeaderMap,
) -> ApiResult<Response> {
    if !EXPORTS.contains(&name.as_str()) {
        return Err(ApiError::new(Code::NotFound, format!("there is no export {name:?}"))
            .hint(format!("there are {}", EXPORTS.join(", "))));
    }
    answer_export(&app, id, query, &name, &headers).await
}

/// The points of a map as PLY.
#[utoipa::path(get, path = "/v1/maps/{id}/points", tag = "maps",
    params(VersionQuery, ("id" = Uuid, Path, description = "Of the map")),
    responses((status = 200, description = "The points", body = Vec<u8>, content_type = "application/octet-stream"),
        (status = 206, description = "A range of the file", body = Vec<u8>, content_type = "application/octet-stream"),
        (status = 304, description = "It is what the client has")))]
pub(crate) async fn map_points(
    State(app): State<Arc<App>>,
    _caller: Viewer,
    At(id): At<Uuid>,
    Asked(query): Asked<VersionQuery>,
    headers: HeaderMap,
) -> ApiResult<Response> {
    answer_export(&app, id, query, "sparse.ply", &headers).await
}

/// Where the air of a map is free: `VOLOCC01`, then as f64 the rotation of the grid in the map
/// (quaternion w x y z), its origin (the least corner of the first voxel) and the edge of a voxel, as
/// u32 the voxels along x, y and z, then runs of equal states, x first: u8 (0 unseen, 1 free,
/// 2 occupied) and their number as LEB128. All little endian. Outside of the grid all is unseen.
#[utoipa::path(get, path = "/v1/maps/{id}/freespace", tag = "maps",
    params(VersionQuery, ("id" = Uuid, Path, description = "Of the map")),
    responses((status = 200, description = "The grid", body = Vec<u8>, content_type = "application/octet-stream"),
        (status = 206, description = "A range of the file", body = Vec<u8>, content_type = "application/octet-stream"),
        (status = 304, description = "It is what the client has")))]
pub(crate) async fn map_free_space(
    State(app): State<Arc<App>>,
    _caller: Viewer,
    At(id): At<Uuid>,
    Asked(query): Asked<VersionQuery>,
    headers: HeaderMap,
) -> ApiResult<Response> {
    answer_export(&app, id, query, "freespace.bin", &headers).await
}

async fn answer_export(
    app: &Arc<App>,
    map: Uuid,
    query: VersionQuery,
    name: &str,
    headers: &HeaderMap,
) -> ApiResult<Response> {
    let version = app.store.version(map, query.version).await?;
    let name = if name == "points.ply" { "sparse.ply" } else { name };
    let held = version.files.iter().find(|file| file.path == name);
    let etag = match held {
        Some(file) => file.sha256.clone(),
        None => build(app, &version, name).await?.sha256,
    };
    let file = FileAnswer { path: app.blobs.path(&etag), etag, media_type: media_type_of(name) };
    answer_file(file, headers).await
}

pub(super) fn media_type_of(name: &str) -> &'static str {
    match name.rsplit('.').next() {
        Some("csv") => "text/csv",
        Some("json") => "application/json",
        Some("html") => "text/html; charset=utf-8",
        Some("glb") => "model/gltf-binary",
        Some("zip") => "application/zip",
        _ => "application/octet-stream",
    }
}

/// Makes an export that the map folder does not hold as a file. Equal maps give equal bytes.
async fn build(app: &Arc<App>, version: &MapVersion, name: &str) -> ApiResult<Blob> {
    let map_dir = app.map_folder(version).await?;
    let made = app.blobs.temporary();
    let result = match name {
        "colmap.zip" => zip_into_blob(app, &map_dir.join("colmap"), "colmap").await,
        "zones.zip" if version.files.iter().any(|file| file.path.starts_with("zones/")) => {
            zip_into_blob(app, &map_dir.join("zones"), "zones").await
        }
        "colmap_bin.zip" => match ask_worker(app, &map_dir, "colmap_bin", &made).await {
            Ok(()) => zip_into_blob(app, &made, "colmap").await,
            Err(error) => Err(error),
        },
        "map.glb" | "transforms.json" => match ask_worker(app, &map_dir, name, &made).await {
            Ok(()) => {
                let path = made.clone();
                app.with_blobs(move |blobs| blobs.put_file(&path)).await
            }
            Err(error) => Err(error),
        },
        _ => {
            let detail = format!("version {} of the map has no {name}", version.version);
            return Err(ApiError::new(Code::NotFound, detail));
        }
    };
    // A file, a folder, or nothing.
    let _ = tokio::fs::remove_dir_all(&made).await;
    let _ = tokio::fs::remove_file(&made).await;
    result
}

async fn ask_worker(app: &App, map_dir: &Path, format: &str, out: &Path) -> ApiResult<()> {
    let request = WorkerRequest::Export {
        map_dir: map_dir.display().to_string(),
        format: format.to_owned(),
        out: out.display().to_string(),
    };
    let timeout = app.config.workers.map_timeout;
    let _answer: serde_json::Value = app.localizers.call(&request, &[], timeout).await?;
    Ok(())
}

async fn zip_into_blob(app: &App, folder: &Path, prefix: &'static str) -> ApiResult<Blob> {
    let folder = folder.to_owned();
    app.with_blobs(move |blobs| {
        let path = blobs.temporary();
        let blob = zip_folder(&folder, prefix, &path).and_then(|()| blobs.put_file(&path));
        let _ = std::fs::remove_file(&path);
        blob
    })
    .await
}

/// Packs the files of a folder and those inside, in the order of their names and without their
/// times.
fn zip_folder(folder: &Path, prefix: &str, path: &Path) -> io::Result<()> {
    let mut zip = zip::ZipWriter::new(File::create_new(path)?);
    pack(&mut zip, folder, prefix)?;
    zip.finish().map_err(io::Error::other)?.flush()
}

fn pack(zip: &mut zip::ZipWriter<File>, folder: &Path, prefix: &str) -> io::Result<()> {
    let mut entries: Vec<_> = std::fs::read_dir(folder)?.collect::<Result<_, _>>()?;
    entries.sort_by_key(|entry| entry.file_name());
    let options = zip::write::SimpleFileOptions::default()
        .compression_method(zip::CompressionMethod::Deflated)
        .last_modified_time(zip::DateTime::default())
        .large_file(true);
    for entry in entries {
        let name = format!("{prefix}/{}", entry.file_name().to_string_lossy());
        if entry.path().is_dir() {
            pack(zip, &entry.path(), &name)?;
        } else {
            zip.start_file(name, options).map_err(io::Error::other)?;
            io::copy(&mut File::open(entry.path())?, zip)?;
        }
    }
    Ok(())
}
