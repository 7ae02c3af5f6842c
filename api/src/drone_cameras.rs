//! Cameras of drones that the service pulls.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use crate::Camera;

/// A drone's camera to be pulled: motion JPEG over HTTP (`multipart/x-mixed-replace`).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PutDroneCamera {
    /// Plain `http`, without user and password; the host must be one that the service may pull from
    /// (`volery serve --camera-host`).
    #[schema(max_length = 2000)]
    pub url: String,
    /// Where to look.
    pub map_id: Uuid,
    /// The one that is active at the start when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub version: Option<u32>,
    /// Intrinsics of the pictures; the map's own camera of their size when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<Camera>,
    /// Send the poses to the estimator of the drone. Needs a metric map.
    #[serde(default)]
    pub feed: bool,
}

/// A camera that is pulled, and how that goes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DroneCamera {
    /// As they were put.
    pub settings: PutDroneCamera,
    /// The version that answers; `null` when the camera cannot be pulled.
    pub map_version: Option<u32>,
    /// How it goes now.
    pub state: DroneCameraState,
    /// Pictures that came, since the camera was put or the service started.
    pub frames: u64,
    /// Of them, those without an answer: a newer one came first, or they could not be read.
    pub dropped: u64,
    /// Pictures per second, of the last few seconds.
    pub rate_hz: f64,
    /// Since the last picture began to come, milliseconds.
    pub last_frame_age_ms: Option<f64>,
    /// What went wrong last, however long ago.
    pub last_error: Option<DroneCameraError>,
}

/// How the pulling of a camera goes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum DroneCameraState {
    /// No picture yet, and nothing went wrong.
    #[default]
    Connecting,
    /// Pictures come.
    Streaming,
    /// The last try failed; it is tried again, but for settings that cannot be.
    Failed,
}

/// What went wrong with a camera.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct DroneCameraError {
    /// Stable.
    pub code: String,
    /// For people.
    pub detail: String,
}
