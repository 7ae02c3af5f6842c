//! What is said of a frame.

use std::time::Duration;

use nalgebra::{Isometry3, Matrix6};

use crate::frame_check::FrameFault;

/// Whether the camera's place is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TrackState {
    /// This frame has a pose.
    Tracking,
    /// It has none; one was known or is about to be.
    Relocalizing,
    /// None has been found for a second.
    Lost,
}

impl TrackState {
    /// The stable code.
    pub fn code(self) -> &'static str {
        match self {
            Self::Tracking => "tracking",
            Self::Relocalizing => "relocalizing",
            Self::Lost => "lost",
        }
    }
}

/// What a pose rests on most.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PoseSource {
    /// Points of the map, followed from an earlier frame.
    Klt,
    /// Points of the map, recognized in this frame.
    Pnp,
    /// Some points, and how the camera moved before.
    Fused,
}

impl PoseSource {
    /// The stable code.
    pub fn code(self) -> &'static str {
        match self {
            Self::Klt => "klt",
            Self::Pnp => "pnp",
            Self::Fused => "fused",
        }
    }
}

/// Why a frame has no pose. The names are stable codes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TrackProblem {
    /// The frame itself: see its fault.
    Frame,
    /// Nothing of the map was recognized.
    NotFound,
    /// A place was found; others must confirm it.
    Unconfirmed,
    /// The whole map speaks for another place than the frames before.
    Contradicted,
}

impl TrackProblem {
    /// The stable code.
    pub fn code(self) -> &'static str {
        match self {
            Self::Frame => "bad_frame",
            Self::NotFound => "not_found",
            Self::Unconfirmed => "unconfirmed",
            Self::Contradicted => "contradicted",
        }
    }
}

/// The pose of a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackedPose {
    /// Camera in the map.
    pub map_from_camera: Isometry3<f64>,
    /// Order: position x, y, z in the map, then rotation about map x, y, z (rad).
    pub covariance: Matrix6<f64>,
    /// What it rests on.
    pub source: PoseSource,
    /// Points of the map that agree with it.
    pub num_points: usize,
    /// Over those that were looked for.
    pub inlier_ratio: f64,
    /// Root mean square, pixels.
    pub reprojection_px: f64,
}

/// Milliseconds per step.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TrackTimings {
    /// All that is not below: following of points, pose, filter.
    pub track_ms: f64,
    /// SIFT.
    pub features_ms: f64,
    /// Retrieval and matching.
    pub match_ms: f64,
    /// Poses by recognized features.
    pub solve_ms: f64,
}

impl TrackTimings {
    /// Of all steps.
    pub fn sum_ms(&self) -> f64 {
        self.track_ms + self.features_ms + self.match_ms + self.solve_ms
    }
}

/// The answer to one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackAnswer {
    /// Whether the place is known.
    pub state: TrackState,
    /// With [`TrackState::Tracking`] only, and then always: of this very frame.
    pub pose: Option<TrackedPose>,
    /// What is wrong with the frame, even if it has a pose.
    pub fault: Option<FrameFault>,
    /// Why there is no pose.
    pub problem: Option<TrackProblem>,
    /// Time since the last frame with a pose, this one included.
    pub since_pose: Option<Duration>,
    /// Counts places that were given up for others: what trusted the poses before must start anew.
    pub reset_counter: u32,
    /// Of the steps.
    pub timings: TrackTimings,
}
