//! Poses for a vehicle's estimator: which of them leave, and whether they do any good.
//!
//! An autopilot follows a wrong pose at once, and takes an old one for a new one. So each pose is
//! compared with what the vehicle itself says about its motion before it is sent, and no pose is
//! ever sent twice.

use std::time::Duration;

use nalgebra::{Isometry3, Point3, Quaternion, UnitQuaternion, Vector3};

use crate::{
    frames::{map_yaw, wrap},
    telemetry::Telemetry,
};

/// Poses may not come faster: ArduPilot drops them.
const MIN_INTERVAL: Duration = Duration::from_millis(20);
/// Telemetry older than this says nothing about now.
const TELEMETRY_AGE: Duration = Duration::from_millis(500);
/// A coordinate further out is not a place in a building.
const MAX_COORDINATE: f64 = 10_000.0;
/// Standard deviations of a difference that are still noise.
const SIGMAS: f64 = 5.0;
/// Floor of the standard deviations that callers state: meters and radians.
const MIN_SD: (f64, f64) = (0.01, 0.01);
/// How wrong the vehicle's own motion may be: meters per second and radians per second.
const DRIFT: (f64, f64) = (0.3, 0.3);
/// Most drift that is forgiven, meters and radians: a vehicle that has been without poses for long
/// lands, and must not follow a wrong place then.
const MAX_DRIFT: f64 = 0.3;
/// What delay does to a difference of yaws at a usual rate of turn.
const YAW_SLACK: f64 = 0.2;
/// Speed of a vehicle that says nothing, meters per second.
const MAX_SPEED: f64 = 2.0;
/// Furthest that a pose may lie from where the vehicle's estimator is, meters.
const MAX_FROM_ESTIMATE: f64 = 0.5;
/// Delay between a motion and our knowledge of it, for the distance above.
const TELEMETRY_DELAY: f64 = 0.4;
/// Largest tilt of a vehicle that flies as it should, radians.
const MAX_TILT: f64 = 1.0;
/// Poses that must agree with each other before a new place is believed.
const AGREEING: u32 = 3;
/// Without poses for so long, an estimator drifts, and then is lost.
const DEGRADED_AFTER: Duration = Duration::from_millis(500);
const FAILED_AFTER: Duration = Duration::from_millis(1500);
/// An estimator that follows for so long can be flown on.
const READY_AFTER: Duration = Duration::from_secs(2);
/// How far an estimator may be from the poses before it is flown, and in flight, meters.
const AGREEMENT: f64 = 0.3;
const MAX_LAG: f64 = 1.0;
/// Furthest new place that is believed in flight, meters; no new place is once the vehicle lands.
const MAX_RELOCATION: f64 = 0.5;

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
    ) -> Self {
        let [w, x, y, z] = orientation;
        let rotation = UnitQuaternion::new_unchecked(Quaternion::new(w, x, y, z));
        let map_from_body = Isometry3::from_parts(position.into(), rotation);
        Self { map_from_body, captured, position_sd, angle_sd }
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
    #[error("the pose is {0:?} old")]
    Stale(Duration),
    /// The image was taken later than now.
    #[error("the pose is {0:?} ahead of time")]
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

/// A pose that was sent, with what the vehicle said then.
#[derive(Debug, Clone, Copy)]
struct Anchor {
    fix: PoseFix,
    estimate: Option<Point3<f64>>,
    yaw: Option<f64>,
}

/// Lets poses pass that can be true.
#[derive(Debug, Clone, Default)]
pub struct PoseGate {
    accepted: Option<Anchor>,
    /// Latest pose of a place elsewhere, and how many agree with each other.
    elsewhere: Option<(Anchor, u32)>,
    reset_counter: u8,
}

impl PoseGate {
    /// Whether `fix` may leave at `now`. Returns the reset counter to send with it.
    ///
    /// * `max_age`: from capture to now.
    ///
    /// # Errors
    ///
    /// [`PoseRefusal`].
    pub fn check(
        &mut self,
        fix: PoseFix,
        telemetry: &Telemetry,
        max_age: Duration,
        now: Duration,
    ) -> Result<u8, PoseRefusal> {
        check_alone(&fix, max_age, now)?;
        let anchor = Anchor::new(fix, telemetry, now);
        let Some(before) = &self.accepted else {
            // A first pose has only the estimator to compare with, if it knows its place.
            anchor.check_estimate(telemetry)?;
            self.accepted = Some(anchor);
            return Ok(self.reset_counter);
        };
        if fix.captured < before.fix.captured + MIN_INTERVAL {
            return Err(PoseRefusal::NotNewer);
        }
        if telemetry.is_flying() && fix.map_from_body == before.fix.map_from_body {
            return Err(PoseRefusal::Frozen);
        }
        let refusal = match anchor.check_motion(before).and(anchor.check_estimate(telemetry)) {
            Ok(()) => {
                self.elsewhere = None;
                self.accepted = Some(anchor);
                return Ok(self.reset_counter);
            }
            Err(refusal) => refusal,
        };
        let agreeing = match &self.elsewhere {
            Some((last, _)) if fix.captured < last.fix.captured + MIN_INTERVAL => {
                return Err(PoseRefusal::NotNewer);
            }
            Some((last, number)) if anchor.check_motion(last).is_ok() => number + 1,
            _ => 1,
        };
        let gap = fix.captured.saturating_sub(before.fix.captured);
        let near = matches!(refusal, PoseRefusal::Jump(distance) if distance < MAX_RELOCATION);
        let believable = !telemetry.is_flying() || near && gap < FAILED_AFTER;
        if agreeing < AGREEING || !believable {
            self.elsewhere = Some((anchor, agreeing));
            return Err(refusal);
        }
        self.elsewhere = None;
        self.accepted = Some(anchor);
        self.reset_counter = self.reset_counter.wrapping_add(1);
        Ok(self.reset_counter)
    }

    /// The latest pose that passed.
    pub fn last(&self) -> Option<&PoseFix> {
        self.accepted.as_ref().map(|anchor| &anchor.fix)
    }
}

impl Anchor {
    fn new(fix: PoseFix, telemetry: &Telemetry, now: Duration) -> Self {
        let fresh = |at: Duration| now.saturating_sub(at) <= TELEMETRY_AGE;
        let motion = telemetry.motion.filter(|motion| fresh(motion.at));
        let estimate = motion.map(|motion| {
            // To the time of the image, so that what came at different times can be compared.
            let ahead = fix.captured.as_secs_f64() - motion.at.as_secs_f64();
            motion.position + motion.velocity * ahead
        });
        let yaw = telemetry.yaw.filter(|&(_, at)| fresh(at)).map(|(yaw, _)| yaw);
        Self { fix, estimate, yaw }
    }

    fn position(&self) -> Vector3<f64> {
        self.fix.map_from_body.translation.vector
    }

    /// Whether the way from `before` to here is the way that the vehicle says it went.
    fn check_motion(&self, before: &Self) -> Result<(), PoseRefusal> {
        let gap = self.fix.captured.saturating_sub(before.fix.captured).as_secs_f64();
        let turn =
            map_yaw(&self.fix.map_from_body.rotation) - map_yaw(&before.fix.map_from_body.rotation);
        let (told, drift) = match (before.yaw, self.yaw) {
            (Some(before), Some(now)) => (now - before, DRIFT.1),
            _ => (0.0, MAX_SPEED),
        };
        let sd = self.fix.angle_sd.max(MIN_SD.1).hypot(before.fix.angle_sd.max(MIN_SD.1));
        let angle = wrap(turn - told).abs();
        if angle > SIGMAS * sd + YAW_SLACK + (drift * gap).min(MAX_DRIFT) {
            return Err(PoseRefusal::Turn(angle));
        }
        let way = self.position() - before.position();
        let (told, drift) = match (before.estimate, self.estimate) {
            (Some(before), Some(now)) => (now - before, DRIFT.0),
            _ => (Vector3::zeros(), MAX_SPEED),
        };
        let sd = self.fix.position_sd.max(MIN_SD.0).hypot(before.fix.position_sd.max(MIN_SD.0));
        let distance = (way - told).norm();
        if distance > SIGMAS * sd + (drift * gap).min(MAX_DRIFT) {
            return Err(PoseRefusal::Jump(distance));
        }
        Ok(())
    }

    /// Whether this is about where the vehicle's estimator is, if it knows.
    fn check_estimate(&self, telemetry: &Telemetry) -> Result<(), PoseRefusal> {
        let (Some(estimate), Some(motion), Some(true)) =
            (self.estimate, telemetry.motion, telemetry.position_known)
        else {
            return Ok(());
        };
        let distance = (self.position() - estimate.coords).norm();
        let sd = self.fix.position_sd.max(MIN_SD.0);
        if distance > MAX_FROM_ESTIMATE + SIGMAS * sd + TELEMETRY_DELAY * motion.velocity.norm() {
            return Err(PoseRefusal::Jump(distance));
        }
        Ok(())
    }
}

/// What can be said of a pose without its history.
fn check_alone(fix: &PoseFix, max_age: Duration, now: Duration) -> Result<(), PoseRefusal> {
    let Isometry3 { rotation, translation } = &fix.map_from_body;
    // Comparisons with NaN are false.
    let near = translation.vector.iter().all(|c| c.abs() < MAX_COORDINATE);
    let unit = (rotation.coords.norm() - 1.0).abs() < 1e-3;
    let uncertainties = [fix.position_sd, fix.angle_sd];
    let certain = uncertainties.iter().all(|sd| (0.0..MAX_COORDINATE).contains(sd));
    if !(near && unit && certain) {
        return Err(PoseRefusal::NotFinite);
    }
    if fix.captured > now {
        return Err(PoseRefusal::Future(fix.captured - now));
    }
    let age = now - fix.captured;
    if age > max_age {
        return Err(PoseRefusal::Stale(age));
    }
    let tilt = (rotation * Vector3::z()).z.clamp(-1.0, 1.0).acos();
    if tilt > MAX_TILT {
        return Err(PoseRefusal::Tilted(tilt));
    }
    Ok(())
}

#[cfg(test)]
mod tests;
