//! A localization stream: the newest frame wins. Where its frames come from and who hears the
//! answers is a matter of [`crate::ws`] and [`crate::sources`].

mod camera_clock;
mod tracking;

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

use crate::{
    error::{ApiError, ApiResult, Code},
    metrics::add,
    routes::{cameras::check_camera, localize::Query, localize_in},
    state::App,
    task::Task,
};
use tracking::track_frames;

/// Frames that may wait with [`StreamMode::All`].
const MAX_WAITING: usize = 8;

/// Longest id of a drone, bytes.
const MAX_DRONE_ID: usize = 64;

/// Hears what a stream says.
pub(crate) trait Listener: std::fmt::Debug + Send + Sync {
    /// Fails when there is nobody to hear it any more.
    fn tell(&self, body: ServerBody) -> Result<(), Gone>;
}

/// Who was to hear is too slow or gone.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Gone;

/// A stream that may be opened, for a map whose version is fixed.
#[derive(Debug, Clone)]
pub(crate) struct Permitted {
    open: StreamOpen,
    pub(crate) version: MapVersion,
    /// The drone whose estimator gets the poses.
    feeds: Option<u8>,
    /// The drone whose newest picture is shown to people.
    shows: Option<u8>,
}

/// Checks what is asked for against the role of who asks, the map and the service.
pub(crate) async fn permit(app: &App, role: Role, open: StreamOpen) -> ApiResult<Permitted> {
    open.camera.as_ref().map_or(Ok(()), check_camera)?;
    if open.drone_id.as_ref().is_some_and(|id| id.is_empty() || id.len() > MAX_DRONE_ID) {
        let detail = format!("a drone's id has 1 to {MAX_DRONE_ID} bytes");
        return Err(ApiError::new(Code::Unprocessable("bad_drone_id"), detail));
    }
    let version = app.store.version(open.map_id, open.version).await?;
    let feeds = if open.feed { Some(fed_drone(app, role, &open, &version)?) } else { None };
    // Who may not fly a drone does not say what it sees either.
    let drone = open.drone_id.as_deref().filter(|_| role >= Role::Pilot);
    let shows = drone.and_then(|id| id.parse().ok());
    Ok(Permitted { open, version, feeds, shows })
}

/// The drone that a stream is to feed: a wrong pose moves it.
fn fed_drone(app: &App, role: Role, open: &StreamOpen, version: &MapVersion) -> ApiResult<u8> {
    if role < Role::Pilot {
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
    id.map_or_else(|| Err(bad_system_id()), check_system_id)
}

/// A number that a drone may have.
pub(crate) fn check_system_id(id: u8) -> ApiResult<u8> {
    if (1..=254).contains(&id) { Ok(id) } else { Err(bad_system_id()) }
}

fn bad_system_id() -> ApiError {
    let code = Code::Unprocessable("bad_system_id");
    ApiError::new(code, "drones have MAVLink system ids from 1 to 254")
}

/// An open stream.
#[derive(Debug)]
pub(crate) struct Stream {
    shared: Arc<Shared>,
    _task: Task,
}

#[derive(Debug)]
struct Shared {
    app: Arc<App>,
    listener: Box<dyn Listener>,
    stream: Permitted,
    waiting: Mutex<VecDeque<Frame>>,
    arrived: Notify,
}

#[derive(Debug)]
struct Frame {
    header: FrameHeader,
    payload: Bytes,
    arrived: Instant,
}

impl Stream {
    /// Works on frames until it is dropped, or until nobody hears it.
    pub(crate) fn start(app: &Arc<App>, stream: Permitted, listener: Box<dyn Listener>) -> Self {
        let is_tracked = stream.open.track;
        let shared = Arc::new(Shared {
            app: Arc::clone(app),
            listener,
            stream,
            waiting: Mutex::default(),
            arrived: Notify::new(),
        });
        let task = if is_tracked {
            tokio::spawn(track_frames(Arc::clone(&shared)))
        } else {
            tokio::spawn(answer_frames(Arc::clone(&shared)))
        };
        Self { shared, _task: Task(task) }
    }

    /// What the opener of a stream is told.
    pub(crate) fn opened(&self, stream_id: u32) -> ServerBody {
        let Permitted { open, version, .. } = &self.shared.stream;
        ServerBody::StreamOpened {
            stream_id,
            map_id: version.map_id,
            map_version: version.version,
            credit: match open.mode {
                StreamMode::Latest => 1,
                StreamMode::All => MAX_WAITING as u32,
            },
        }
    }

    /// Takes a frame; tells which one it pushed out.
    pub(crate) fn push(
        &self,
        header: FrameHeader,
        payload: Bytes,
        arrived: Instant,
    ) -> Result<(), Gone> {
        let frame = Frame { header, payload, arrived };
        if let Some(drone) = self.shared.stream.shows {
            self.shared.app.pictures.put(drone, &frame.payload, frame.arrived);
        }
        let dropped = {
            let mut waiting = self.shared.waiting.lock().unwrap_or_else(PoisonError::into_inner);
            match self.shared.stream.open.mode {
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
    fn is_empty(&self) -> bool {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner).is_empty()
    }

    /// The frame that waits longest.
    fn pop(&self) -> Option<Frame> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner).pop_front()
    }

    fn drop_frame(
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
        self.listener.tell(body)
    }
}

async fn answer_frames(shared: Arc<Shared>) {
    loop {
        let next = shared.pop();
        let Some(Frame { header, payload, arrived }) = next else {
            shared.arrived.notified().await;
            continue;
        };
        let query = Query {
            image: payload,
            camera: shared.stream.open.camera.clone(),
            prior: header.prior,
            // Frames come faster than views can be drawn.
            method: LocalizeMethod::Pnp,
            encoding: header.encoding,
            width: header.width,
            height: header.height,
        };
        let sent = match localize_in(&shared.app, &shared.stream.version, query, arrived).await {
            Ok(answer) => shared.listener.tell(ServerBody::FrameResult {
                stream_id: header.stream_id,
                seq: header.seq,
                t_capture_ns: header.t_capture_ns,
                result: Box::new(answer),
            }),
            Err(error) => {
                let reason = reason_of(&error);
                shared.drop_frame(&header, reason, Some(error.detail))
            }
        };
        if sent.is_err() {
            // Its owner finds out by itself.
            return;
        }
    }
}

fn reason_of(error: &ApiError) -> &'static str {
    match &error.code {
        Code::TooLarge => "too_large",
        Code::Refused(code) if code == "too_large" => "too_large",
        Code::Refused(_) | Code::Unprocessable(_) => "decode_error",
        _ => "overload",
    }
}
