//! Parts of a request, with our errors when they are wrong.

use axum::{
    Json,
    body::Bytes,
    extract::{
        FromRequest, FromRequestParts, Path, Query, Request,
        multipart::MultipartError,
        rejection::{BytesRejection, FailedToBufferBody},
    },
    http::{HeaderMap, StatusCode, header, request::Parts},
};
use serde::{Serialize, de::DeserializeOwned};
use serde_json::Value;

use crate::error::{ApiError, ApiResult, Code};

/// A JSON body. Fields that the type does not know are refused.
#[derive(Debug)]
pub(crate) struct Body<T>(pub(crate) T);

impl<T: DeserializeOwned + Serialize, S: Send + Sync> FromRequest<S> for Body<T> {
    type Rejection = ApiError;

    async fn from_request(request: Request, state: &S) -> ApiResult<Self> {
        if !media_type(request.headers()).is_some_and(|kind| is_json(&kind)) {
            return Err(ApiError::new(
                Code::UnsupportedMediaType,
                "the body must be application/json",
            ));
        }
        let bytes = Bytes::from_request(request, state).await.map_err(body_error)?;
        parse_json(&bytes).map(Self)
    }
}

fn is_json(kind: &str) -> bool {
    kind == "application/json" || kind.ends_with("+json")
}

/// JSON from bytes: syntax errors are 400, wrong content is 422.
pub(crate) fn parse_json<T: DeserializeOwned + Serialize>(bytes: &[u8]) -> ApiResult<T> {
    let Json(value) = Json::<T>::from_bytes(bytes).map_err(|rejection| {
        let detail = rejection.body_text();
        if rejection.status() == StatusCode::UNPROCESSABLE_ENTITY {
            let unknown = detail.contains("unknown field");
            let code = if unknown { "unknown_field" } else { "invalid_body" };
            ApiError::new(Code::Unprocessable(code), detail)
        } else if serde_json::from_slice::<serde::de::IgnoredAny>(bytes).is_ok() {
            // Well-formed, but an array is too long: serde_json calls that trailing characters.
            ApiError::new(Code::Unprocessable("invalid_body"), detail)
        } else {
            ApiError::new(Code::BadRequest, detail)
        }
    })?;
    if is_positional(&serde_json::from_slice(bytes)?, &serde_json::to_value(&value)?) {
        let detail = "an array stands where an object with named fields belongs";
        return Err(ApiError::new(Code::Unprocessable("invalid_body"), detail));
    }
    Ok(value)
}

/// Whether an array was read as an object: serde takes fields by position, too.
fn is_positional(sent: &Value, read: &Value) -> bool {
    match (sent, read) {
        (Value::Array(_), Value::Object(_)) => true,
        (Value::Array(sent), Value::Array(read)) => {
            sent.iter().zip(read).any(|(sent, read)| is_positional(sent, read))
        }
        (Value::Object(sent), Value::Object(read)) => sent
            .iter()
            .any(|(key, sent)| read.get(key).is_some_and(|read| is_positional(sent, read))),
        _ => false,
    }
}

/// JSON in a header, if the header is there.
pub(crate) fn json_header<T: DeserializeOwned + Serialize>(
    headers: &HeaderMap,
    name: &str,
) -> ApiResult<Option<T>> {
    headers
        .get(name)
        .map(|value| parse_json(value.as_bytes()))
        .transpose()
        .map_err(|error| ApiError { detail: format!("header {name}: {}", error.detail), ..error })
}

/// The media type of a body without its parameters, lower case.
pub(crate) fn media_type(headers: &HeaderMap) -> Option<String> {
    let value = headers.get(header::CONTENT_TYPE)?.to_str().ok()?;
    Some(value.split(';').next()?.trim().to_ascii_lowercase())
}

/// A body that could not be read.
pub(crate) fn body_error(rejection: BytesRejection) -> ApiError {
    match &rejection {
        BytesRejection::FailedToBufferBody(FailedToBufferBody::LengthLimitError(_)) => {
            ApiError::new(Code::TooLarge, "the body is larger than this route takes")
                .hint("/v1/info lists the limits")
        }
        _ => stream_error(&rejection),
    }
}

/// A body that ended or paused.
pub(crate) fn stream_error(error: &(dyn std::error::Error + 'static)) -> ApiError {
    let mut cause = Some(error);
    while let Some(error) = cause {
        if error.is::<http_body_util::LengthLimitError>() {
            return ApiError::new(Code::TooLarge, "the body is larger than this route takes")
                .hint("/v1/info lists the limits");
        }
        if error.is::<crate::pace::TooSlow>() {
            return ApiError::new(Code::RequestTimeout, "the body came too slowly");
        }
        cause = error.source();
    }
    ApiError::new(Code::BadRequest, format!("the body ended early: {error}"))
}

/// A part of a multipart body that could not be read.
pub(crate) fn multipart_error(error: &MultipartError) -> ApiError {
    if error.status() == StatusCode::PAYLOAD_TOO_LARGE {
        return ApiError::new(Code::TooLarge, "the body is larger than this route takes")
            .hint("/v1/info lists the limits");
    }
    match stream_error(error) {
        ApiError { code: Code::BadRequest, .. } => {
            ApiError::new(Code::BadRequest, error.body_text())
        }
        error => error,
    }
}

/// Parts of the path.
#[derive(Debug)]
pub(crate) struct At<T>(pub(crate) T);

impl<T: DeserializeOwned + Send, S: Send + Sync> FromRequestParts<S> for At<T> {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> ApiResult<Self> {
        match Path::from_request_parts(parts, state).await {
            Ok(Path(value)) => Ok(Self(value)),
            Err(rejection) => Err(ApiError::new(Code::BadRequest, rejection.body_text())
                .hint("ids are as the service gave them: UUIDs, and numbers 1 to 254 of drones")),
        }
    }
}

/// The query string. Fields that the type does not know are refused.
#[derive(Debug)]
pub(crate) struct Asked<T>(pub(crate) T);

impl<T: DeserializeOwned, S: Send + Sync> FromRequestParts<S> for Asked<T> {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> ApiResult<Self> {
        match Query::from_request_parts(parts, state).await {
            Ok(Query(value)) => Ok(Self(value)),
            Err(rejection) => {
                let detail = rejection.body_text();
                let unknown = detail.contains("unknown field");
                let code = if unknown { "unknown_field" } else { "invalid_query" };
                Err(ApiError::new(Code::Unprocessable(code), detail))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use volery_api::{CreateImageSet, PutPriors};

    use super::*;

    #[test]
    fn fields_are_named_never_counted() {
        assert!(parse_json::<CreateImageSet>(br#"{"name":"hall"}"#).is_ok());
        let positional = parse_json::<CreateImageSet>(br#"["hall"]"#).unwrap_err();
        assert_eq!(positional.code(), "invalid_body");
        let deep = br#"{"priors":{"a.jpg":{"height":[1,2]}}}"#;
        assert_eq!(parse_json::<PutPriors>(deep).unwrap_err().code(), "invalid_body");
        let long = br#"{"priors":{"a.jpg":{"position":{"position":[1,2,3,4],"sigma":1}}}}"#;
        assert_eq!(parse_json::<PutPriors>(long).unwrap_err().code(), "invalid_body");
        let torn = br#"{"priors":{"a.jpg""#;
        assert_eq!(parse_json::<PutPriors>(torn).unwrap_err().code(), "bad_request");
        let vector = br#"{"priors":{"a.jpg":{"position":{"position":[1,2,3],"sigma":1}}}}"#;
        assert!(parse_json::<PutPriors>(vector).is_ok());
    }
}
