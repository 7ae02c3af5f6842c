//! How the pulling of a camera goes.

use std::{
    collections::VecDeque,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant},
};

use volery_api::{DroneCameraError, DroneCameraState, ws::ServerBody};

use super::failure::Failure;
use crate::{
    error::ApiError,
    streams::{Gone, Listener},
};

/// Frames over which the rate is taken.
const RATED: usize = 32;
/// Frames that are older do not count for the rate.
const RECENT: Duration = Duration::from_secs(5);

/// What is known of a camera; hears what becomes of its frames.
#[derive(Debug, Clone, Default)]
pub(super) struct Gauge(Arc<Mutex<Known>>);

#[derive(Debug, Default)]
pub(super) struct Known {
    pub(super) state: DroneCameraState,
    pub(super) frames: u64,
    pub(super) dropped: u64,
    pub(super) last_error: Option<DroneCameraError>,
    /// Of the last frames, the oldest first.
    arrivals: VecDeque<Instant>,
}

impl Known {
    /// Since the last frame came.
    pub(super) fn last_frame_age(&self) -> Option<Duration> {
        self.arrivals.back().map(Instant::elapsed)
    }

    /// Frames per second, of the last ones.
    pub(super) fn rate_hz(&self) -> f64 {
        let recent = self.arrivals.iter().filter(|arrived| arrived.elapsed() < RECENT);
        let (count, oldest) = recent
            .fold((0_u32, None), |(count, oldest), arrived| (count + 1, oldest.or(Some(*arrived))));
        match (oldest, self.arrivals.back()) {
            (Some(oldest), Some(newest)) if *newest > oldest => {
                f64::from(count - 1) / (*newest - oldest).as_secs_f64()
            }
            _ => 0.0,
        }
    }
}

impl Gauge {
    /// Of a camera that cannot even be tried.
    pub(super) fn refused(error: &ApiError) -> Self {
        let gauge = Self::default();
        gauge.note(DroneCameraState::Failed, error.code(), error.detail.clone());
        gauge
    }

    /// A frame came.
    pub(super) fn arrived(&self, at: Instant) {
        let mut known = self.known();
        known.state = DroneCameraState::Streaming;
        known.frames += 1;
        if known.arrivals.len() == RATED {
            known.arrivals.pop_front();
        }
        known.arrivals.push_back(at);
    }

    /// The connection is over.
    pub(super) fn failed(&self, failure: &Failure) {
        self.note(DroneCameraState::Failed, failure.code(), failure.to_string());
    }

    fn note(&self, state: DroneCameraState, code: &str, detail: String) {
        let mut known = self.known();
        known.state = state;
        known.last_error = Some(DroneCameraError { code: code.to_owned(), detail });
    }

    pub(super) fn known(&self) -> MutexGuard<'_, Known> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Listener for Gauge {
    fn tell(&self, body: ServerBody) -> Result<(), Gone> {
        if let ServerBody::FrameDropped { reason, detail, .. } = body {
            let mut known = self.known();
            known.dropped += 1;
            // A newer frame in its place is no error.
            if let Some(detail) = detail {
                known.last_error = Some(DroneCameraError { code: reason, detail });
            }
        }
        Ok(())
    }
}
