//! Lets poses pass that can be true.

use std::time::Duration;

use nalgebra::{Isometry3, Point3, Vector3};

use super::{
    FAILED_AFTER, PoseFix, PoseRefusal,
    beside::{Beside, Sighting},
};
use crate::{
    frames::{map_yaw, wrap},
    telemetry::Telemetry,
};

/// Poses may not come faster. Autopilots take fifty a second; a camera that gives as many gives
/// them some milliseconds early or late, and which of those are too many is for them to say.
const MIN_INTERVAL: Duration = Duration::from_millis(15);
/// Telemetry older than this says nothing about now.
const TELEMETRY_AGE: Duration = Duration::from_millis(500);
/// A coordinate further out is not a place in a building.
const MAX_COORDINATE: f64 = 10_000.0;
/// Standard deviations of a difference that are still noise.
const SIGMAS: f64 = 5.0;
/// Floor of the standard deviations that callers state: meters and radians.
const MIN_SD: (f64, f64) = (0.01, 0.01);
/// How wrong the vehicle's own motion may be where less is known: meters per second and radians per
/// second.
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
/// Delay between a motion and our knowledge of it, for the distance above, seconds.
const TELEMETRY_DELAY: f64 = 0.4;
/// Time in which an estimator comes over to a new place.
const SETTLING: Duration = Duration::from_millis(1000);
/// Largest tilt of a vehicle that flies as it should, radians.
const MAX_TILT: f64 = 1.0;
/// Poses that must agree with each other before a new place is believed.
const AGREEING: u32 = 3;
/// Refused poses that agree with each other, from which on what follows them is refused as well.
const SURE: u32 = 8;
/// Furthest new place that is believed in flight, meters; no new place is once the vehicle lands.
const MAX_RELOCATION: f64 = 0.7;

/// Lets poses pass that can be true.
///
/// In flight a pose must be where the vehicle's own estimate leads from the poses before it. Where
/// it is not, that it comes again and again proves nothing: a place that is mistaken for another is
/// mistaken in every frame. So a place elsewhere is only believed when its source says that it has
/// given up the place before ([`PoseFix::resets`]), for which a source needs a proof of its own.
#[derive(Debug, Clone, Default)]
pub struct PoseGate {
    accepted: Option<Anchor>,
    /// Where the estimator has been beside the poses lately.
    beside: Option<Beside>,
    /// Latest of a run of poses that are elsewhere, and how many agree with each other.
    elsewhere: Option<(Anchor, u32)>,
    /// Until then the estimator comes over to a new place, and its own way says nothing.
    settles_by: Option<Duration>,
    reset_counter: u8,
}

/// A pose with what the vehicle said then.
#[derive(Debug, Clone, Copy)]
struct Anchor {
    fix: PoseFix,
    /// Where it believed to be, and how it moved.
    estimate: Option<(Point3<f64>, Vector3<f64>)>,
    /// From what it said so until the image, seconds.
    ahead: f64,
    yaw: Option<f64>,
    /// From the image until the vehicle has the pose, seconds.
    delay: f64,
}

