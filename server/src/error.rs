//! The one place where what went wrong becomes an HTTP status.

use axum::{
    Json,
    http::{HeaderValue, StatusCode, header},
    response::{IntoResponse, Response},
};
use volery_api::{PROBLEM_JSON, Problem, WorkerFailure};

/// What went wrong, as programs read it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Code {
    /// The request cannot be read.
    BadRequest,
    /// No token, or one that is not valid.
    Unauthorized,
    /// The token's time is over.
    TokenExpired,
    /// The token's role may not do this.
    Forbidden,
    /// No such thing.
    NotFound,
    /// No such route.
    NoSuchRoute,
    /// The route does not know this method.
    MethodNotAllowed,
    /// The body came too slowly.
    RequestTimeout,
    /// The state of the thing forbids it; the text is the stable code.
    Conflict(&'static str),
    /// The body is larger than the limit.
    TooLarge,
    /// The body is of another media type.
    UnsupportedMediaType,
    /// The route opens sockets only.
    UpgradeRequired,
    /// The range lies outside of the file.
    RangeNotSatisfiable,
    /// The body can be read but means nothing; the text is the stable code.
    Unprocessable(&'static str),
    /// A worker refused the input; the code is the worker's.
    Refused(String),
    /// Too many requests of this kind.
    TooMany {
        /// Stable code.
        code: &'static str,
        /// When to come again.
        retry_after_s: u64,
    },
    /// A defect of the service.
    Internal,
    /// A child process died or took too long.
    Worker(&'static str),
    /// The disk is full.
    DiskFull,
}

/// A request that was not done.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct ApiError {
    /// Kind.
    pub(crate) code: Code,
    /// For people.
    pub(crate) detail: String,
    /// What to do about it.
    pub(crate) hint: Option<String>,
}

/// Result of a handler.
pub(crate) type ApiResult<T> = Result<T, ApiError>;

impl ApiError {
    /// Without a hint.
    pub(crate) fn new(code: Code, detail: impl Into<String>) -> Self {
        Self { code, detail: detail.into(), hint: None }
    }

    /// With a hint.
    pub(crate) fn hint(mut self, hint: impl Into<String>) -> Self {
        self.hint = Some(hint.into());
        self
    }

    /// `what` has no item `id`.
    pub(crate) fn not_found(what: &str, id: impl std::fmt::Display) -> Self {
        Self::new(Code::NotFound, format!("there is no {what} {id}"))
    }

    /// The cause goes to the log, not to the client.
    pub(crate) fn internal(cause: impl std::fmt::Display) -> Self {
        tracing::error!(%cause, "request failed");
        Self::new(Code::Internal, "the service failed; its log says why")
    }

    /// Stable code, HTTP status and title.
    fn status(&self) -> (&str, StatusCode, &'static str) {
        use StatusCode as S;
        match &self.code {
            Code::BadRequest => ("bad_request", S::BAD_REQUEST, "The request cannot be read"),
            Code::Unauthorized => ("unauthorized", S::UNAUTHORIZED, "A valid token is needed"),
            Code::TokenExpired => ("token_expired", S::UNAUTHORIZED, "The token has expired"),
            Code::Forbidden => ("forbidden", S::FORBIDDEN, "The token's role is too low"),
            Code::NotFound => ("not_found", S::NOT_FOUND, "There is no such thing"),
            Code::NoSuchRoute => ("no_such_route", S::NOT_FOUND, "There is no such route"),
            Code::MethodNotAllowed => {
                ("method_not_allowed", S::METHOD_NOT_ALLOWED, "Not a method of this route")
            }
            Code::RequestTimeout => {
                ("request_timeout", S::REQUEST_TIMEOUT, "The request took too long")
            }
            Code::Conflict(code) => (code, S::CONFLICT, "The present state forbids it"),
            Code::TooLarge => ("too_large", S::PAYLOAD_TOO_LARGE, "The body is too large"),
            Code::UnsupportedMediaType => {
                ("unsupported_media_type", S::UNSUPPORTED_MEDIA_TYPE, "The body is of another type")
            }
            Code::UpgradeRequired => {
                ("upgrade_required", S::UPGRADE_REQUIRED, "The route opens sockets only")
            }
            Code::RangeNotSatisfiable => (
                "range_not_satisfiable",
                S::RANGE_NOT_SATISFIABLE,
                "The range lies outside of the file",
            ),
            Code::Unprocessable(code) => {
                (code, S::UNPROCESSABLE_ENTITY, "The request means nothing sensible")
            }
            Code::Refused(code) => {
                (code.as_str(), S::UNPROCESSABLE_ENTITY, "The input was refused")
            }
            Code::TooMany { code, .. } => (code, S::TOO_MANY_REQUESTS, "Too many requests"),
            Code::Internal => ("internal", S::INTERNAL_SERVER_ERROR, "The service failed"),
            Code::Worker(code) => (code, S::SERVICE_UNAVAILABLE, "A worker process failed"),
            Code::DiskFull => ("disk_full", S::INSUFFICIENT_STORAGE, "The disk is full"),
        }
    }

    /// The stable code.
    pub(crate) fn code(&self) -> &str {
        self.status().0
    }

    /// On the wire.
    pub(crate) fn problem(&self) -> Problem {
        let (code, status, title) = self.status();
        Problem {
            kind: format!("urn:volery:problem:{code}"),
            title: title.to_owned(),
            status: status.as_u16(),
            code: code.to_owned(),
            detail: self.detail.clone(),
            hint: self.hint.clone(),
            instance: None,
        }
    }
}

impl IntoResponse for ApiError {
    fn into_response(self) -> Response {
        let (_, status, _) = self.status();
        let mut response = (status, Json(self.problem())).into_response();
        let headers = response.headers_mut();
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(PROBLEM_JSON));
        if status == StatusCode::UNAUTHORIZED {
            headers.insert(header::WWW_AUTHENTICATE, HeaderValue::from_static("Bearer"));
        }
        if let Code::TooMany { retry_after_s, .. } = self.code {
            headers.insert(header::RETRY_AFTER, HeaderValue::from(retry_after_s));
        }
        if status == StatusCode::SERVICE_UNAVAILABLE {
            headers.insert(header::RETRY_AFTER, HeaderValue::from_static("1"));
        }
        response.extensions_mut().insert(self);
        response
    }
}

impl From<sqlx::Error> for ApiError {
    fn from(error: sqlx::Error) -> Self {
        let full = error
            .as_database_error()
            .is_some_and(|database| database.message().contains("database or disk is full"));
        if full { disk_full() } else { Self::internal(error) }
    }
}

impl From<std::io::Error> for ApiError {
    fn from(error: std::io::Error) -> Self {
        match error.kind() {
            std::io::ErrorKind::StorageFull | std::io::ErrorKind::QuotaExceeded => disk_full(),
            _ => Self::internal(error),
        }
    }
}

impl From<serde_json::Error> for ApiError {
    fn from(error: serde_json::Error) -> Self {
        Self::internal(error)
    }
}

impl From<tokio::task::JoinError> for ApiError {
    fn from(error: tokio::task::JoinError) -> Self {
        Self::internal(error)
    }
}

impl From<WorkerFailure> for ApiError {
    fn from(failure: WorkerFailure) -> Self {
        Self { code: Code::Refused(failure.code), detail: failure.detail, hint: failure.hint }
    }
}

fn disk_full() -> ApiError {
    ApiError::new(Code::DiskFull, "no space is left for data").hint("free some space and retry")
}
