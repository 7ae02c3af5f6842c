//! Messages of the WebSocket `/v1/ws`.
//!
//! Text frames are JSON. Every message of the client may carry an `id`, which the answer repeats
//! as `re`. Binary frames are `magic u16 = 0x5956 | version u8 = 1 | kind u8 | header_len u32`, all
//! little-endian, then a JSON header, then the payload.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use crate::{
    Camera, CreateLease, DroneAlert, DroneCommandStatus, DroneState, FlightNews, FrameTelemetry,
    ImageEncoding, JobEvent, Lease, LocalizeAnswer, LocalizePrior, TrackedFrame,
};

/// First two bytes of a binary frame: `VY`.
pub const FRAME_MAGIC: u16 = 0x5956;

/// Version of the binary frame.
pub const FRAME_VERSION: u8 = 1;

/// Kind of a binary frame that asks for the pose of an image.
pub const FRAME_IMAGE_QUERY: u8 = 1;

/// Bytes before the header of a binary frame.
pub const FRAME_PREFIX: usize = 8;

/// Prefix of the subprotocol that carries a token.
pub const BEARER_PROTOCOL: &str = "bearer.";

/// From the client.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ClientMessage {
    /// Made by the client.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub id: Option<String>,
    /// What it wants.
    #[serde(flatten)]
    pub body: ClientBody,
}

/// What a client may want.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "type", deny_unknown_fields)]
pub enum ClientBody {
    /// Events of a topic.
    #[serde(rename = "subscribe")]
    Subscribe {
        /// `jobs`, `job:<id>`; `pose:<drone>`; `drone:<drone>`, its states ten times a second and
        /// how its commands go; `flights`, `flight:<id>`; `alerts`. `*` in place of a drone means
        /// all.
        topic: String,
        /// Events of the job with greater numbers only, past ones too; without it, from now on.
        #[serde(default)]
        after: Option<u64>,
    },
    /// No more events of a topic.
    #[serde(rename = "unsubscribe")]
    Unsubscribe {
        /// As subscribed.
        topic: String,
    },
    /// Opens a localization stream.
    #[serde(rename = "stream.open")]
    StreamOpen(StreamOpen),
    /// Closes a localization stream.
    #[serde(rename = "stream.close")]
    StreamClose {
        /// As opened.
        stream_id: u32,
    },
    /// Takes drones, as `POST /v1/leases` does. The lease is over when the socket is, too: its drones
    /// hold at once.
    #[serde(rename = "lease")]
    Lease(CreateLease),
    /// Renews a lease.
    #[serde(rename = "lease.renew")]
    LeaseRenew {
        /// Which one.
        lease_id: Uuid,
    },
    /// Gives a lease back: its drones hold.
    #[serde(rename = "lease.release")]
    LeaseRelease {
        /// Which one.
        lease_id: Uuid,
    },
    /// Asks for a `pong`.
    #[serde(rename = "ping")]
    Ping {},
}

/// A localization stream to open.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct StreamOpen {
    /// Where to look.
    pub map_id: Uuid,
    /// The active one when absent; it stays the same for the life of the stream.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub version: Option<u32>,
    /// Intrinsics of all frames.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<Camera>,
    /// What to do with frames that come faster than answers.
    #[serde(default)]
    pub mode: StreamMode,
    /// Follow the camera from frame to frame: frames are answered with `frame.tracked`. All of them
    /// must be of one size and have rising capture times.
    #[serde(default)]
    pub track: bool,
    /// The drone whose camera this is; with `track`, its poses are the drone's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub drone_id: Option<String>,
    /// Send the poses to the estimator of the drone, whose MAVLink system id `drone_id` then is.
    /// Needs `track`, a metric map and the role `pilot`.
    #[serde(default)]
    pub feed: bool,
}

/// What to do with frames that come faster than answers.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum StreamMode {
    /// One frame waits; a newer one takes its place.
    #[default]
    Latest,
    /// A few frames wait; what comes beyond them is dropped.
    All,
}

/// Header of a binary frame of kind 1.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct FrameHeader {
    /// As opened.
    pub stream_id: u32,
    /// Made by the client, rising.
    pub seq: u64,
    /// When it was taken, nanoseconds of the client's clock.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub t_capture_ns: Option<u64>,
    /// How the payload is coded.
    #[serde(default)]
    pub encoding: ImageEncoding,
    /// Pixels; needed for raw encodings.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub width: Option<u32>,
    /// Pixels; needed for raw encodings.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height: Option<u32>,
    /// What is known of the pose; not used by streams that track.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prior: Option<LocalizePrior>,
    /// What the drone reports of itself; used by streams that track.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub telemetry: Option<FrameTelemetry>,
}

/// From the server.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ServerMessage {
    /// `id` of the message it answers.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub re: Option<String>,
    /// The server's time, nanoseconds since the Unix epoch.
    pub t_ns: u64,
    /// What it says.
    #[serde(flatten)]
    pub body: ServerBody,
}

