//! What a vehicle says of itself.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{MavLandedState, MavMessage, MavModeFlag, MavState};
use nalgebra::{Point3, UnitQuaternion, Vector3};

use crate::{
    Autopilot, Mode,
    frames::{local_from_map_point, local_from_map_vector, local_from_map_yaw},
};

/// Flags of EKF_STATUS_REPORT and ESTIMATOR_STATUS: relative and absolute position are known.
const POSITION_KNOWN: u16 = 0x18;
/// The estimator stands still because it knows nothing better.
const CONSTANT_POSITION: u16 = 0x80;

/// Whether the vehicle touches the ground, as it thinks.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Landed {
    /// It has not said.
    #[default]
    Unknown,
    /// On the ground.
    Ground,
    /// In the air.
    Air,
    /// Leaving the ground.
    TakingOff,
    /// Coming down.
    Landing,
}

/// Position and velocity of a vehicle's estimator, in the map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// In the map.
    pub position: Point3<f64>,
    /// In the map.
    pub velocity: Vector3<f64>,
    /// When it was received.
    pub at: Duration,
}

/// Latest of everything a vehicle says. Numbers that are not finite are not taken.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Telemetry {
    /// From heartbeats.
    pub custom_mode: Option<u32>,
    /// Motors may turn.
    pub armed: bool,
    /// The autopilot acts on its own because something failed.
    pub failsafe: bool,
    /// On the ground or not.
    pub landed: Landed,
    /// From the estimator.
    pub motion: Option<Motion>,
    /// Yaw in the map, and when it was received.
    pub yaw: Option<(f64, Duration)>,
    /// `local_from_body` (FRD), roll and pitch of the estimator with its yaw.
    pub attitude: Option<UnitQuaternion<f64>>,
    /// Whether the estimator knows its position; `None` when it has not said.
    pub position_known: Option<bool>,
    /// Charge left, 0 to 1.
    pub battery: Option<f64>,
    /// Its time since boot.
    pub uptime: Option<Duration>,
    /// The setpoint that it flies to, local frame.
    pub target: Option<Point3<f64>>,
}

impl Telemetry {
    /// Takes a message that tells what was so `at` a time. Returns whether it said something of this
    /// kind.
    pub fn take(&mut self, message: &MavMessage, at: Duration) -> bool {
        match message {
            MavMessage::HEARTBEAT(m) => {
                self.custom_mode = Some(m.custom_mode);
                self.armed = m.base_mode.contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED);
                let failed = [MavState::MAV_STATE_CRITICAL, MavState::MAV_STATE_EMERGENCY];
                self.failsafe = failed.contains(&m.system_status);
            }
            MavMessage::LOCAL_POSITION_NED(m) => {
                let position = Point3::new(m.x, m.y, m.z).map(f64::from);
                let velocity = Vector3::new(m.vx, m.vy, m.vz).map(f64::from);
                if (position.coords + velocity).iter().all(|c| c.is_finite()) {
                    self.motion = Some(Motion {
                        position: local_from_map_point(&position),
                        velocity: local_from_map_vector(&velocity),
                        at,
                    });
                }
            }
            MavMessage::ATTITUDE(m) => {
                let [roll, pitch, yaw] = [m.roll, m.pitch, m.yaw].map(f64::from);
                if (roll + pitch + yaw).is_finite() {
                    self.yaw = Some((local_from_map_yaw(yaw), at));
                    self.attitude = Some(UnitQuaternion::from_euler_angles(roll, pitch, yaw));
                }
            }
            MavMessage::EXTENDED_SYS_STATE(m) => {
                self.landed = match m.landed_state {
                    MavLandedState::MAV_LANDED_STATE_ON_GROUND => Landed::Ground,
                    MavLandedState::MAV_LANDED_STATE_IN_AIR => Landed::Air,
                    MavLandedState::MAV_LANDED_STATE_TAKEOFF => Landed::TakingOff,
                    MavLandedState::MAV_LANDED_STATE_LANDING => Landed::Landing,
                    MavLandedState::MAV_LANDED_STATE_UNDEFINED => Landed::Unknown,
                }
            }
            MavMessage::EKF_STATUS_REPORT(m) => self.take_flags(m.flags.bits()),
            MavMessage::ESTIMATOR_STATUS(m) => self.take_flags(m.flags.bits()),
            MavMessage::SYS_STATUS(m) => self.take_charge(m.battery_remaining),
            MavMessage::BATTERY_STATUS(m) if m.id == 0 => self.take_charge(m.battery_remaining),
            MavMessage::POSITION_TARGET_LOCAL_NED(m) => {
                self.target = Some(Point3::new(m.x, m.y, m.z).map(f64::from));
            }
            _ => return false,
        }
        true
    }

    fn take_flags(&mut self, flags: u16) {
        let known = flags & POSITION_KNOWN == POSITION_KNOWN && flags & CONSTANT_POSITION == 0;
        self.position_known = Some(known);
    }

    fn take_charge(&mut self, percent: i8) {
        if (0..=100).contains(&percent) {
            self.battery = Some(f64::from(percent) / 100.0);
        }
    }

    /// The mode it says to be in.
    pub fn mode(&self, autopilot: Autopilot) -> Option<Mode> {
        self.custom_mode.map(|custom_mode| autopilot.mode(custom_mode))
    }

    /// Whether it may be in the air: an armed vehicle that does not say to stand on the ground.
    pub fn is_flying(&self) -> bool {
        self.armed && self.landed != Landed::Ground
    }
}

/// The vehicle's time since boot in messages that carry it.
pub(crate) fn uptime(message: &MavMessage) -> Option<Duration> {
    let ms = match message {
        MavMessage::LOCAL_POSITION_NED(m) => m.time_boot_ms,
        MavMessage::ATTITUDE(m) => m.time_boot_ms,
        MavMessage::SYSTEM_TIME(m) => m.time_boot_ms,
        _ => return None,
    };
    Some(Duration::from_millis(ms.into()))
}
