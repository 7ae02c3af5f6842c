//! What the watchdog sees of a vehicle, and does about it.

use std::time::Duration;

use super::Vehicle;
use crate::{
    Setpoint,
    event::{Alert, Happening},
    task::{self, Command, CommandId, CommandState},
    watchdog::{Health, Reason, Verdict, judge},
};

impl Vehicle {
    /// What the watchdog looks at.
    pub(super) fn health(&self, now: Duration) -> Health {
        let since = |at: Duration| now.saturating_sub(at);
        Health {
            pose_age: self.feed.age(now),
            link_age: self.telemetry.motion.map(|motion| since(motion.at)),
            lease_over: self.lease_until.map_or(Duration::ZERO, since),
            relocating: self.feed.is_relocating(now),
            battery: self.telemetry.battery,
        }
    }

    /// Acts on what must not go on in flight.
    pub(super) fn guard(&mut self, now: Duration) -> Vec<Happening> {
        if !self.telemetry.is_flying() {
            // On the ground nothing is to be held.
            self.lease_until.take_if(|until| *until <= now);
        }
        if !self.telemetry.is_flying() || !self.is_in_control() {
            self.verdict = Verdict::Continue;
            return Vec::new();
        }
        let verdict = judge(&self.health(now), &self.limits);
        let unsteered = self.steer_until.is_some_and(|until| now >= until);
        let before = std::mem::replace(&mut self.verdict, verdict);
        // A hold may be flown out of once its reason is gone; a landing goes on.
        let worse = verdict.severity() > before.severity();
        if verdict == Verdict::Hold(Reason::Relocating)
            && let Some(here) = self.here()
        {
            // Where it believes to be may move by more than it does: it must not fly the difference.
            self.pilot.steer(here, now);
        }
        match verdict {
            Verdict::Land(reason) if worse => {
                self.steer_until = None;
                let nowhere = Setpoint::at(nalgebra::Point3::origin(), 0.0);
                let steps = task::steps(&Command::Land, self.autopilot, nowhere, nowhere);
                let mut happenings = vec![Happening::Alert(Alert::Lands(reason))];
                happenings.extend(self.pilot.begin(CommandId::GUARD, steps));
                happenings
            }
            Verdict::Hold(reason) if worse => {
                let mut happenings = vec![Happening::Alert(Alert::Holds(reason))];
                happenings.extend(self.hold(now));
                happenings
            }
            Verdict::Continue if unsteered => self.hold(now),
            _ => Vec::new(),
        }
    }

    /// Stays where it can stop from now on.
    fn hold(&mut self, now: Duration) -> Vec<Happening> {
        self.steer_until = None;
        if let Some(stop) = self.stopping_point() {
            self.pilot.steer(stop, now);
            self.pilot.hurry(now);
        }
        self.pilot.finish(CommandState::Superseded)
    }
}
