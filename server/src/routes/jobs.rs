//! Jobs.

use std::sync::Arc;

use axum::{
    Json,
    extract::State,
    http::{HeaderMap, header},
    response::{IntoResponse, Redirect, Response},
};
use uuid::Uuid;
use volery_api::{
    CreateJob, EventsQuery, Job, JobEvents, JobKind, JobOption, JobState, JobsQuery, KnownDistance,
    Page, Preset, PresetInfo, RegisterMaps, RetryQuery, job_options, worker::OUT_FOLDER,
};

use super::{
    cameras::check_camera,
    exports::media_type_of,
    files::{FileAnswer, answer_file},
    tokens::check_name,
};
use crate::{
    answer::{Accepted, Deleted},
    auth::{Mapper, Viewer},
    error::{ApiError, ApiResult, Code},
    extract::{Asked, At, Body},
    idempotency::Identity,
    jobs::stages_from,
    state::App,
    store::PageAt,
};

/// Most maps that one job joins.
const MAX_REGISTERED_MAPS: usize = 16;

/// Queues a job.
#[utoipa::path(post, path = "/v1/jobs", tag = "jobs", request_body = CreateJob,
    params(("Idempotency-Key" = Option<String>, Header, description = "Names this request")),
    responses((status = 202, description = "It waits; `Location` says where to look", body = Job)))]
pub(crate) async fn create_job(
    State(app): State<Arc<App>>,
    Mapper(caller): Mapper,
    headers: HeaderMap,
    Body(request): Body<CreateJob>,
) -> ApiResult<Accepted<Job>> {
    submit(&app, &Identity::of(&caller, "jobs", &headers)?, &request).await
}

/// Queues a job that joins maps which share a part, as `POST /v1/jobs` with the kind
/// `register_maps` does. What each pair of maps said of the other is in the report of the job.
#[utoipa::path(post, path = "/v1/maps:register", tag = "maps", request_body = RegisterMaps,
    params(("Idempotency-Key" = Option<String>, Header, description = "Names this request")),
    responses((status = 202, description = "It waits; `Location` says where to look", body = Job)))]
pub(crate) async fn register_maps(
    State(app): State<Arc<App>>,
    Mapper(caller): Mapper,
    headers: HeaderMap,
    Body(request): Body<RegisterMaps>,
) -> ApiResult<Accepted<Job>> {
    submit(&app, &Identity::of(&caller, "maps:register", &headers)?, &request.into()).await
}

pub(super) async fn submit(
    app: &App,
    identity: &Identity,
    request: &CreateJob,
) -> ApiResult<Accepted<Job>> {
    check_request(app, request).await?;
    let (attempts, queued) = (app.config.jobs.max_attempts, app.config.limits.queued_jobs);
    let job = app.store.insert_job(identity, request, attempts, queued).await?;
    app.job_queued.notify_one();
    Ok(accepted(job))
}

fn accepted(job: Job) -> Accepted<Job> {
    Accepted(format!("/v1/jobs/{}", job.id), job)
}

async fn check_request(app: &App, request: &CreateJob) -> ApiResult<()> {
    let bad = |code, detail: String| Err(ApiError::new(Code::Unprocessable(code), detail));
    if let Some(problem) = request.options.problem() {
        return bad("bad_option", problem);
    }
    check_maps(app, request).await?;
    if request.kind == JobKind::RegisterMaps {
        return request.map_name.as_deref().map_or(Ok(()), check_name);
    }
    if request.imageset_ids.is_empty() {
        return bad("no_images", "imageset_ids is empty".to_owned());
    }
    if request.imageset_ids.len() > 100 {
        return bad("too_many_imagesets", "a job takes at most 100 image sets".to_owned());
    }
    if let Some(name) = &request.map_name {
        check_name(name)?;
    }
    if let Some(camera) = &request.camera {
        check_camera(camera)?;
    }
    let wrong = |distance: &&KnownDistance| !(distance.meters.is_finite() && distance.meters > 0.0);
    if let Some(distance) = request.known_distances.iter().find(wrong) {
        return bad("bad_distance", format!("a distance of {} m", distance.meters));
    }
    let mut images = 0;
    for (index, &id) in request.imageset_ids.iter().enumerate() {
        if request.imageset_ids[..index].contains(&id) {
            return bad("repeated_imageset", format!("image set {id} is named twice"));
        }
        match app.store.imageset(id).await {
            Ok(set) => images += set.num_images,
            Err(ApiError { code: Code::NotFound, detail, .. }) => {
                return bad("unknown_imageset", detail);
            }
            Err(error) => return Err(error),
        }
    }
    if images == 0 {
        return bad("no_images", "the image sets hold no images".to_owned());
    }
    Ok(())
}

