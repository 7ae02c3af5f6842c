//! Those who watch and those who ask.

use std::net::SocketAddr;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use futures_util::{SinkExt, StreamExt};
use tokio::time::{Instant, interval};
use tokio_tungstenite::tungstenite::{Message, client::IntoClientRequest, http::HeaderValue};

use super::http::Connection;

/// Requests per second of one connection.
const RATE_PER_CONNECTION: u32 = 25;

/// Times that many tasks have measured.
#[derive(Debug, Clone, Default)]
pub(crate) struct Times(Arc<Mutex<Vec<Duration>>>);

impl Times {
    /// Those since the last call.
    pub(crate) fn take(&self) -> Vec<Duration> {
        std::mem::take(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn add(&self, time: Duration) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(time);
    }
}

/// Watches the states of a drone: how old each is when it arrives.
pub(crate) async fn watch(
    server: SocketAddr,
    token: String,
    drone: u8,
    ages: Times,
) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
    let mut request = format!("ws://{server}/v1/ws").into_client_request()?;
    let bearer = HeaderValue::from_str(&format!("Bearer {token}"))?;
    request.headers_mut().insert("authorization", bearer);
    let (mut socket, _) = tokio_tungstenite::connect_async(request).await?;
    let subscribe = format!("{{\"type\":\"subscribe\",\"topic\":\"drone:{drone}\"}}");
    socket.send(Message::text(subscribe)).await?;
    while let Some(message) = socket.next().await {
        let Message::Text(text) = message? else { continue };
        if !text.contains("\"drone.state\"") {
            continue;
        }
        // The last one is the state's, before it that of the message.
        let made = text.rsplit("\"t_ns\":").next().unwrap_or_default();
        let made: String = made.chars().take_while(char::is_ascii_digit).collect();
        let now = SystemTime::now().duration_since(UNIX_EPOCH)?;
        ages.add(now.saturating_sub(Duration::from_nanos(made.parse()?)));
    }
    Err("the server has closed a socket".into())
}

/// Asks at a steady rate; a request that begins late because the one before took long counts from
/// when it should have begun.
pub(crate) async fn ask(
    server: SocketAddr,
    token: String,
    drone: u8,
    times: Times,
) -> std::io::Result<()> {
    let mut connection = Connection::open(server, &token).await?;
    let state = format!("/v1/drones/{drone}/state");
    let paths = [state.as_str(), "/v1/drones", "/v1/maps", "/v1/jobs", "/v1/info"];
    let mut clock = interval(Duration::from_secs(1) / RATE_PER_CONNECTION);
    for path in paths.iter().cycle() {
        let due = clock.tick().await;
        let (status, answer) = connection.ask("GET", path, "").await?;
        if status != 200 {
            return Err(std::io::Error::other(String::from_utf8_lossy(&answer).into_owned()));
        }
        times.add(Instant::now() - due);
    }
    Ok(())
}

/// Connections for so many requests per second.
pub(crate) fn connections(rate: u32) -> u32 {
    rate.div_ceil(RATE_PER_CONNECTION)
}
