//! Requests with token, retries and problems as errors.

use std::time::Duration;

use bytes::Bytes;
use futures_util::future::BoxFuture;
use reqwest::{Method, RequestBuilder, StatusCode, header};
use serde::{Serialize, de::DeserializeOwned};
use volery_api::{Page, Problem};

use crate::ClientError;

/// Longest time to open a connection.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(5);

/// Waits before the second, third, ... try of a call that may be repeated.
const RETRY_WAITS: [Duration; 4] = [
    Duration::from_millis(100),
    Duration::from_millis(400),
    Duration::from_millis(1500),
    Duration::from_secs(4),
];

/// A server and a token.
#[derive(Debug, Clone)]
pub struct Client {
    pub(crate) base: String,
    pub(crate) token: Option<String>,
    http: reqwest::Client,
}

impl Client {
    /// `server` is `http://HOST:PORT`; without token only what the server gives to all.
    pub fn new(server: &str, token: Option<&str>) -> Result<Self, ClientError> {
        let base = server.trim_end_matches('/').to_owned();
        if !base.starts_with("http://") {
            return Err(ClientError::BadArgument(format!(
                "server {server:?}: expected http://HOST:PORT"
            )));
        }
        let is_odd = |token: &str| !token.bytes().all(|b| b.is_ascii_graphic());
        if token.is_some_and(is_odd) {
            return Err(ClientError::BadArgument("the token holds odd characters".to_owned()));
        }
        let http = reqwest::Client::builder().connect_timeout(CONNECT_TIMEOUT).build()?;
        Ok(Self { base, token: token.map(str::to_owned), http })
    }

    pub(crate) fn request(&self, method: Method, path: &str) -> RequestBuilder {
        let request = self.http.request(method, format!("{}{path}", self.base));
        match &self.token {
            Some(token) => request.bearer_auth(token),
            None => request,
        }
    }

    /// The answer to a request that may arrive twice: sent again when the trouble may pass.
    ///
    /// Boxed, as [`Self::send_once`], so that it is compiled here and not with every caller.
    pub(crate) fn send(
        &self,
        request: RequestBuilder,
    ) -> BoxFuture<'static, Result<Bytes, ClientError>> {
        Box::pin(async move {
            for wait in RETRY_WAITS {
                let Some(copy) = request.try_clone() else { break };
                match answer(copy).await {
                    Err(error) if error.is_passing() => tokio::time::sleep(wait).await,
                    other => return other,
                }
            }
            answer(request).await
        })
    }

    /// The answer to a request that may not arrive twice.
    pub(crate) fn send_once(
        &self,
        request: RequestBuilder,
    ) -> BoxFuture<'static, Result<Bytes, ClientError>> {
        Box::pin(answer(request))
    }

    pub(crate) async fn get<T: DeserializeOwned>(&self, path: &str) -> Result<T, ClientError> {
        parsed(&self.send(self.request(Method::GET, path)).await?)
    }

    /// A call with a body that may be repeated: the key makes the server do it once.
    pub(crate) async fn call<B: Serialize, T: DeserializeOwned>(
        &self,
        method: Method,
        path: &str,
        body: &B,
    ) -> Result<T, ClientError> {
        let key = uuid::Uuid::now_v7().to_string();
        let request = self.request(method, path).json(body).header("Idempotency-Key", key);
        parsed(&self.send(request).await?)
    }

    pub(crate) async fn delete(&self, path: &str) -> Result<(), ClientError> {
        self.send(self.request(Method::DELETE, path)).await.map(drop)
    }

    /// All items of a paged list.
    pub(crate) async fn list<T: DeserializeOwned>(
        &self,
        path: &str,
    ) -> Result<Vec<T>, ClientError> {
        let mut items = Vec::new();
        let mut cursor: Option<String> = None;
        loop {
            let separator = if path.contains('?') { '&' } else { '?' };
            let from = cursor.map_or(String::new(), |cursor| format!("&cursor={cursor}"));
            let page: Page<T> = self.get(&format!("{path}{separator}limit=1000{from}")).await?;
            items.extend(page.items);
            cursor = page.next_cursor;
            if cursor.is_none() {
                return Ok(items);
            }
        }
    }
}

/// The body of an answer as JSON.
pub(crate) fn parsed<T: DeserializeOwned>(body: &[u8]) -> Result<T, ClientError> {
    serde_json::from_slice(body).map_err(|error| ClientError::Protocol(error.to_string()))
}

/// The body of the answer; one of the 4xx and 5xx kind is an error.
async fn answer(request: RequestBuilder) -> Result<Bytes, ClientError> {
    let answer = request.send().await?;
    let status = answer.status();
    if status.is_success() || status == StatusCode::NOT_MODIFIED {
        return Ok(answer.bytes().await?);
    }
    let is_problem = answer
        .headers()
        .get(header::CONTENT_TYPE)
        .is_some_and(|t| t.as_bytes().starts_with(volery_api::PROBLEM_JSON.as_bytes()));
    let text = answer.text().await?;
    match serde_json::from_str::<Problem>(&text) {
        Ok(problem) if is_problem => Err(ClientError::Problem(Box::new(problem))),
        _ => Err(ClientError::Protocol(format!(
            "HTTP {status}: {}",
            text.chars().take(200).collect::<String>()
        ))),
    }
}