/// The maps that a job names, by what its kind does with them.
async fn check_maps(app: &App, request: &CreateJob) -> ApiResult<()> {
    let bad = |code, detail: String| Err(ApiError::new(Code::Unprocessable(code), detail));
    let maps = &request.map_ids;
    match request.kind {
        JobKind::RegisterMaps if !request.imageset_ids.is_empty() => {
            return bad("unused_imagesets", "maps are joined without image sets".to_owned());
        }
        JobKind::RegisterMaps if !(2..=MAX_REGISTERED_MAPS).contains(&maps.len()) => {
            let detail = format!("2 to {MAX_REGISTERED_MAPS} maps are joined, got {}", maps.len());
            return bad("bad_map_ids", detail);
        }
        JobKind::Reconstruct | JobKind::ExtendMap if !maps.is_empty() => {
            return bad("bad_map_ids", "map_ids is for the kind `register_maps`".to_owned());
        }
        JobKind::ExtendMap if request.map_id.is_none() => {
            return bad("no_map", "map_id names the map that the photos join".to_owned());
        }
        _ => {}
    }
    for (index, &map) in maps.iter().chain(&request.map_id).enumerate() {
        if index < maps.len() && maps[..index].contains(&map) {
            return bad("repeated_map", format!("map {map} is named twice"));
        }
        if !app.store.has_map(map).await? {
            return bad("unknown_map", format!("there is no map {map}"));
        }
    }
    Ok(())
}

/// Lists jobs, oldest first.
#[utoipa::path(get, path = "/v1/jobs", tag = "jobs", params(JobsQuery),
    responses((status = 200, description = "Jobs", body = Page<Job>)))]
pub(crate) async fn list_jobs(
    State(app): State<Arc<App>>,
    _caller: Viewer,
    Asked(query): Asked<JobsQuery>,
) -> ApiResult<Json<Page<Job>>> {
    let at = PageAt::parse(query.limit, query.cursor.as_deref())?;
    let state = query.state.as_deref().map(|name| {
        JobState::from_name(name).ok_or_else(|| {
            ApiError::new(Code::Unprocessable("bad_state"), format!("no state is {name:?}"))
        })
    });
    let kind = query.kind.as_deref().map(|name| {
        JobKind::from_name(name).ok_or_else(|| {
            let detail = format!("no kind of job is {name:?}");
            ApiError::new(Code::Unprocessable("bad_kind"), detail)
        })
    });
    Ok(Json(app.store.jobs(state.transpose()?, kind.transpose()?, at).await?))
}

/// One job.
#[utoipa::path(get, path = "/v1/jobs/{id}", tag = "jobs",
    params(("id" = Uuid, Path, description = "Of the job")),
    responses((status = 200, description = "The job", body = Job)))]
pub(crate) async fn get_job(
    State(app): State<Arc<App>>,
    _caller: Viewer,
    At(id): At<Uuid>,
) -> ApiResult<Json<Job>> {
    Ok(Json(app.store.job(id).await?))
}

/// Ends a waiting job, or asks a running one to stop at its next unit of work.
#[utoipa::path(post, path = "/v1/jobs/{id}/cancel", tag = "jobs",
    params(("id" = Uuid, Path, description = "Of the job"),
        ("Idempotency-Key" = Option<String>, Header, description = "Names this request")),
    responses((status = 202, description = "The job", body = Job)))]
pub(crate) async fn cancel_job(
    State(app): State<Arc<App>>,
    _caller: Mapper,
    At(id): At<Uuid>,
) -> ApiResult<Accepted<Job>> {
    let job = app.store.cancel_job(id).await?;
    app.job_cancelled.notify_waiters();
    Ok(accepted(job))
}

/// Runs a failed, cancelled or partial job again. What it has finished is not done again, but for
/// `from_stage` and what comes after it.
#[utoipa::path(post, path = "/v1/jobs/{id}/retry", tag = "jobs",
    params(RetryQuery, ("id" = Uuid, Path, description = "Of the job"),
        ("Idempotency-Key" = Option<String>, Header, description = "Names this request")),
    responses((status = 202, description = "The job", body = Job)))]
pub(crate) async fn retry_job(
    State(app): State<Arc<App>>,
    _caller: Mapper,
    At(id): At<Uuid>,
    Asked(RetryQuery { from_stage }): Asked<RetryQuery>,
) -> ApiResult<Accepted<Job>> {
    if let Some(stage) = from_stage.as_deref().filter(|stage| stages_from(stage).is_none()) {
        let detail = format!("there is no stage {stage:?}");
        return Err(ApiError::new(Code::Unprocessable("bad_stage"), detail));
    }
    let job = app.store.retry_job(id, from_stage.as_deref()).await?;
    app.job_queued.notify_one();
    Ok(accepted(job))
}

