//! Poses of a stream that is followed from frame to frame.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::CameraPose;

/// What a drone reports of itself when a frame is taken; camera along the nose.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct FrameTelemetry {
    /// Radians clockwise from the compass's north. How north lies in the map is found out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub heading: Option<f64>,
    /// Standard deviation of the heading, radians; 0.035 when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub heading_sigma: Option<f64>,
    /// Above any fixed level, m. How the level lies in the map is found out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height: Option<f64>,
    /// Standard deviation of the height, m; 0.05 when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height_sigma: Option<f64>,
    /// East, north and up, m/s; used once the heading is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub velocity: Option<[f64; 3]>,
    /// Standard deviation of the velocity per axis, m/s; 0.1 when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub velocity_sigma: Option<f64>,
}

/// Whether the camera's place is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum TrackState {
    /// This frame has a pose.
    Tracking,
    /// It has none; one was known or is about to be.
    Relocalizing,
    /// None has been found for a second.
    Lost,
}

/// What a pose rests on most.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum TrackSource {
    /// Points of the map, followed from an earlier frame.
    Klt,
    /// Points of the map, recognized in this frame.
    Pnp,
    /// Some points, and how the camera moved before.
    Fused,
}

/// Milliseconds per step; they add up to `total_ms`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TrackLatency {
    /// From the arrival of the frame until work on it began, and back: all that is not below.
    pub recv_ms: f64,
    /// Bytes to pixels.
    pub decode_ms: f64,
    /// Points followed, pose, filter.
    pub track_ms: f64,
    /// Keypoints and descriptors, where they were needed.
    pub features_ms: f64,
    /// Retrieval and matching, where they were needed.
    pub match_ms: f64,
    /// Poses by recognized features, where they were needed.
    pub solve_ms: f64,
    /// From the arrival of the frame to the answer.
    pub total_ms: f64,
}

/// The answer to one frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TrackedFrame {
    /// Whether the place is known.
    pub state: TrackState,
    /// `map_from_camera` of this very frame; with `tracking` only, and then always.
    pub pose: Option<CameraPose>,
    /// 6 x 6, row-major: position x, y, z in the map (m), then rotation about map x, y, z (rad).
    pub covariance: Option<Vec<f64>>,
    /// What the pose rests on.
    pub source: Option<TrackSource>,
    /// Milliseconds since the frame arrived.
    pub age_ms: f64,
    /// Why there is no pose: `bad_frame`, `not_found`, `unconfirmed`, `contradicted`.
    pub reason: Option<String>,
    /// What is wrong with the frame, even if it has a pose: `frozen`, `out_of_order`, `wrong_size`,
    /// `no_contrast`, `dark`, `blurred`.
    pub fault: Option<String>,
    /// Milliseconds from the last frame with a pose to this one, by their capture times.
    pub since_pose_ms: Option<f64>,
    /// Points of the map that agree with the pose.
    pub num_points: u32,
    /// Over those that were looked for.
    pub inlier_ratio: Option<f64>,
    /// Root mean square reprojection error, pixels.
    pub reprojection_px: Option<f64>,
    /// Counts places that were given up for others: what trusted the poses before must start anew.
    pub reset_counter: u32,
    /// Milliseconds per step.
    pub latency: TrackLatency,
}
