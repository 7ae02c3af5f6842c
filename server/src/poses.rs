//! Poses of drones by the frames of their cameras, to whoever wants them.

use std::{sync::Arc, time::Instant};

use tokio::sync::broadcast;
use uuid::Uuid;
use volery_api::TrackedFrame;

/// Poses that a slow listener may be behind; older ones are of no use.
const KEPT: usize = 64;

/// What a frame of a drone's camera says about its place.
#[derive(Debug)]
pub(crate) struct CameraFix {
    /// As the stream was opened.
    pub(crate) drone_id: String,
    pub(crate) map_id: Uuid,
    pub(crate) map_version: u32,
    /// Of the frame.
    pub(crate) seq: u64,
    /// When the frame was taken, as far as one knows: not later than it arrived.
    pub(crate) captured: Instant,
    /// State, pose of the camera, covariance, reset counter.
    pub(crate) frame: TrackedFrame,
}

/// Passes them on.
#[derive(Debug)]
pub(crate) struct Poses(broadcast::Sender<Arc<CameraFix>>);

impl Default for Poses {
    fn default() -> Self {
        Self(broadcast::Sender::new(KEPT))
    }
}

impl Poses {
    /// To all who listen, if anybody does.
    pub(crate) fn send(&self, fix: CameraFix) {
        // Nobody listening is no failure.
        let _ = self.0.send(Arc::new(fix));
    }

    /// From now on.
    pub(crate) fn listen(&self) -> broadcast::Receiver<Arc<CameraFix>> {
        self.0.subscribe()
    }
}
