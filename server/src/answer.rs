//! The one place where what was done becomes an HTTP status. Failures are the matter of
//! [`crate::error`], files and their ranges of `routes::files`.

use axum::{
    Json,
    http::{HeaderValue, StatusCode, header},
    response::{IntoResponse, Response},
};
use serde::Serialize;

/// Something was made and is found at the path.
#[derive(Debug)]
pub(crate) struct Created<T>(pub(crate) String, pub(crate) T);

/// Something will be done; the path tells how far it is.
#[derive(Debug)]
pub(crate) struct Accepted<T>(pub(crate) String, pub(crate) T);

/// Some parts of the request were done, and others not.
#[derive(Debug)]
pub(crate) struct PartlyDone<T>(pub(crate) T);

/// Something is gone.
#[derive(Debug)]
pub(crate) struct Deleted;

/// The service cannot work at present.
#[derive(Debug)]
pub(crate) struct Unready<T>(pub(crate) T);

fn at(location: &str, status: StatusCode, body: impl Serialize) -> Response {
    let mut response = (status, Json(body)).into_response();
    // Paths are made of ids.
    if let Ok(location) = HeaderValue::try_from(location) {
        response.headers_mut().insert(header::LOCATION, location);
    }
    response
}

impl<T: Serialize> IntoResponse for Created<T> {
    fn into_response(self) -> Response {
        at(&self.0, StatusCode::CREATED, self.1)
    }
}

impl<T: Serialize> IntoResponse for Accepted<T> {
    fn into_response(self) -> Response {
        at(&self.0, StatusCode::ACCEPTED, self.1)
    }
}

impl<T: Serialize> IntoResponse for PartlyDone<T> {
    fn into_response(self) -> Response {
        (StatusCode::MULTI_STATUS, Json(self.0)).into_response()
    }
}

impl IntoResponse for Deleted {
    fn into_response(self) -> Response {
        StatusCode::NO_CONTENT.into_response()
    }
}

impl<T: Serialize> IntoResponse for Unready<T> {
    fn into_response(self) -> Response {
        (StatusCode::SERVICE_UNAVAILABLE, Json(self.0)).into_response()
    }
}
