//! Maps and their versions.

use std::sync::Arc;

use axum::{Json, extract::State, http::HeaderMap};
use uuid::Uuid;
use volery_api::{
    ActivateMap, AlignRequest, Aligned, Camera, CameraPose, Map, MapCamera, MapCameras, MapVersion,
    Page, PageQuery, PatchMap, VersionQuery, worker::WorkerRequest,
};

use super::tokens::check_name;
use crate::{
    answer::{Created, Deleted},
    auth::{Mapper, Viewer},
    error::{ApiError, ApiResult, Code},
    extract::{Asked, At, Body},
    idempotency::Identity,
    state::App,
    store::{NewVersion, PageAt},
};

/// Lists maps.
#[utoipa::path(get, path = "/v1/maps", tag = "maps", params(PageQuery),
    responses((status = 200, description = "Maps", body = Page<Map>)))]
pub(crate) async fn list_maps(
    State(app): State<Arc<App>>,
    _caller: Viewer,
    Asked(query): Asked<PageQuery>,
) -> ApiResult<Json<Page<Map>>> {
    let at = PageAt::parse(query.limit, query.cursor.as_deref())?;
    Ok(Json(app.store.maps(at).await?))
}

/// One map with its active version.
#[utoipa::path(get, path = "/v1/maps/{id}", tag = "maps",
    params(("id" = Uuid, Path, description = "Of the map")),
    responses((status = 200, description = "The map", body = Map)))]
pub(crate) async fn get_map(
    State(app): State<Arc<App>>,
    _caller: Viewer,
    At(id): At<Uuid>,
) -> ApiResult<Json<Map>> {
    Ok(Json(app.store.map(id).await?))
}

/// Renames a map.
#[utoipa::path(patch, path = "/v1/maps/{id}", tag = "maps", request_body = PatchMap,
    params(("id" = Uuid, Path, description = "Of the map")),
    responses((status = 200, description = "The map", body = Map)))]
pub(crate) async fn patch_map(
    State(app): State<Arc<App>>,
    _caller: Mapper,
    At(id): At<Uuid>,
    Body(patch): Body<PatchMap>,
) -> ApiResult<Json<Map>> {
    match &patch.name {
        None => Ok(Json(app.store.map(id).await?)),
        Some(name) => {
            check_name(name)?;
            Ok(Json(app.store.rename_map(id, name).await?))
        }
    }
}

/// Deletes a map with all its versions.
#[utoipa::path(delete, path = "/v1/maps/{id}", tag = "maps",
    params(("id" = Uuid, Path, description = "Of the map")),
    responses((status = 204, description = "It is gone")))]
pub(crate) async fn delete_map(
    State(app): State<Arc<App>>,
    _caller: Mapper,
    At(id): At<Uuid>,
) -> ApiResult<Deleted> {
    if !app.store.delete_map(id).await? {
        return Err(ApiError::not_found("map", id));
    }
    app.drop_map_folder(id).await;
    Ok(Deleted)
}

/// Lists the versions of a map.
#[utoipa::path(get, path = "/v1/maps/{id}/versions", tag = "maps",
    params(PageQuery, ("id" = Uuid, Path, description = "Of the map")),
    responses((status = 200, description = "Versions", body = Page<MapVersion>)))]
pub(crate) async fn list_versions(
    State(app): State<Arc<App>>,
    _caller: Viewer,
    At(id): At<Uuid>,
    Asked(query): Asked<PageQuery>,
) -> ApiResult<Json<Page<MapVersion>>> {
    let at = PageAt::parse(query.limit, query.cursor.as_deref())?;
    app.store.map(id).await?;
    Ok(Json(app.store.versions(id, at).await?))
}

/// Makes a version answer from now on.
#[utoipa::path(post, path = "/v1/maps/{id}/activate", tag = "maps", request_body = ActivateMap,
    params(("id" = Uuid, Path, description = "Of the map"),
        ("Idempotency-Key" = Option<String>, Header, description = "Names this request")),
    responses((status = 200, description = "The map", body = Map)))]
pub(crate) async fn activate_version(
    State(app): State<Arc<App>>,
    _caller: Mapper,
    At(id): At<Uuid>,
    Body(request): Body<ActivateMap>,
) -> ApiResult<Json<Map>> {
    Ok(Json(app.store.activate_version(id, request.version).await?))
}

/// Makes a new version in another frame or scale, from a known distance, a similarity or surveyed
/// points. The new version is active.
#[utoipa::path(post, path = "/v1/maps/{id}/align", tag = "maps", request_body = AlignRequest,
    params(VersionQuery, ("id" = Uuid, Path, description = "Of the map"),
        ("Idempotency-Key" = Option<String>, Header, description = "Names this request")),
    responses((status = 201, description = "The new version", body = Aligned)))]
