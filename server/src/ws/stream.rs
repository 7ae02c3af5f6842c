//! A localization stream: the newest frame wins.

use std::{
    collections::VecDeque,
    sync::{Arc, Mutex, PoisonError},
    time::Instant,
};

use bytes::Bytes;
use tokio::sync::Notify;
use volery_api::{
    LocalizeMethod, MapVersion, Role,
    ws::{FrameHeader, ServerBody, StreamMode, StreamOpen},
};

use super::{
    connection::{Gone, Outbox, Task},
    tracking::track_frames,
};
use crate::{
    auth::Caller,
    error::{ApiError, ApiResult, Code},
    metrics::add,
    routes::{cameras::check_camera, localize::Query, localize_in},
    state::App,
};

/// Frames that may wait with [`StreamMode::All`].
const MAX_WAITING: usize = 8;

/// Longest id of a drone, bytes.
const MAX_DRONE_ID: usize = 64;

/// The drone that a stream is to feed: a wrong pose moves it.
fn fed_drone(app: &App, caller: &Caller, open: &StreamOpen, version: &MapVersion) -> ApiResult<u8> {
    if caller.role < Role::Pilot {
        return Err(ApiError::new(Code::Forbidden, "only a pilot feeds a drone with poses"));
    }
    app.drones()?;
    if !open.track {
        let code = Code::Unprocessable("not_tracked");
        return Err(ApiError::new(code, "only a stream with track feeds a drone"));
    }
    if version.info["scale"]["metric"].as_bool() != Some(true) {
        let code = Code::Conflict("map_not_metric");
        return Err(ApiError::new(code, "the map has no metric scale")
            .hint("POST /v1/maps/{id}/align with a known distance"));
    }
    let id = open.drone_id.as_deref().and_then(|id| id.parse().ok());
    id.filter(|id| (1..=254).contains(id)).ok_or_else(|| {
        let code = Code::Unprocessable("bad_system_id");
        ApiError::new(code, "drone_id must be a MAVLink system id from 1 to 254")
    })
}

/// An open stream.
#[derive(Debug)]
pub(super) struct Stream {
    shared: Arc<Shared>,
    _task: Task,
}

#[derive(Debug)]
pub(super) struct Shared {
    pub(super) app: Arc<App>,
    pub(super) outbox: Outbox,
    pub(super) open: StreamOpen,
    /// The drone whose estimator gets the poses.
    pub(super) feeds: Option<u8>,
    /// The drone whose newest picture is shown to people.
    shows: Option<u8>,
    waiting: Mutex<VecDeque<Frame>>,
    pub(super) arrived: Notify,
}

#[derive(Debug)]
pub(super) struct Frame {
    pub(super) header: FrameHeader,
    pub(super) payload: Bytes,
    pub(super) arrived: Instant,
}

impl Stream {
    /// Fixes the version of the map for the life of the stream.
    pub(super) async fn open(
        app: &Arc<App>,
        caller: &Caller,
        outbox: Outbox,
        stream_id: u32,
        open: StreamOpen,
    ) -> ApiResult<(Self, ServerBody)> {
        open.camera.as_ref().map_or(Ok(()), check_camera)?;
        if open.drone_id.as_ref().is_some_and(|id| id.is_empty() || id.len() > MAX_DRONE_ID) {
            let detail = format!("a drone's id has 1 to {MAX_DRONE_ID} bytes");
            return Err(ApiError::new(Code::Unprocessable("bad_drone_id"), detail));
        }
        let version = app.store.version(open.map_id, open.version).await?;
        let feeds = if open.feed { Some(fed_drone(app, caller, &open, &version)?) } else { None };
        let opened = ServerBody::StreamOpened {
            stream_id,
            map_id: version.map_id,
            map_version: version.version,
            credit: match open.mode {
                StreamMode::Latest => 1,
                StreamMode::All => MAX_WAITING as u32,
            },
        };
        // Who may not fly a drone does not say what it sees either.
        let drone = open.drone_id.as_deref().filter(|_| caller.role >= Role::Pilot);
        let shared = Arc::new(Shared {
            app: Arc::clone(app),
            outbox,
            shows: drone.and_then(|id| id.parse().ok()),
            open,
            feeds,
            waiting: Mutex::default(),
            arrived: Notify::new(),
        });
        let task = if shared.open.track {
            tokio::spawn(track_frames(Arc::clone(&shared), version))
        } else {
            tokio::spawn(answer_frames(Arc::clone(&shared), version))
        };
        let task = Task(task);
        Ok((Self { shared, _task: task }, opened))
    }

    /// Takes a frame; tells which one it pushed out.
    pub(super) fn push(&self, header: FrameHeader, payload: Bytes) -> Result<(), Gone> {
        let frame = Frame { header, payload, arrived: Instant::now() };
        if let Some(drone) = self.shared.shows {
            self.shared.app.pictures.put(drone, &frame.payload, frame.arrived);
        }
        let dropped = {
            let mut waiting = self.shared.waiting.lock().unwrap_or_else(PoisonError::into_inner);
            match self.shared.open.mode {
                StreamMode::Latest => {
                    let old = waiting.pop_front().map(|old| (old, "superseded"));
                    waiting.push_back(frame);
                    old
                }
                StreamMode::All if waiting.len() >= MAX_WAITING => Some((frame, "overload")),
                StreamMode::All => {
                    waiting.push_back(frame);
                    None
                }
            }
        };
        self.shared.arrived.notify_one();
        dropped
            .map_or(Ok(()), |(frame, reason)| self.shared.drop_frame(&frame.header, reason, None))
    }
}

impl Shared {
    pub(super) fn is_empty(&self) -> bool {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner).is_empty()
    }

    /// The frame that waits longest.
    pub(super) fn pop(&self) -> Option<Frame> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner).pop_front()
    }

    pub(super) fn drop_frame(
        &self,
        header: &FrameHeader,
        reason: &str,
        detail: Option<String>,
    ) -> Result<(), Gone> {
        add(&self.app.metrics.frames_dropped, 1);
        let body = ServerBody::FrameDropped {
            stream_id: header.stream_id,
            seq: header.seq,
            reason: reason.to_owned(),
            detail,
        };
        self.outbox.send(None, body)
    }
}

async fn answer_frames(shared: Arc<Shared>, version: MapVersion) {
    loop {
        let next = shared.pop();
        let Some(Frame { header, payload, arrived }) = next else {
            shared.arrived.notified().await;
            continue;
        };
        let query = Query {
            image: payload,
            camera: shared.open.camera.clone(),
            prior: header.prior,
            // Frames come faster than views can be drawn.
            method: LocalizeMethod::Pnp,
            encoding: header.encoding,
            width: header.width,
            height: header.height,
        };
        let sent = match localize_in(&shared.app, &version, query, arrived).await {
            Ok(answer) => shared.outbox.send(
                None,
                ServerBody::FrameResult {
                    stream_id: header.stream_id,
                    seq: header.seq,
                    t_capture_ns: header.t_capture_ns,
                    result: Box::new(answer),
                },
            ),
            Err(error) => {
                let reason = reason_of(&error);
                shared.drop_frame(&header, reason, Some(error.detail))
            }
        };
        if sent.is_err() {
            // The connection finds its outbox full at its next message.
            return;
        }
    }
}

pub(super) fn reason_of(error: &ApiError) -> &'static str {
    match &error.code {
        Code::TooLarge => "too_large",
        Code::Refused(code) if code == "too_large" => "too_large",
        Code::Refused(_) | Code::Unprocessable(_) => "decode_error",
        _ => "overload",
    }
}