/// Forgets a finished job with its events and its work folder. Its map stays.
#[utoipa::path(delete, path = "/v1/jobs/{id}", tag = "jobs",
    params(("id" = Uuid, Path, description = "Of the job")),
    responses((status = 204, description = "It is gone")))]
pub(crate) async fn delete_job(
    State(app): State<Arc<App>>,
    _caller: Mapper,
    At(id): At<Uuid>,
) -> ApiResult<Deleted> {
    app.store.delete_job(id).await?;
    if let Err(error) = tokio::fs::remove_dir_all(app.job_folder(id)).await
        && error.kind() != std::io::ErrorKind::NotFound
    {
        tracing::warn!(job = %id, %error, "cannot delete the work folder of job {id}");
    }
    Ok(Deleted)
}

/// What each preset means.
#[utoipa::path(get, path = "/v1/presets", tag = "jobs",
    responses((status = 200, description = "Presets", body = Vec<PresetInfo>)))]
pub(crate) async fn presets(_caller: Viewer) -> Json<Vec<PresetInfo>> {
    Json(Preset::ALL.into_iter().map(PresetInfo::from).collect())
}

/// The numbers that a job may set in its `options`, with their ranges and defaults.
#[utoipa::path(get, path = "/v1/options", tag = "jobs",
    responses((status = 200, description = "Options", body = Vec<JobOption>)))]
pub(crate) async fn options(_caller: Viewer) -> Json<Vec<JobOption>> {
    Json(job_options())
}

/// What happened to a job, in order.
#[utoipa::path(get, path = "/v1/jobs/{id}/events", tag = "jobs",
    params(EventsQuery, ("id" = Uuid, Path, description = "Of the job")),
    responses((status = 200, description = "Events", body = JobEvents)))]
pub(crate) async fn job_events(
    State(app): State<Arc<App>>,
    _caller: Viewer,
    At(id): At<Uuid>,
    Asked(query): Asked<EventsQuery>,
) -> ApiResult<Json<JobEvents>> {
    let limit = at_most(&query)?;
    app.store.job(id).await?;
    let items = app.store.events(id, query.after.unwrap_or(0), limit).await?;
    let last = items.last().map_or(query.after.unwrap_or(0), |event| event.seq);
    Ok(Json(JobEvents { items, last }))
}

/// How many events to answer.
pub(super) fn at_most(query: &EventsQuery) -> ApiResult<u32> {
    let limit = query.limit.unwrap_or(1000);
    if !(1..=1000).contains(&limit) {
        let detail = format!("limit must be 1 to 1000, got {limit}");
        return Err(ApiError::new(Code::Unprocessable("bad_limit"), detail));
    }
    Ok(limit)
}

/// The report of a job: leads to the report of the map it made. A job that failed has one of its
/// own, which says of every photo what was wrong. HTML for those who accept it, else JSON.
#[utoipa::path(get, path = "/v1/jobs/{id}/report", tag = "jobs",
    params(("id" = Uuid, Path, description = "Of the job")),
    responses(
        (status = 200, description = "Of a failed job", content(
            (serde_json::Value = "application/json"), (String = "text/html"))),
        (status = 206, description = "A range of it", content(
            (Vec<u8> = "application/json"), (Vec<u8> = "text/html"))),
        (status = 303, description = "`Location` is the report"),
        (status = 304, description = "It is what the client has")))]
pub(crate) async fn job_report(
    State(app): State<Arc<App>>,
    _caller: Viewer,
    At(id): At<Uuid>,
    headers: HeaderMap,
) -> ApiResult<Response> {
    let job = app.store.job(id).await?;
    let accept = headers.get(header::ACCEPT).and_then(|value| value.to_str().ok());
    let html = accept.is_some_and(|accept| accept.contains("text/html"));
    let name = if html { "report.html" } else { "report.json" };
    if let Some(outputs) = job.outputs {
        let (map, version) = (outputs.map_id, outputs.version);
        let to = format!("/v1/maps/{map}/export/{name}?version={version}");
        return Ok(Redirect::to(&to).into_response());
    }
    let path = app.job_folder(id).join(OUT_FOLDER).join(name);
    if job.state == JobState::Failed && path.is_file() {
        let etag = format!("{id}-{}-{name}", job.last_event);
        return answer_file(FileAnswer { path, etag, media_type: media_type_of(name) }, &headers)
            .await;
    }
    let detail = format!("job {id} is {} and has made no map", job.state.name());
    Err(ApiError::new(Code::Conflict("no_report"), detail))
}
