//! Streams that are followed from frame to frame; each has a tracker that lives in this process.

use std::{
    collections::BTreeMap,
    sync::Arc,
    time::{Duration, Instant},
};

use nalgebra::Vector3;
use volery_api::{
    FrameTelemetry, TrackLatency, TrackSource, TrackState, TrackedFrame,
    worker::{TrackTask, WorkerFailure},
};
use volery_tracking::{
    Frame, MotionLimits, PoseSource, Telemetry, TrackAnswer, Tracker, TrackerOptions,
};

use super::{
    image_work::query_image,
    requests::{Maps, camera_of, failure, of_pipeline},
};
use crate::{map_folder::MapFolder, moved::MovedBy, wire};

/// Streams followed at a time; the least recently used goes first.
const MAX_STREAMS: usize = 64;
/// Standard deviations of telemetry that does not say: radians, meters, meters per second.
const HEADING_SIGMA: f64 = 0.035;
const HEIGHT_SIGMA: f64 = 0.05;
const VELOCITY_SIGMA: f64 = 0.1;

/// The trackers of this process.
#[derive(Default)]
pub(super) struct Trackers {
    open: BTreeMap<u64, Followed>,
    num_uses: u64,
    /// The stream whose frame was answered last.
    behind: Option<u64>,
}

struct Followed {
    last_use: u64,
    map_dir: String,
    map: Arc<MapFolder>,
    tracker: Tracker,
}

impl Trackers {
    /// Forgets a stream.
    pub(super) fn end(&mut self, stream: u64) {
        self.open.remove(&stream);
    }

    /// The pose of the next frame of a stream.
    pub(super) fn track(
        &mut self,
        task: &TrackTask,
        bytes: &[u8],
        maps: &mut Maps,
    ) -> Result<TrackedFrame, WorkerFailure> {
        let start = Instant::now();
        let map = match self.open.get(&task.stream).filter(|f| f.map_dir == task.map_dir) {
            Some(followed) => Arc::clone(&followed.map),
            None => maps.get(&task.map_dir).map_err(of_pipeline)?,
        };
        let camera = task.camera.as_ref().map(camera_of).transpose()?;
        let size = task.width.zip(task.height);
        let query = query_image(bytes, task.encoding, size, camera.as_ref(), &map)
            .map_err(|e| failure(e.code(), e.to_string()))?;
        let decode_ms = start.elapsed().as_secs_f64() * 1e3;
        let moved = map.info().map_from_index;
        let frame = Frame {
            image: &query.image,
            capture_time: Duration::from_nanos(task.t_capture_ns),
            telemetry: telemetry(task.telemetry.unwrap_or_default(), moved.as_ref()),
        };
        let followed = self.followed(task, &map, || {
            let scale = moved.map_or(1.0, |moved| moved.scale);
            Tracker::new(&query.camera, &options(scale))
        });
        let clock = move || start.elapsed().as_secs_f64();
        let answer = followed.tracker.track(&frame, map.index(), &clock);
        self.behind = Some(task.stream);
        let mut reply = tracked_frame(answer, moved.as_ref());
        reply.latency.decode_ms = decode_ms;
        reply.latency.total_ms = start.elapsed().as_secs_f64() * 1e3;
        Ok(reply)
    }

    /// Whether there is a frame of which more can be learned.
    pub(super) fn is_behind(&self) -> bool {
        self.behind.is_some()
    }

    /// Learns more of the frame that was answered last.
    pub(super) fn catch_up(&mut self, is_hurried: bool) {
        let stream = self.behind.take();
        let Some(followed) = stream.and_then(|stream| self.open.get_mut(&stream)) else { return };
        followed.tracker.catch_up(followed.map.index(), is_hurried);
    }

