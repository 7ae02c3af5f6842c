//! Poses for a vehicle's estimator: which of them leave, and whether they do any good.
//!
//! An autopilot follows a wrong pose at once, and takes an old one for a new one. So each pose is
//! compared with what the vehicle itself says about its motion before it is sent, and no pose is
//! ever sent twice.

use std::time::Duration;

use nalgebra::{Isometry3, Quaternion, UnitQuaternion};

use crate::telemetry::Telemetry;

mod beside;
mod gate;

pub use gate::PoseGate;

/// Without poses for so long, an estimator drifts, and then is lost.
const DEGRADED_AFTER: Duration = Duration::from_millis(500);
const FAILED_AFTER: Duration = Duration::from_millis(1500);
/// An estimator that follows for so long can be flown on.
const READY_AFTER: Duration = Duration::from_secs(2);
/// How far an estimator may be from the poses before it is flown, and in flight, meters.
const AGREEMENT: f64 = 0.3;
const MAX_LAG: f64 = 1.0;
/// Pose of a vehicle with what belongs to it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseFix {
    /// The vehicle in the map; body FLU.
    pub map_from_body: Isometry3<f64>,
    /// When the image was taken.
    pub captured: Duration,
    /// Standard deviation of each coordinate, meters.
    pub position_sd: f64,
    /// Standard deviation of each angle, radians.
    pub angle_sd: f64,
    /// Counts places that its source has given up for others. A new place that is not announced so
    /// is not believed in flight.
    pub resets: u32,
}

impl PoseFix {
    /// From plain numbers, which are checked when the pose is to leave: `position` in the map,
    /// `orientation` of the body (FLU) as w, x, y, z.
    pub fn from_numbers(
        position: [f64; 3],
        orientation: [f64; 4],
        captured: Duration,
        position_sd: f64,
        angle_sd: f64,
        resets: u32,
    ) -> Self {
        let [w, x, y, z] = orientation;
        let rotation = UnitQuaternion::new_unchecked(Quaternion::new(w, x, y, z));
        let map_from_body = Isometry3::from_parts(position.into(), rotation);
        Self { map_from_body, captured, position_sd, angle_sd, resets }
    }
}

/// Why a pose does not leave.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum PoseRefusal {
    /// The vehicle cannot take poses now.
    #[error("the vehicle does not take poses now")]
    NotFed,
    /// A number is not finite, or the place is on no map.
    #[error("the pose is not finite")]
    NotFinite,
    /// The image is too old.
    #[error("the pose is {} ms old", .0.as_millis())]
    Stale(Duration),
    /// The image was taken later than now.
    #[error("the pose is {} ms ahead of time", .0.as_millis())]
    Future(Duration),
    /// Not later than the pose before, or too soon after it.
    #[error("the pose is not newer than the one before")]
    NotNewer,
    /// To the last digit the one before: the camera shows the same picture again.
    #[error("the camera shows the same picture again")]
    Frozen,
    /// No vehicle in flight is tilted like this.
    #[error("the pose is tilted by {0:.2} rad")]
    Tilted(f64),
    /// Not where the vehicle's motion has brought it.
    #[error("the pose is {0:.2} m from where the vehicle must be")]
    Jump(f64),
    /// Not turned as the vehicle's motion has turned it.
    #[error("the pose is {0:.2} rad from where the vehicle must look")]
    Turn(f64),
}

/// Whether a vehicle's estimator follows our poses.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum FeedState {
    /// It takes no poses: no link, or an address that is not its own.
    #[default]
    Idle,
    /// It waits for an origin on the earth.
    Origin,
    /// It takes poses, and does not follow them yet.
    Feeding,
    /// It follows them.
    Ready,
    /// It followed them, and gets none.
    Degraded,
    /// It has got none for so long that it does not know where it is.
    Failed,
}

impl FeedState {
    /// Its name on the wire of the API.
    pub fn name(self) -> &'static str {
        match self {
            Self::Idle => "idle",
            Self::Origin => "origin",
            Self::Feeding => "feeding",
            Self::Ready => "ready",
            Self::Degraded => "degraded",
            Self::Failed => "failed",
        }
    }
}

/// The poses of one vehicle.
#[derive(Debug, Clone, Default)]
pub(crate) struct Feed {
    gate: PoseGate,
    state: FeedState,
    agreeing_since: Option<Duration>,
}

impl Feed {
    /// Lets poses pass that can be true.
    pub(crate) fn gate(&mut self) -> &mut PoseGate {
        &mut self.gate
    }

    /// The latest pose that was sent.
    pub(crate) fn last(&self) -> Option<&PoseFix> {
        self.gate.last()
    }

    /// Whether the estimator follows, as of the last update.
    pub(crate) fn state(&self) -> FeedState {
        self.state
    }

    /// Whether its poses are elsewhere now, which its estimator has not followed yet.
    pub(crate) fn is_relocating(&self, now: Duration) -> bool {
        self.gate.is_relocating(now)
    }

    /// Age of the latest pose that was sent.
    pub(crate) fn age(&self, now: Duration) -> Option<Duration> {
        self.last().map(|fix| now.saturating_sub(fix.captured))
    }

    /// Looks at the state anew. Returns it if it changed.
    ///
    /// * `reachable`: whether poses can be sent to this vehicle alone.
    /// * `has_origin`: whether its estimator is ready for them.
    pub(crate) fn update(
        &mut self,
        reachable: bool,
        has_origin: bool,
        telemetry: &Telemetry,
        now: Duration,
    ) -> Option<FeedState> {
        let age = self.age(now);
        let fresh = age.is_some_and(|age| age < DEGRADED_AFTER);
        let was_ready = matches!(self.state, FeedState::Ready | FeedState::Degraded);
        if self.follows(was_ready, telemetry) && fresh {
            self.agreeing_since.get_or_insert(now);
        } else {
            self.agreeing_since = None;
        }
        let agrees_for = self.agreeing_since.map(|since| now.saturating_sub(since));
        let state = if !reachable {
            FeedState::Idle
        } else if !has_origin {
            FeedState::Origin
        } else if !fresh && (was_ready || self.state == FeedState::Failed) {
            let failed = age.is_none_or(|age| age >= FAILED_AFTER);
            if failed { FeedState::Failed } else { FeedState::Degraded }
        } else if agrees_for.is_some_and(|time| was_ready || time >= READY_AFTER) {
            FeedState::Ready
        } else {
            FeedState::Feeding
        };
        (std::mem::replace(&mut self.state, state) != state).then_some(state)
    }

    /// Whether the estimator is where the latest pose is. Once it was, its delay in motion is
    /// forgiven.
    fn follows(&self, was_ready: bool, telemetry: &Telemetry) -> bool {
        let (Some(fix), Some(motion)) = (self.last(), telemetry.motion) else { return false };
        let distance = (fix.map_from_body.translation.vector - motion.position.coords).norm();
        let limit = if was_ready { MAX_LAG } else { AGREEMENT };
        telemetry.position_known == Some(true) && distance < limit
    }
}
