//! The socket: events of jobs, and localization streams.

mod connection;
mod drones;
mod flights;
mod leases;
mod topics;

use std::sync::Arc;

use axum::{
    extract::{State, WebSocketUpgrade, ws::rejection::WebSocketUpgradeRejection},
    http::{HeaderMap, header},
    response::Response,
};
use volery_api::ws::BEARER_PROTOCOL;

use crate::{
    auth::Viewer,
    error::{ApiError, ApiResult, Code},
    state::App,
};

/// Bytes of the header of a binary frame, at most.
const MAX_FRAME_HEADER: u64 = 64 << 10;

/// Opens a socket. Messages are JSON, frames of localization streams are binary; see
/// `ClientMessage`, `ServerMessage` and `FrameHeader`. Where headers cannot be set, the token goes
/// into the subprotocol `bearer.<token>`.
#[utoipa::path(get, path = "/v1/ws", tag = "socket",
    responses((status = 101, description = "The socket is open")))]
pub(crate) async fn open_socket(
    State(app): State<Arc<App>>,
    Viewer(caller): Viewer,
    headers: HeaderMap,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> ApiResult<Response> {
    let upgrade =
        upgrade.map_err(|rejection| ApiError::new(Code::UpgradeRequired, rejection.body_text()))?;
    let max_frame_bytes = app.config.limits.image_bytes + MAX_FRAME_HEADER;
    let protocols = headers
        .get_all(header::SEC_WEBSOCKET_PROTOCOL)
        .iter()
        .filter_map(|value| value.to_str().ok())
        .flat_map(|value| value.split(','))
        .map(str::trim)
        // A browser gives up when none of its protocols comes back.
        .filter(|protocol| *protocol == "volery" || protocol.starts_with(BEARER_PROTOCOL))
        .map(str::to_owned)
        .collect::<Vec<_>>();
    Ok(upgrade
        .protocols(protocols)
        .max_message_size(max_frame_bytes as usize)
        .max_frame_size(max_frame_bytes as usize)
        .on_upgrade(move |socket| connection::run(app, caller, socket, max_frame_bytes)))
}
