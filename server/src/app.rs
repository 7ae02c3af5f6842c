//! The router, and the description that comes with it.

use std::{any::Any, sync::Arc};

use axum::{
    Json, Router,
    extract::{DefaultBodyLimit, Request, State},
    http::{HeaderValue, header},
    middleware::{Next, from_fn_with_state},
    response::{IntoResponse, Response},
};
use tower_http::catch_panic::CatchPanicLayer;
use utoipa::OpenApi;
use utoipa_axum::{router::OpenApiRouter, routes};
use volery_api::{PROBLEM_JSON, Problem, ws};

use crate::{
    audit::note,
    description::complete,
    error::{ApiError, Code},
    idempotency::once,
    pace::keep_pace,
    routes::{
        beacons, cameras, drone_cameras, drones, exports, flights, frames, images, imagesets,
        job_log, jobs, leases, localize, maps, model, page, parts, priors, recordings, render,
        service, tokens, uploads,
    },
    state::App,
    ws as socket,
};

#[derive(OpenApi)]
#[openapi(
    info(
        title = "Volery",
        description = "Photos become a metric map; a photo finds its pose in it.\n\nUnits are SI, angles radians. The frame `map` is right-handed with z up; a camera looks along z with x right and y down. Quaternions are w, x, y, z. Errors are `application/problem+json` with a stable `code`.",
        license(name = "MIT OR Apache-2.0", identifier = "MIT OR Apache-2.0"),
    ),
    security(("bearer" = [])),
    components(schemas(Problem, ws::ClientMessage, ws::ServerMessage, ws::FrameHeader)),
)]
struct Description;

/// Routes that answer at once.
fn quick_routes() -> OpenApiRouter<Arc<App>> {
    OpenApiRouter::with_openapi(Description::openapi())
        .routes(routes!(page::front_page))
        .routes(routes!(service::healthz))
        .routes(routes!(service::readyz))
        .routes(routes!(service::openapi_yaml))
        .routes(routes!(service::metrics))
        .routes(routes!(service::info))
        .routes(routes!(tokens::create_token, tokens::list_tokens))
        .routes(routes!(tokens::delete_token))
        .routes(routes!(service::audit))
        .routes(routes!(cameras::create_camera, cameras::list_cameras))
        .routes(routes!(cameras::camera_models))
        .routes(routes!(cameras::get_camera, cameras::put_camera))
        .routes(routes!(imagesets::create_imageset, imagesets::list_imagesets))
        .routes(routes!(
            imagesets::get_imageset,
            imagesets::patch_imageset,
            imagesets::delete_imageset
        ))
        .routes(routes!(priors::put_priors))
        .routes(routes!(images::get_image, images::delete_image))
        .routes(routes!(images::image_bytes))
        .routes(routes!(jobs::create_job, jobs::list_jobs))
        .routes(routes!(jobs::get_job, jobs::delete_job))
        .routes(routes!(jobs::job_events))
        .routes(routes!(job_log::job_log))
        .routes(routes!(jobs::job_report))
        .routes(routes!(jobs::presets))
        .routes(routes!(jobs::options))
        .routes(routes!(maps::list_maps))
        .routes(routes!(jobs::register_maps))
        .routes(routes!(maps::get_map, maps::patch_map, maps::delete_map))
        .routes(routes!(maps::list_versions))
        .routes(routes!(maps::map_cameras))
        .routes(routes!(flights::get_flight))
        .routes(routes!(flights::list_geofences, flights::put_geofence))
        .routes(routes!(flights::delete_geofence))
        .routes(routes!(drones::list_drones))
        .routes(routes!(
            drones::get_drone,
            drones::put_drone,
            drones::patch_drone,
            drones::delete_drone
        ))
        .routes(routes!(drones::drone_state))
        .routes(routes!(drones::drone_events))
        .routes(routes!(drones::drone_command))
        .routes(routes!(drones::drone_pose))
        .routes(routes!(
            drone_cameras::put_drone_camera,
            drone_cameras::drone_camera,
            drone_cameras::delete_drone_camera
        ))
        .routes(routes!(frames::newest_frame))
        .routes(routes!(drones::all_stop))
        .routes(routes!(recordings::recording_file, recordings::delete_recording))
        .routes(routes!(leases::create_lease, leases::list_leases))
        .routes(routes!(leases::renew_lease))
        .routes(routes!(leases::delete_lease))
        .routes(routes!(beacons::estimate))
}

/// Routes that answer at once, and whose work leaves no row that a key could name.
fn commanding_routes() -> OpenApiRouter<Arc<App>> {
    OpenApiRouter::new()
        .routes(routes!(jobs::cancel_job))
        .routes(routes!(jobs::retry_job))
        .routes(routes!(maps::activate_version))
        .routes(routes!(flights::create_flight, flights::list_flights))
        .routes(routes!(flights::start_flight))
        .routes(routes!(flights::pause_flight))
        .routes(routes!(flights::resume_flight))
        .routes(routes!(flights::abort_flight))
        .routes(routes!(drones::command_drone))
        .routes(routes!(flights::fly_to_target))
        .routes(routes!(recordings::start_recording, recordings::list_recordings))
        .routes(routes!(recordings::stop_recording))
}

