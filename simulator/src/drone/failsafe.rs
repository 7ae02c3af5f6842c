//! What an autopilot does by itself.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::MavSeverity;

use super::{CRITICAL_BATTERY, Drone};
use crate::{Event, Flavor, Mode};

/// Why an autopilot lands by itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Failsafe {
    GroundStation,
    Vision,
    Battery,
    Offboard,
}

/// ArduPilot acts so long after the last pose.
const ARDUPILOT_VISION: Duration = Duration::from_secs(8);

impl Failsafe {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::GroundStation => "ground station lost",
            Self::Vision => "vision lost",
            Self::Battery => "battery critical",
            Self::Offboard => "offboard lost",
        }
    }

    fn text(self, flavor: Flavor) -> &'static str {
        match (self, flavor) {
            (Self::GroundStation, Flavor::ArduPilot) => "GCS Failsafe",
            (Self::Vision, Flavor::ArduPilot) => "EKF Failsafe: changed to LAND Mode",
            (Self::Battery, Flavor::ArduPilot) => "Battery 1 is critical",
            (Self::GroundStation, Flavor::Px4) => "Failsafe: GCS connection lost, landing",
            (Self::Vision, Flavor::Px4) => "Failsafe: local position lost, landing",
            (Self::Battery, Flavor::Px4) => "Failsafe: critical battery, landing",
            (Self::Offboard, _) => "Failsafe: offboard signal lost, landing",
        }
    }
}

impl Drone {
    /// Timers that run while the motors do.
    pub(super) fn watch(&mut self) {
        let Some(armed_at) = self.armed_at else {
            self.failsafe = None;
            return;
        };
        if self.failsafe.is_none()
            && let Some(cause) = self.trouble()
        {
            self.failsafe = Some(cause);
            self.say(MavSeverity::MAV_SEVERITY_CRITICAL, cause.text(self.options.flavor));
            self.note(Event::Failsafe { why: cause.name() });
            if self.is_flying {
                self.enter(Mode::Land, cause.name());
            } else {
                self.disarm(cause.name());
            }
        }
        let patience = match self.options.flavor {
            Flavor::ArduPilot => self.parameter("DISARM_DELAY"),
            Flavor::Px4 => self.parameter("COM_DISARM_PRFLT"),
        };
        let is_idle = !self.is_flying && !self.goal.is_climbing;
        if is_idle && patience > 0.0 && self.since(armed_at) > patience {
            self.disarm("no takeoff");
        }
    }

    fn trouble(&self) -> Option<Failsafe> {
        if self.is_station_lost() {
            return Some(Failsafe::GroundStation);
        }
        let quiet = self.setpoint_heard.map_or(f64::INFINITY, |heard| self.since(heard));
        if self.is_px4() && self.mode == Mode::Guided && quiet > self.parameter("COM_OF_LOSS_T") {
            return Some(Failsafe::Offboard);
        }
        let is_lost = if self.is_px4() {
            !self.has_position()
        } else {
            self.parameter("FS_EKF_ACTION") != 0.0
                && self.pose_age().is_none_or(|age| age > ARDUPILOT_VISION)
        };
        if is_lost {
            return Some(Failsafe::Vision);
        }
        (self.battery < CRITICAL_BATTERY).then_some(Failsafe::Battery)
    }

    /// A ground station that was never heard is not missed.
    fn is_station_lost(&self) -> bool {
        let (is_on, timeout) = match self.options.flavor {
            Flavor::ArduPilot => {
                (self.parameter("FS_GCS_ENABLE") != 0.0, self.parameter("FS_GCS_TIMEOUT"))
            }
            Flavor::Px4 => {
                let wait = self.parameter("COM_FAIL_ACT_T");
                (self.parameter("NAV_DLL_ACT") != 0.0, self.parameter("COM_DL_LOSS_T") + wait)
            }
        };
        is_on && self.gcs_heard.is_some_and(|heard| self.since(heard) > timeout)
    }

    /// Why it cannot be armed.
    pub(super) fn objection(&self) -> Option<&'static str> {
        let is_fresh = self.pose_age().is_some_and(|age| age < Duration::from_millis(300));
        if self.uptime() < Duration::from_secs(18) {
            return Some("Accels inconsistent");
        }
        if !self.is_px4() && self.origin.is_none() {
            return Some("AHRS: waiting for home");
        }
        if !self.has_position() {
            return Some("Need Position Estimate");
        }
        if !is_fresh {
            return Some("VisOdom: not healthy");
        }
        if self.battery < 2.0 * CRITICAL_BATTERY {
            return Some("Battery below minimum arming capacity");
        }
        matches!(self.mode, Mode::Manual | Mode::Land).then_some("Mode not armable")
    }

    pub(super) fn disarm(&mut self, why: &'static str) {
        if self.armed_at.take().is_some() {
            self.note(Event::Disarmed { why });
        }
        self.goal = super::Goal::default();
    }

    pub(super) fn since(&self, then: Duration) -> f64 {
        self.now.saturating_sub(then).as_secs_f64()
    }
}
