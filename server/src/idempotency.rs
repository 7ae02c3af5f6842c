//! `Idempotency-Key`: the same key from the same caller names the same thing.
//!
//! The id of what is made follows from caller, route and key. So making it twice is a conflict on
//! its primary key, and no crash between two writes can make two of it.

use axum::http::HeaderMap;
use sha2::{Digest, Sha256};
use uuid::Uuid;

use crate::{
    auth::Caller,
    error::{ApiError, ApiResult, Code},
};

/// Name of the header, lower case.
pub(crate) const IDEMPOTENCY_KEY: &str = "idempotency-key";

/// Id of a thing to be made.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Identity {
    pub(crate) id: Uuid,
    /// Whether the client gave a key.
    pub(crate) keyed: bool,
}

impl Identity {
    /// Of what is made once for each request.
    pub(crate) fn fresh() -> Self {
        Self { id: Uuid::now_v7(), keyed: false }
    }

    /// From the key of a request to `route`, else a fresh one.
    pub(crate) fn of(caller: &Caller, route: &str, headers: &HeaderMap) -> ApiResult<Self> {
        let Some(key) = headers.get(IDEMPOTENCY_KEY) else {
            return Ok(Self::fresh());
        };
        let key = key.as_bytes();
        if key.is_empty() || key.len() > 255 {
            let detail = format!("the key must have 1 to 255 bytes, got {}", key.len());
            return Err(ApiError::new(Code::Unprocessable("bad_idempotency_key"), detail));
        }
        let mut hash = Sha256::new();
        for part in [caller.id.as_bytes().as_slice(), route.as_bytes(), key] {
            hash.update((part.len() as u64).to_le_bytes());
            hash.update(part);
        }
        let digest = hash.finalize();
        let mut bytes = [0; 16];
        bytes.copy_from_slice(&digest[..16]);
        Ok(Self { id: uuid::Builder::from_custom_bytes(bytes).into_uuid(), keyed: true })
    }
}

/// A key may not be used again for another request.
pub(crate) fn same_request(stored: &str, sent: &str) -> ApiResult<()> {
    if stored == sent {
        Ok(())
    } else {
        Err(ApiError::new(
            Code::Conflict("idempotency_key_reused"),
            "this Idempotency-Key was used for a different request",
        )
        .hint("take a fresh key for every new request"))
    }
}
