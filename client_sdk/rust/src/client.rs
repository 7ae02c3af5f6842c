//! Requests with token, retries and problems as errors.

use std::time::Duration;

use reqwest::{Method, RequestBuilder, Response, StatusCode, header};
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

    /// Sends, repeating when the trouble may pass. `make` is called for every try; only requests
    /// that may arrive twice come here.
    pub(crate) async fn send(
        &self,
        make: impl Fn() -> RequestBuilder,
    ) -> Result<Response, ClientError> {
        let mut waits = RETRY_WAITS.iter();
        loop {
            match checked(make().send().await).await {
                Err(error) if error.is_passing() => match waits.next() {
                    Some(wait) => tokio::time::sleep(*wait).await,
                    None => return Err(error),
                },
                other => return other,
            }
        }
    }

    /// Sends what cannot be sent twice.
    pub(crate) async fn send_once(&self, request: RequestBuilder) -> Result<Response, ClientError> {
        checked(request.send().await).await
    }

    pub(crate) async fn get<T: DeserializeOwned>(&self, path: &str) -> Result<T, ClientError> {
        Ok(self.send(|| self.request(Method::GET, path)).await?.json().await?)
    }

    /// A call with a body that may be repeated: the key makes the server do it once.
    pub(crate) async fn call<B: Serialize, T: DeserializeOwned>(
        &self,
        method: Method,
        path: &str,
        body: &B,
    ) -> Result<T, ClientError> {
        let key = uuid::Uuid::now_v7().to_string();
        let make = || {
            let request = self.request(method.clone(), path).json(body);
            request.header("Idempotency-Key", &key)
        };
        Ok(self.send(make).await?.json().await?)
    }

    pub(crate) async fn delete(&self, path: &str) -> Result<(), ClientError> {
        self.send(|| self.request(Method::DELETE, path)).await.map(drop)
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

/// An answer of the 4xx and 5xx kind as an error.
async fn checked(answer: Result<Response, reqwest::Error>) -> Result<Response, ClientError> {
    let answer = answer?;
    let status = answer.status();
    if status.is_success() || status == StatusCode::NOT_MODIFIED {
        return Ok(answer);
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
