//! A stream that is followed from frame to frame.

use std::{sync::Arc, time::Instant};

use uuid::Uuid;
use volery_api::{
    TrackState, TrackedFrame,
    worker::{TrackTask, WorkerRequest},
    ws::{FrameHeader, ServerBody},
};

use super::{Frame, Gone, Shared, camera_clock::CameraClock, reason_of};
use crate::{
    error::{ApiError, ApiResult, Code},
    poses::CameraFix,
    workers::{Seat, Turn},
};

/// The worker's side of a stream: one child keeps its tracker.
struct Following {
    shared: Arc<Shared>,
    seat: Option<Seat>,
    /// Names the stream to the child.
    stream: u64,
    /// The child that answered last, and its last count of resets.
    last: (u64, u32),
    /// Resets by children that have gone.
    resets: u32,
    started: Instant,
    camera_clock: CameraClock,
}

/// Answers frames until nobody hears it.
pub(super) async fn track_frames(shared: Arc<Shared>) {
    let seat = Some(shared.app.trackers.take());
    let mut following = Following {
        shared,
        seat,
        stream: Uuid::now_v7().as_u64_pair().1,
        last: (0, 0),
        resets: 0,
        started: Instant::now(),
        camera_clock: CameraClock::default(),
    };
    while following.next().await.is_ok() {}
}

impl Following {
    /// Waits for a frame and for the child, then takes the newest frame.
    async fn next(&mut self) -> Result<(), Gone> {
        while self.shared.is_empty() {
            self.shared.arrived.notified().await;
        }
        let Some(seat) = &self.seat else { return Err(Gone) };
        let turn = seat.turn().await;
        let Some(Frame { header, payload, arrived }) = self.shared.pop() else { return Ok(()) };
        let outcome = match turn {
            Ok(turn) => self.ask(turn, &header, payload, arrived).await,
            Err(error) => Err(error.into()),
        };
        match outcome {
            Ok(frame) => self.tell(&header, arrived, frame),
            Err(error) => {
                let reason = reason_of(&error);
                self.shared.drop_frame(&header, reason, Some(error.detail))
            }
        }
    }

    async fn ask(
        &mut self,
        turn: Turn,
        header: &FrameHeader,
        payload: bytes::Bytes,
        arrived: Instant,
    ) -> ApiResult<TrackedFrame> {
        if payload.is_empty() {
            return Err(ApiError::new(Code::Unprocessable("empty_file"), "the frame has no bytes"));
        }
        let app = &self.shared.app;
        let since_start = arrived.saturating_duration_since(self.started).as_nanos() as u64;
        let task = TrackTask {
            stream: self.stream,
            map_dir: app.map_folder(&self.shared.stream.version).await?.display().to_string(),
            camera: self.shared.stream.open.camera.clone(),
            encoding: header.encoding,
            width: header.width,
            height: header.height,
            t_capture_ns: header.t_capture_ns.unwrap_or(since_start),
            telemetry: header.telemetry,
        };
        let life = turn.life();
        let timeout = app.config.workers.localize_timeout;
        let request = WorkerRequest::Track(Box::new(task));
        let asked = turn.ask::<TrackedFrame>(&request, payload, timeout).await;
        let mut frame = asked.inspect_err(|error| app.metrics.asked(error))?;
        if self.last.0 != 0 && self.last.0 != life {
            // The new child does not know of the places that the old one gave up.
            self.resets += self.last.1 + 1;
        }
        self.last = (life, frame.reset_counter);
        frame.reset_counter += self.resets;
        let elapsed = arrived.elapsed();
        app.metrics.localized(elapsed);
        let latency = &mut frame.latency;
        let worked = latency.decode_ms
            + latency.track_ms
            + latency.features_ms
            + latency.match_ms
            + latency.solve_ms;
        latency.total_ms = elapsed.as_secs_f64() * 1e3;
        latency.recv_ms = (latency.total_ms - worked).max(0.0);
        frame.age_ms = latency.total_ms;
        Ok(frame)
    }

    fn tell(
        &mut self,
        header: &FrameHeader,
        arrived: Instant,
        frame: TrackedFrame,
    ) -> Result<(), Gone> {
        let version = &self.shared.stream.version;
        let (map_id, map_version) = (version.map_id, version.version);
        if let Some(drone_id) = &self.shared.stream.open.drone_id {
            let fix = CameraFix {
                drone_id: drone_id.clone(),
                map_id,
                map_version,
                seq: header.seq,
                captured: self.captured(header, arrived),
                frame: frame.clone(),
            };
            if let (Some(id), Some(drones)) = (self.shared.stream.feeds, &self.shared.app.drones) {
                // The journal of the drone says why a pose did not leave.
                let _ = drones.camera_pose(id, fix.captured, &fix.frame);
            }
            self.shared.app.poses.send(fix);
        }
        debug_assert_eq!(frame.pose.is_some(), frame.state == TrackState::Tracking);
        let body = ServerBody::FrameTracked {
            stream_id: header.stream_id,
            seq: header.seq,
            t_capture_ns: header.t_capture_ns,
            map_id,
            map_version,
            result: Box::new(frame),
        };
        self.shared.listener.tell(body)
    }

    /// When a frame was taken, by our clock.
    fn captured(&mut self, header: &FrameHeader, arrived: Instant) -> Instant {
        let Some(t_capture_ns) = header.t_capture_ns else { return arrived };
        let since_start = arrived.saturating_duration_since(self.started);
        let late = self.camera_clock.lateness(t_capture_ns, since_start);
        arrived.checked_sub(late).unwrap_or(arrived)
    }
}

impl Drop for Following {
    fn drop(&mut self) {
        // Without an answer yet, or without a service, nobody has anything to forget.
        let (Some(seat), Ok(runtime)) = (self.seat.take(), tokio::runtime::Handle::try_current())
        else {
            return;
        };
        if self.last.0 == 0 {
            return;
        }
        let (stream, timeout) = (self.stream, self.shared.app.config.workers.localize_timeout);
        runtime.spawn(async move {
            let Ok(turn) = seat.turn().await else { return };
            let request = WorkerRequest::EndTrack { stream };
            // A child that cannot be told has gone, with all that it knew.
            let _ = turn.ask::<serde_json::Value>(&request, bytes::Bytes::new(), timeout).await;
        });
    }
}