impl PoseGate {
    /// Whether `fix` may leave at `now`. Returns the reset counter to send with it.
    ///
    /// * `max_age`: from capture to now.
    /// * `way`: time that the pose then takes to the vehicle.
    ///
    /// # Errors
    ///
    /// [`PoseRefusal`].
    pub fn check(
        &mut self,
        fix: PoseFix,
        telemetry: &Telemetry,
        max_age: Duration,
        way: Duration,
        now: Duration,
    ) -> Result<u8, PoseRefusal> {
        check_alone(&fix, max_age, now)?;
        let anchor = Anchor::new(fix, telemetry, way, now);
        let Some(before) = self.accepted else {
            // A first pose has only the estimator to compare with, if it knows its place.
            anchor.check_estimate(telemetry)?;
            self.accept(anchor);
            return Ok(self.reset_counter);
        };
        if fix.captured < before.fix.captured + MIN_INTERVAL {
            return Err(PoseRefusal::NotNewer);
        }
        let flying = telemetry.is_flying();
        if flying && fix.map_from_body == before.fix.map_from_body {
            return Err(PoseRefusal::Frozen);
        }
        let Err(refusal) = self.check_place(&anchor, &before, telemetry) else {
            self.accept(anchor);
            return Ok(self.reset_counter);
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
        let announced = fix.resets != before.fix.resets;
        let believable = !flying || announced && near && gap < FAILED_AFTER;
        if agreeing < AGREEING || !believable {
            self.elsewhere = Some((anchor, agreeing));
            return Err(refusal);
        }
        self.beside = None;
        self.settles_by = Some(fix.captured + SETTLING);
        self.accept(anchor);
        self.reset_counter = self.reset_counter.wrapping_add(1);
        Ok(self.reset_counter)
    }

    /// The latest pose that passed.
    pub fn last(&self) -> Option<&PoseFix> {
        self.accepted.as_ref().map(|anchor| &anchor.fix)
    }

    /// Counts the new places that were believed.
    pub(crate) fn reset_counter(&self) -> u8 {
        self.reset_counter
    }

    /// Whether the source of the poses says that they are elsewhere now, which is not yet believed, or
    /// was just now, and the estimator is coming over.
    pub(crate) fn is_relocating(&self, now: Duration) -> bool {
        if self.settles_by.is_some_and(|by| now < by) {
            return true;
        }
        let resets = |anchor: &Anchor| anchor.fix.resets;
        let elsewhere = self.elsewhere.as_ref().map(|(anchor, _)| resets(anchor));
        elsewhere.is_some_and(|new| self.accepted.as_ref().map(resets) != Some(new))
    }

    fn is_settling(&self, anchor: &Anchor) -> bool {
        self.settles_by.is_some_and(|by| anchor.fix.captured < by)
    }

    fn accept(&mut self, anchor: Anchor) {
        let gap = self.gap(&anchor);
        self.elsewhere = None;
        self.accepted = Some(anchor);
        if !self.is_settling(&anchor)
            && let Some(seen) = anchor.beside()
        {
            // On the ground an estimator comes over from anywhere.
            let known = self.beside.map(|beside| beside.after(gap));
            let known = known.filter(|beside| beside.distance(&seen).1 <= SIGMAS);
            self.beside = Some(known.map_or_else(|| Beside::new(&seen), |known| known.with(&seen)));
        }
    }

    /// Since the latest pose, seconds: those that come elsewhere do not get truer by coming longer.
    fn gap(&self, anchor: &Anchor) -> f64 {
        let elsewhere = self.elsewhere.as_ref().map(|(last, _)| last);
        elsewhere.or(self.accepted.as_ref()).map_or(0.0, |last| anchor.seconds_since(last))
    }

    /// Whether a pose is where the vehicle can be.
    fn check_place(
        &self,
        anchor: &Anchor,
        before: &Anchor,
        telemetry: &Telemetry,
    ) -> Result<(), PoseRefusal> {
        anchor.check_turn(before)?;
        anchor.check_estimate(telemetry)?;
        if self.is_settling(anchor) {
            return Anchor { estimate: None, ..*anchor }.check_way(before);
        }
        let flying = telemetry.is_flying();
        match (self.beside, anchor.beside()) {
            (Some(beside), Some(seen)) if flying => {
                let (distance, sigmas) = beside.after(self.gap(anchor)).distance(&seen);
                if sigmas > SIGMAS {
                    return Err(PoseRefusal::Jump(distance));
                }
            }
            _ => anchor.check_way(before)?,
        }
        if flying && self.goes_on_elsewhere(anchor) {
            return Err(PoseRefusal::Jump((anchor.position() - before.position()).norm()));
        }
        Ok(())
    }

    /// Whether a pose goes on from a place that was refused again and again. A vehicle that gets no
    /// poses strays, and may come to where the false ones are.
    fn goes_on_elsewhere(&self, anchor: &Anchor) -> bool {
        self.elsewhere
            .as_ref()
            .is_some_and(|(last, number)| *number >= SURE && anchor.check_motion(last).is_ok())
    }
}

impl Anchor {
    fn new(fix: PoseFix, telemetry: &Telemetry, way: Duration, now: Duration) -> Self {
        let fresh = |at: Duration| now.saturating_sub(at) <= TELEMETRY_AGE;
        let motion = telemetry.motion.filter(|motion| fresh(motion.at));
        // To the time of the image, so that what came at different times can be compared.
        let ahead =
            motion.map_or(0.0, |motion| fix.captured.as_secs_f64() - motion.at.as_secs_f64());
        let estimate =
            motion.map(|motion| (motion.position + motion.velocity * ahead, motion.velocity));
        let yaw = telemetry.yaw.filter(|&(_, at)| fresh(at)).map(|(yaw, _)| yaw);
        let delay = (now.saturating_sub(fix.captured) + way).as_secs_f64();
        Self { fix, estimate, ahead, yaw, delay }
    }