/// Routes that write what they take to the disk as it comes.
fn upload_routes() -> OpenApiRouter<Arc<App>> {
    OpenApiRouter::new()
        .routes(routes!(uploads::upload_images, images::list_images))
        .routes(routes!(uploads::upload_archive))
        .routes(routes!(model::put_model))
        .routes(routes!(parts::create_upload))
        .routes(routes!(parts::get_upload, parts::append_part, parts::delete_upload))
        .routes(routes!(parts::complete_upload))
}

/// Routes that wait for workers or stay open.
fn slow_routes() -> OpenApiRouter<Arc<App>> {
    OpenApiRouter::new()
        .routes(routes!(images::image_thumbnail))
        .routes(routes!(maps::align_map))
        .routes(routes!(exports::map_points))
        .routes(routes!(exports::map_free_space))
        .routes(routes!(exports::export))
        .routes(routes!(localize::localize))
        .routes(routes!(frames::drone_frame))
        .routes(routes!(localize::localize_in_maps))
        .routes(routes!(render::render))
        .routes(routes!(socket::open_socket))
}

/// The description alone.
pub fn openapi() -> utoipa::openapi::OpenApi {
    complete(
        quick_routes()
            .merge(commanding_routes())
            .merge(upload_routes())
            .merge(slow_routes())
            .into_openapi(),
    )
}

/// The description as text.
pub fn openapi_yaml() -> String {
    openapi().to_yaml().unwrap_or_default()
}

/// Every route with everything around it.
pub(crate) fn router(app: Arc<App>) -> Router {
    let limits = &app.config.limits;
    // A photo among other parts of a form.
    let form = limits.image_bytes + limits.json_bytes;
    let upload = limits.archive_bytes.max(limits.upload_bytes);
    let quick: Router<Arc<App>> = quick_routes().into();
    let commanding: Router<Arc<App>> = commanding_routes().into();
    let slow: Router<Arc<App>> = slow_routes().into();
    let uploads: Router<Arc<App>> = upload_routes().into();
    quick
        .merge(commanding.layer(from_fn_with_state(Arc::clone(&app), once)))
        .merge(page::router())
        .layer(from_fn_with_state(Arc::clone(&app), limit_time))
        .layer(DefaultBodyLimit::max(limits.json_bytes as usize))
        .merge(slow.layer(DefaultBodyLimit::max(form as usize)))
        .merge(uploads.layer(DefaultBodyLimit::max(upload as usize)))
        .fallback(|| async { ApiError::new(Code::NoSuchRoute, "there is no such route") })
        .method_not_allowed_fallback(|| async {
            ApiError::new(Code::MethodNotAllowed, "the route does not know this method")
        })
        .layer(from_fn_with_state(Arc::clone(&app), keep_pace))
        .layer(CatchPanicLayer::custom(answer_panic))
        .layer(from_fn_with_state(Arc::clone(&app), note))
        .layer(from_fn_with_state(Arc::clone(&app), finish))
        .with_state(app)
}

/// Ends what takes too long.
async fn limit_time(State(app): State<Arc<App>>, request: Request, next: Next) -> Response {
    match tokio::time::timeout(app.config.request_timeout, next.run(request)).await {
        Ok(response) => response,
        Err(_) => ApiError::new(Code::RequestTimeout, "the request took too long").into_response(),
    }
}

/// Counts answers, names the path in errors, and keeps browsers from guessing types.
async fn finish(State(app): State<Arc<App>>, request: Request, next: Next) -> Response {
    let path = request.uri().path().to_owned();
    let mut response = next.run(request).await;
    app.metrics.answered(response.status().as_u16());
    if let Some(error) = response.extensions_mut().remove::<ApiError>() {
        let problem = Problem { instance: Some(path), ..error.problem() };
        let mut headers = std::mem::take(response.headers_mut());
        headers.remove(header::CONTENT_LENGTH);
        response = (response.status(), Json(problem)).into_response();
        response.headers_mut().extend(headers);
        response.headers_mut().insert(header::CONTENT_TYPE, HeaderValue::from_static(PROBLEM_JSON));
    }
    let headers = response.headers_mut();
    headers.insert(header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    headers.entry(header::CACHE_CONTROL).or_insert(HeaderValue::from_static("no-cache"));
    response
}

fn answer_panic(cause: Box<dyn Any + Send>) -> Response {
    let text = cause
        .downcast_ref::<String>()
        .map(String::as_str)
        .or_else(|| cause.downcast_ref::<&str>().copied())
        .unwrap_or("no message");
    ApiError::internal(format!("panic: {text}")).into_response()
}