/// What the server may say.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "type")]
pub enum ServerBody {
    /// First message of a connection.
    #[serde(rename = "hello")]
    Hello {
        /// Of the server's software.
        version: String,
        /// For logs.
        conn_id: Uuid,
        /// Seconds between pings.
        ping_s: u64,
        /// Bytes of the largest frame taken.
        max_frame_bytes: u64,
    },
    /// Events will follow.
    #[serde(rename = "subscribed")]
    Subscribed {
        /// As asked.
        topic: String,
    },
    /// Events will not follow.
    #[serde(rename = "unsubscribed")]
    Unsubscribed {
        /// As asked.
        topic: String,
    },
    /// Something happened.
    #[serde(rename = "event")]
    Event {
        /// As subscribed.
        topic: String,
        /// Which job.
        job_id: Uuid,
        /// The event, numbered within the job.
        event: JobEvent,
    },
    /// Something happened in a flight.
    #[serde(rename = "flight.state")]
    FlightState {
        /// As subscribed.
        topic: String,
        /// Which flight.
        flight_id: Uuid,
        /// The event.
        event: FlightNews,
    },
    /// What a drone says, ten times a second; of several that wait, the newest.
    #[serde(rename = "drone.state")]
    DroneState {
        /// As subscribed.
        topic: String,
        /// As REST answers it.
        state: Box<DroneState>,
    },
    /// A command went on.
    #[serde(rename = "command.state")]
    CommandState {
        /// As subscribed.
        topic: String,
        /// As REST answers it.
        command: DroneCommandStatus,
    },
    /// Somebody should look.
    #[serde(rename = "alert")]
    Alert {
        /// As subscribed.
        topic: String,
        /// At what.
        alert: DroneAlert,
    },
    /// Events were lost: read them again by `after`.
    #[serde(rename = "resync")]
    Resync {
        /// As subscribed.
        topic: String,
    },
    /// Frames may be sent.
    #[serde(rename = "stream.opened")]
    StreamOpened {
        /// For the headers of the frames.
        stream_id: u32,
        /// The map.
        map_id: Uuid,
        /// Its version.
        map_version: u32,
        /// Frames that may wait.
        credit: u32,
    },
    /// No more frames.
    #[serde(rename = "stream.closed")]
    StreamClosed {
        /// As opened.
        stream_id: u32,
    },
    /// The pose of a frame.
    #[serde(rename = "frame.result")]
    FrameResult {
        /// As opened.
        stream_id: u32,
        /// Of the frame.
        seq: u64,
        /// Of the frame.
        t_capture_ns: Option<u64>,
        /// As REST answers it.
        result: Box<LocalizeAnswer>,
    },
    /// The pose of a frame of a stream that tracks.
    #[serde(rename = "frame.tracked")]
    FrameTracked {
        /// As opened.
        stream_id: u32,
        /// Of the frame.
        seq: u64,
        /// Of the frame.
        t_capture_ns: Option<u64>,
        /// The map.
        map_id: Uuid,
        /// Its version.
        map_version: u32,
        /// State, pose and latency.
        result: Box<TrackedFrame>,
    },
    /// What a frame of a drone's camera says about its place.
    #[serde(rename = "pose")]
    Pose {
        /// Of the stream that the frame came by.
        drone_id: String,
        /// The map.
        map_id: Uuid,
        /// Its version.
        map_version: u32,
        /// Of the frame.
        frame_seq: u64,
        /// State, pose of the camera and latency; `age_ms` since the frame was taken.
        result: Box<TrackedFrame>,
    },
    /// A frame without an answer.
    #[serde(rename = "frame.dropped")]
    FrameDropped {
        /// As opened.
        stream_id: u32,
        /// Of the frame.
        seq: u64,
        /// `superseded`, `too_large`, `decode_error`, `overload`.
        reason: String,
        /// For people.
        detail: Option<String>,
    },
    /// Drones are leased: answer to `lease` and `lease.renew`.
    #[serde(rename = "leased")]
    Leased {
        /// As REST answers it.
        lease: Lease,
    },
    /// A lease is over, as asked.
    #[serde(rename = "lease.released")]
    LeaseReleased {
        /// Which one.
        lease_id: Uuid,
    },
    /// Answer to `ping`.
    #[serde(rename = "pong")]
    Pong {},
    /// A message that could not be done.
    #[serde(rename = "error")]
    Error {
        /// Stable.
        code: String,
        /// For people.
        detail: String,
    },
}

/// Splits a binary frame into kind, header and payload; `None` when it is not one.
pub fn split_frame(frame: &[u8]) -> Option<(u8, &[u8], &[u8])> {
    let (prefix, rest) = frame.split_at_checked(FRAME_PREFIX)?;
    let magic = u16::from_le_bytes([prefix[0], prefix[1]]);
    let header_len = u32::from_le_bytes([prefix[4], prefix[5], prefix[6], prefix[7]]) as usize;
    if magic != FRAME_MAGIC || prefix[2] != FRAME_VERSION {
        return None;
    }
    let (header, payload) = rest.split_at_checked(header_len)?;
    Some((prefix[3], header, payload))
}

/// A binary frame from its parts.
pub fn join_frame(kind: u8, header: &[u8], payload: &[u8]) -> Vec<u8> {
    let mut frame = Vec::with_capacity(FRAME_PREFIX + header.len() + payload.len());
    frame.extend_from_slice(&FRAME_MAGIC.to_le_bytes());
    frame.extend_from_slice(&[FRAME_VERSION, kind]);
    frame.extend_from_slice(&(header.len() as u32).to_le_bytes());
    frame.extend_from_slice(header);
    frame.extend_from_slice(payload);
    frame
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_survive_join_and_split() {
        let frame = join_frame(FRAME_IMAGE_QUERY, b"{}", b"pixels");
        assert_eq!(split_frame(&frame), Some((1, &b"{}"[..], &b"pixels"[..])));
    }

    #[test]
    fn no_cut_of_a_header_is_a_frame() {
        let frame = join_frame(FRAME_IMAGE_QUERY, b"{\"seq\":1}", b"");
        for len in 0..frame.len() {
            assert_eq!(split_frame(&frame[..len]), None, "{len} bytes");
        }
    }
}