    /// What it says of the estimator, if that said where it is.
    fn beside(&self) -> Option<Sighting> {
        self.estimate.map(|(estimate, velocity)| Sighting {
            offset: self.position() - estimate.coords,
            velocity,
            sd: self.fix.position_sd.max(MIN_SD.0),
            delay: self.delay,
            ahead: self.ahead,
        })
    }

    fn position(&self) -> Vector3<f64> {
        self.fix.map_from_body.translation.vector
    }

    fn seconds_since(&self, before: &Self) -> f64 {
        self.fix.captured.saturating_sub(before.fix.captured).as_secs_f64()
    }

    /// Whether the way from `before` to here is the way that the vehicle says it went.
    fn check_motion(&self, before: &Self) -> Result<(), PoseRefusal> {
        self.check_turn(before)?;
        self.check_way(before)
    }

    fn check_turn(&self, before: &Self) -> Result<(), PoseRefusal> {
        let turn =
            map_yaw(&self.fix.map_from_body.rotation) - map_yaw(&before.fix.map_from_body.rotation);
        let (told, drift) = match (before.yaw, self.yaw) {
            (Some(before), Some(now)) => (now - before, DRIFT.1),
            _ => (0.0, MAX_SPEED),
        };
        let sd = self.fix.angle_sd.max(MIN_SD.1).hypot(before.fix.angle_sd.max(MIN_SD.1));
        let angle = wrap(turn - told).abs();
        if angle > SIGMAS * sd + YAW_SLACK + (drift * self.seconds_since(before)).min(MAX_DRIFT) {
            return Err(PoseRefusal::Turn(angle));
        }
        Ok(())
    }

    fn check_way(&self, before: &Self) -> Result<(), PoseRefusal> {
        let way = self.position() - before.position();
        let (told, drift) = match (before.estimate, self.estimate) {
            (Some((before, _)), Some((now, _))) => (now - before, DRIFT.0),
            _ => (Vector3::zeros(), MAX_SPEED),
        };
        let sd = self.fix.position_sd.max(MIN_SD.0).hypot(before.fix.position_sd.max(MIN_SD.0));
        let distance = (way - told).norm();
        if distance > SIGMAS * sd + (drift * self.seconds_since(before)).min(MAX_DRIFT) {
            return Err(PoseRefusal::Jump(distance));
        }
        Ok(())
    }

    /// Whether this is about where the vehicle's estimator is, if it knows.
    fn check_estimate(&self, telemetry: &Telemetry) -> Result<(), PoseRefusal> {
        let (Some((estimate, velocity)), Some(true)) = (self.estimate, telemetry.position_known)
        else {
            return Ok(());
        };
        let distance = (self.position() - estimate.coords).norm();
        let sd = self.fix.position_sd.max(MIN_SD.0);
        if distance > MAX_FROM_ESTIMATE + SIGMAS * sd + TELEMETRY_DELAY * velocity.norm() {
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
