//! The poses of a moving camera in a map, frame by frame.
//!
//! Points of the map that a localization recognized in one frame are looked for in the next ones,
//! around where a filter expects them; the pose follows from where they are. Now and then, and
//! whenever too few are left, features are compared with the map anew. What has no proof in the
//! frame itself is no pose.

pub mod frame_check;
pub mod motion;
pub mod tracker;

mod follow;
mod klt;
mod pyramid;
mod relocation;
mod simd;

pub use frame_check::FrameFault;
pub use motion::{MotionLimits, Telemetry};
pub use tracker::{
    Frame, PoseSource, TrackAnswer, TrackProblem, TrackState, TrackTimings, TrackedPose, Tracker,
    TrackerOptions,
};