    fn followed(
        &mut self,
        task: &TrackTask,
        map: &Arc<MapFolder>,
        begin: impl FnOnce() -> Tracker,
    ) -> &mut Followed {
        self.num_uses += 1;
        let is_open = self.open.get(&task.stream).is_some_and(|f| f.map_dir == task.map_dir);
        if !is_open && self.open.len() >= MAX_STREAMS {
            let oldest = self.open.iter().min_by_key(|(_, followed)| followed.last_use);
            if let Some(oldest) = oldest.map(|(stream, _)| *stream) {
                self.open.remove(&oldest);
            }
        }
        if !is_open {
            self.open.remove(&task.stream);
        }
        let num_uses = self.num_uses;
        let followed = self.open.entry(task.stream).or_insert_with(|| Followed {
            last_use: num_uses,
            map_dir: task.map_dir.clone(),
            map: Arc::clone(map),
            tracker: begin(),
        });
        followed.last_use = num_uses;
        followed
    }
}

/// Of a map whose index is `scale` times smaller than it.
fn options(scale: f64) -> TrackerOptions {
    let limits = MotionLimits::default();
    TrackerOptions {
        limits: MotionLimits {
            acceleration: limits.acceleration / scale,
            max_speed: limits.max_speed / scale,
            ..limits
        },
        ..TrackerOptions::default()
    }
}

/// In the frame of the index; nothing if that is tilted.
fn telemetry(told: FrameTelemetry, moved: Option<&MovedBy>) -> Telemetry {
    if moved.is_some_and(|moved| !moved.is_upright()) {
        return Telemetry::default();
    }
    let scale = moved.map_or(1.0, |moved| moved.scale);
    let usable = |value: f64, sigma: Option<f64>, usual: f64| {
        let sigma = sigma.filter(|s| s.is_finite() && *s > 0.0).unwrap_or(usual);
        value.is_finite().then_some((value, sigma))
    };
    let velocity = told.velocity.filter(|v| v.iter().all(|v| v.is_finite()));
    let scaled = |(value, sigma): (f64, f64)| (value / scale, sigma / scale);
    Telemetry {
        heading: told.heading.and_then(|v| usable(v, told.heading_sigma, HEADING_SIGMA)),
        height: told.height.and_then(|v| usable(v, told.height_sigma, HEIGHT_SIGMA)).map(scaled),
        velocity: velocity.and_then(|v| {
            let (_, sigma) = usable(0.0, told.velocity_sigma, VELOCITY_SIGMA)?;
            Some((Vector3::from(v) / scale, sigma / scale))
        }),
    }
}

/// In the words of the API.
fn tracked_frame(answer: TrackAnswer, moved: Option<&MovedBy>) -> TrackedFrame {
    let timings = answer.timings;
    let mut reply = TrackedFrame {
        state: match answer.state {
            volery_tracking::TrackState::Tracking => TrackState::Tracking,
            volery_tracking::TrackState::Relocalizing => TrackState::Relocalizing,
            volery_tracking::TrackState::Lost => TrackState::Lost,
        },
        pose: None,
        covariance: None,
        source: None,
        age_ms: 0.0,
        reason: answer.problem.map(|problem| problem.code().to_owned()),
        fault: answer.fault.map(|fault| fault.code().to_owned()),
        since_pose_ms: answer.since_pose.map(|since| since.as_secs_f64() * 1e3),
        num_points: 0,
        inlier_ratio: None,
        reprojection_px: None,
        reset_counter: answer.reset_counter,
        latency: TrackLatency {
            track_ms: timings.track_ms,
            features_ms: timings.features_ms,
            match_ms: timings.match_ms,
            solve_ms: timings.solve_ms,
            ..TrackLatency::default()
        },
    };
    if let Some(mut pose) = answer.pose {
        if let Some(moved) = moved {
            moved.move_pose(&mut pose.map_from_camera, &mut pose.covariance);
        }
        reply.pose = Some(wire::camera_pose(&pose.map_from_camera));
        reply.covariance = Some(pose.covariance.transpose().iter().copied().collect());
        reply.source = Some(match pose.source {
            PoseSource::Klt => TrackSource::Klt,
            PoseSource::Pnp => TrackSource::Pnp,
            PoseSource::Fused => TrackSource::Fused,
        });
        reply.num_points = pose.num_points as u32;
        reply.inlier_ratio = Some(pose.inlier_ratio).filter(|v| v.is_finite());
        reply.reprojection_px = Some(pose.reprojection_px).filter(|v| v.is_finite());
    }
    reply
}