pub(crate) async fn align_map(
    State(app): State<Arc<App>>,
    Mapper(caller): Mapper,
    At(id): At<Uuid>,
    Asked(query): Asked<VersionQuery>,
    headers: HeaderMap,
    Body(align): Body<AlignRequest>,
) -> ApiResult<Created<Aligned>> {
    check_align(&align)?;
    let identity = Identity::of(&caller, &format!("maps/{id}/align"), &headers)?;
    let text = serde_json::to_string(&align)?;
    if identity.keyed
        && let Some((version, residuals)) = app.store.version_by_key(&identity, &text).await?
    {
        return Ok(aligned(version, residuals));
    }
    let parent = app.store.version(id, query.version).await?;
    let map_dir = app.map_folder(&parent).await?;
    let out_dir = app.blobs.temporary();
    let request = WorkerRequest::Align {
        map_dir: map_dir.display().to_string(),
        out_dir: out_dir.display().to_string(),
        align,
    };
    let answer: ApiResult<serde_json::Value> = app
        .localizers
        .call(&request, &[], app.config.workers.map_timeout)
        .await
        .map_err(ApiError::from);
    let made = match answer {
        Ok(answer) => {
            let folder = out_dir.clone();
            let files = app.with_blobs(move |blobs| blobs.put_folder(&folder)).await;
            let info = tokio::fs::read(out_dir.join("map.json")).await;
            files.and_then(|files| Ok((answer, files, serde_json::from_slice(&info?)?)))
        }
        Err(error) => Err(error),
    };
    // It may not have been made.
    let _ = tokio::fs::remove_dir_all(&out_dir).await;
    let (answer, files, info) = made?;
    let residuals = answer.get("residuals").cloned().unwrap_or_default();
    let version = app
        .store
        .insert_map_version(&NewVersion {
            map_id: id,
            name: String::new(),
            job_id: None,
            parent_version: Some(parent.version),
            info,
            residuals: Some(residuals.clone()),
            files,
            activate: true,
            request: Some((identity.id.to_string(), text)),
        })
        .await?;
    Ok(aligned(version, residuals))
}

fn aligned(version: MapVersion, residuals: serde_json::Value) -> Created<Aligned> {
    let location = format!("/v1/maps/{}/versions", version.map_id);
    Created(location, Aligned { version, residuals })
}

fn check_align(align: &AlignRequest) -> ApiResult<()> {
    let bad = |detail: &str| Err(ApiError::new(Code::Unprocessable("bad_alignment"), detail));
    match align {
        AlignRequest::KnownDistance(distance)
            if !(distance.meters.is_finite() && distance.meters > 0.0) =>
        {
            bad("the distance must be positive")
        }
        AlignRequest::Sim3(sim3) => sim3.problem().map_or(Ok(()), |problem| bad(&problem)),
        AlignRequest::ControlPoints(points) if points.len() < 3 => {
            bad("at least three surveyed points are needed")
        }
        _ => Ok(()),
    }
}

/// The posed images of a map and its cameras.
#[utoipa::path(get, path = "/v1/maps/{id}/cameras", tag = "maps",
    params(VersionQuery, ("id" = Uuid, Path, description = "Of the map")),
    responses((status = 200, description = "Poses", body = MapCameras)))]
pub(crate) async fn map_cameras(
    State(app): State<Arc<App>>,
    _caller: Viewer,
    At(id): At<Uuid>,
    Asked(query): Asked<VersionQuery>,
) -> ApiResult<Json<MapCameras>> {
    let version = app.store.version(id, query.version).await?;
    let file = version
        .files
        .iter()
        .find(|file| file.path == "poses.csv")
        .ok_or_else(|| ApiError::not_found("poses.csv of map", id))?;
    let text = tokio::fs::read_to_string(app.blobs.path(&file.sha256)).await?;
    let cameras: Vec<Camera> = version
        .info
        .get("cameras")
        .cloned()
        .and_then(|cameras| serde_json::from_value(cameras).ok())
        .unwrap_or_default();
    let images = text.lines().filter_map(parse_pose).collect();
    Ok(Json(MapCameras { map_id: id, version: version.version, cameras, images }))
}

/// A row of `poses.csv`: `image,qw,qx,qy,qz,tx,ty,tz`; `None` for the header.
fn parse_pose(line: &str) -> Option<MapCamera> {
    let mut cells = line.trim().rsplitn(8, ',');
    let mut numbers = [0.0; 7];
    for number in numbers.iter_mut().rev() {
        *number = cells.next()?.trim().parse().ok().filter(|value: &f64| value.is_finite())?;
    }
    let [w, x, y, z, tx, ty, tz] = numbers;
    let pose = CameraPose { position: [tx, ty, tz], orientation: [w, x, y, z] };
    Some(MapCamera { image: cells.next()?.to_owned(), pose })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poses_are_read_and_headers_are_not() {
        let camera = parse_pose("a/b.jpg,1,0,0,0,1.5,-2,3").unwrap();
        assert_eq!(camera.image, "a/b.jpg");
        assert_eq!(camera.pose.orientation, [1.0, 0.0, 0.0, 0.0]);
        assert_eq!(camera.pose.position, [1.5, -2.0, 3.0]);
        assert!(parse_pose("image,qw,qx,qy,qz,tx,ty,tz").is_none());
        assert!(parse_pose("a.jpg,1,0,0,0,NaN,0,0").is_none());
    }
}
