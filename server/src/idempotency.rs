//! `Idempotency-Key`: the same key from the same caller names the same thing.
//!
//! The id of what is made follows from caller, route and key. So making it twice is a conflict on
//! its primary key, and no crash between two writes can make two of it. What leaves no row of its
//! own, as a command to a drone, is done once because its answer is remembered ([`once`]).

use std::{
    collections::{HashMap, VecDeque},
    sync::{Arc, Mutex, PoisonError},
};

use axum::{
    body::{Body, Bytes, to_bytes},
    extract::{FromRequest, FromRequestParts, Request, State},
    http::{HeaderMap, HeaderValue, Method, response},
    middleware::Next,
    response::{IntoResponse, Response},
};
use sha2::{Digest, Sha256};
use tokio::sync::Mutex as Turn;
use uuid::Uuid;

use crate::{
    auth::{Caller, Viewer},
    error::{ApiError, ApiResult, Code},
    extract::body_error,
    state::App,
    store::blobs::hex,
};

/// Name of the header, lower case.
pub(crate) const IDEMPOTENCY_KEY: &str = "idempotency-key";

/// Marks an answer that was given before, lower case.
const REPLAYED: &str = "idempotency-replayed";

/// Bytes of answers that are remembered: thousands of commands, or hundreds of flights.
const MAX_REMEMBERED_BYTES: usize = 16 << 20;

/// Bytes that an answer takes besides its body, about.
const ANSWER_BYTES: usize = 512;

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
        let digest = digest([caller.id.as_bytes(), route.as_bytes(), key]);
        let mut bytes = [0; 16];
        bytes.copy_from_slice(&digest[..16]);
        Ok(Self { id: uuid::Builder::from_custom_bytes(bytes).into_uuid(), keyed: true })
    }
}

/// Hash of parts, each with its length.
fn digest<const N: usize>(parts: [&[u8]; N]) -> [u8; 32] {
    let mut hash = Sha256::new();
    for part in parts {
        hash.update((part.len() as u64).to_le_bytes());
        hash.update(part);
    }
    hash.finalize().into()
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

/// The newest answers to requests that had a key, while the process lives.
#[derive(Debug, Default)]
pub(crate) struct Answers(Mutex<Remembered>);

/// What is known of one request. Who asks again waits for its turn until the first is answered.
type Slot = Arc<Turn<Option<Answer>>>;

#[derive(Debug, Default)]
struct Remembered {
    slots: HashMap<Uuid, Slot>,
    /// With their bytes, the oldest first.
    order: VecDeque<(Uuid, usize)>,
    num_bytes: usize,
}

#[derive(Debug)]
struct Answer {
    /// Hash of query and body.
    request: String,
    parts: response::Parts,
    body: Bytes,
}

impl Answers {
    fn slot(&self, id: Uuid) -> Slot {
        let mut remembered = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        Arc::clone(remembered.slots.entry(id).or_default())
    }

    /// A slot was filled: room is made by those that were filled longest ago.
    fn filled(&self, id: Uuid, num_bytes: usize) {
        let mut remembered = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        remembered.order.push_back((id, num_bytes));
        remembered.num_bytes += num_bytes;
        while remembered.num_bytes > MAX_REMEMBERED_BYTES {
            let Some((oldest, num_bytes)) = remembered.order.pop_front() else { return };
            remembered.num_bytes -= num_bytes;
            remembered.slots.remove(&oldest);
        }
    }

    /// A slot stayed empty: it goes unless somebody waits for it besides who has its turn.
    fn unfilled(&self, id: Uuid) {
        let mut remembered = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if remembered.slots.get(&id).is_some_and(|slot| Arc::strong_count(slot) <= 2) {
            remembered.slots.remove(&id);
        }
    }
}

impl Answer {
    fn num_bytes(&self) -> usize {
        self.body.len() + ANSWER_BYTES
    }

    fn again(&self) -> Response {
        let mut parts = self.parts.clone();
        parts.headers.insert(REPLAYED, HeaderValue::from_static("true"));
        Response::from_parts(parts, Body::from(self.body.clone()))
    }
}

/// Does what a POST with a key asks for once: sent again, it has the same answer. What was refused
/// did nothing, and is asked anew. A request with a key is carried out even if its sender leaves.
pub(crate) async fn once(State(app): State<Arc<App>>, request: Request, next: Next) -> Response {
    if request.method() != Method::POST || !request.headers().contains_key(IDEMPOTENCY_KEY) {
        return next.run(request).await;
    }
    keyed(app, request, next).await.unwrap_or_else(IntoResponse::into_response)
}

async fn keyed(app: Arc<App>, request: Request, next: Next) -> ApiResult<Response> {
    let (mut parts, body) = request.into_parts();
    let Viewer(caller) = Viewer::from_request_parts(&mut parts, &app).await?;
    let id = Identity::of(&caller, parts.uri.path(), &parts.headers)?.id;
    let request = Request::from_parts(parts.clone(), body);
    let body = Bytes::from_request(request, &app).await.map_err(body_error)?;
    let query = parts.uri.query().unwrap_or_default();
    let request = hex(&digest([query.as_bytes(), &body]));
    let mut turn = app.answers.slot(id).lock_owned().await;
    if let Some(answer) = &*turn {
        same_request(&answer.request, &request)?;
        return Ok(answer.again());
    }
    let carried_out = tokio::spawn({
        let app = Arc::clone(&app);
        async move {
            let response = next.run(Request::from_parts(parts, Body::from(body))).await;
            if !response.status().is_success() {
                app.answers.unfilled(id);
                return Ok(response);
            }
            let (parts, body) = response.into_parts();
            let body = to_bytes(body, usize::MAX).await.map_err(ApiError::internal)?;
            let answer = Answer { request, parts: parts.clone(), body: body.clone() };
            app.answers.filled(id, answer.num_bytes());
            *turn = Some(answer);
            Ok(Response::from_parts(parts, Body::from(body)))
        }
    });
    carried_out.await.unwrap_or_else(|panic| {
        app.answers.unfilled(id);
        Err(panic.into())
    })
}
