//! From goals to thrust, on nothing but the estimate.

use std::time::Duration;

use nalgebra::Vector3;

use super::{Drone, IN_AIR};
use crate::Mode;
use crate::body::{Thrust, limited, wrap};

/// Velocity per meter of distance, 1/s.
const POSITION_GAIN: f64 = 1.0;
/// Acceleration per velocity error, 1/s.
const VELOCITY_GAIN: f64 = 3.5;
/// Largest acceleration along the floor and upright, m/s².
const MAX_ACCELERATION: [f64; 2] = [2.5, 2.0];
/// Deceleration that a stop is planned with, m/s².
const BRAKING: f64 = 1.0;
/// Yaw rate per angle and the largest one.
const YAW: [f64; 2] = [1.5, 1.0];
/// Distance from which ArduPilot looks along the path if it is let, meters.
const LOOK_AHEAD: f64 = 1.0;

/// Where the autopilot steers to. Local frame.
#[derive(Debug, Clone, Default)]
pub(super) struct Goal {
    pub(super) position: Option<Vector3<f64>>,
    pub(super) velocity: Option<Vector3<f64>>,
    pub(super) yaw: Option<f64>,
    pub(super) yaw_rate: Option<f64>,
    /// Place to wait at until told to go on.
    pub(super) pause: Option<Vector3<f64>>,
    pub(super) is_climbing: bool,
    /// When it was given.
    pub(super) time: Duration,
}

impl Drone {
    /// What the motors are asked for; `None` while they stand.
    pub(super) fn thrust(&mut self) -> Option<Thrust> {
        self.armed_at?;
        if !self.is_flying && !self.lifts_off() {
            return None;
        }
        self.expire_velocity();
        let velocity = self.wanted_velocity();
        let error = velocity - self.estimator.velocity();
        let mut a = error * VELOCITY_GAIN;
        let level = limited(&Vector3::new(a.x, a.y, 0.0), MAX_ACCELERATION[0]);
        a = Vector3::new(level.x, level.y, a.z.clamp(-MAX_ACCELERATION[1], MAX_ACCELERATION[1]));
        let (sin, cos) = self.estimator.yaw().sin_cos();
        let acceleration = Vector3::new(cos * a.x + sin * a.y, cos * a.y - sin * a.x, a.z);
        Some(Thrust { acceleration, yaw_rate: self.wanted_yaw_rate() })
    }

    /// Stays where it is believed to be.
    pub(super) fn hold(&mut self) {
        self.goal = Goal {
            position: Some(self.stopping_point()),
            yaw: Some(self.goal.yaw.unwrap_or(self.estimator.yaw())),
            time: self.now,
            ..Goal::default()
        };
    }

    /// Where it comes to rest if it brakes now.
    pub(super) fn stopping_point(&self) -> Vector3<f64> {
        let v = self.estimator.velocity();
        self.estimator.position() + v * (0.2 + v.norm() / (2.0 * BRAKING))
    }

    fn lifts_off(&self) -> bool {
        let here = self.estimator.position().z;
        let is_up = self.goal.position.is_some_and(|p| p.z < here - 2.0 * IN_AIR);
        let is_driven =
            self.goal.velocity.is_some_and(|v| v.z < 0.0) && self.goal.position.is_none();
        self.goal.is_climbing
            || (self.is_px4() && self.mode == Mode::Guided && (is_up || is_driven))
    }

    /// Velocity goals that are not repeated end.
    fn expire_velocity(&mut self) {
        let timeout = if self.is_px4() { 0.5 } else { self.parameter("GUID_TIMEOUT") };
        let is_old = self.since(self.goal.time) > timeout;
        if self.goal.velocity.is_some() && is_old {
            match self.goal.position {
                Some(_) => self.goal.velocity = None,
                None => self.hold(),
            }
        }
    }

    fn wanted_velocity(&self) -> Vector3<f64> {
        let [speed, up, down, land] = self.speeds();
        let here = self.estimator.position();
        let towards = |target: &Vector3<f64>| {
            let error = target - here;
            let level = Vector3::new(error.x, error.y, 0.0);
            approach(&level) + Vector3::z() * (POSITION_GAIN * error.z)
        };
        let goal = self.goal.pause.as_ref().or(self.goal.position.as_ref());
        let mut v = goal.map_or(Vector3::zeros(), towards);
        match self.mode {
            Mode::Land => v.z = land,
            // Without a pilot the stick is at the bottom.
            Mode::Loiter | Mode::Manual => return Vector3::new(0.0, 0.0, 2.3),
            _ if self.goal.pause.is_none() => v += self.goal.velocity.unwrap_or_default(),
            _ => {}
        }
        let level = limited(&Vector3::new(v.x, v.y, 0.0), speed);
        Vector3::new(level.x, level.y, v.z.clamp(-up, down))
    }

    /// Along the floor, up, down, when landing, m/s.
    fn speeds(&self) -> [f64; 4] {
        let names = if self.is_px4() {
            ["MPC_XY_VEL_MAX", "MPC_Z_VEL_MAX_UP", "MPC_Z_VEL_MAX_DN", "MPC_LAND_SPEED"]
        } else {
            ["WPNAV_SPEED", "WPNAV_SPEED_UP", "WPNAV_SPEED_DN", "LAND_SPEED"]
        };
        let unit = if self.is_px4() { 1.0 } else { 0.01 };
        let [speed, up, down, land] = names.map(|name| self.parameter(name) * unit);
        [self.speed.unwrap_or(speed), up, down, land]
    }

    fn wanted_yaw_rate(&self) -> f64 {
        if let (Some(rate), true) = (self.goal.yaw_rate, self.goal.pause.is_none()) {
            return rate.clamp(-YAW[1], YAW[1]);
        }
        let mut target = self.goal.yaw;
        if target.is_none() && !self.is_px4() && self.parameter("WP_YAW_BEHAVIOR") != 0.0 {
            target = self.goal.position.and_then(|p| {
                let ahead = p - self.estimator.position();
                (ahead.xy().norm() > LOOK_AHEAD).then(|| ahead.y.atan2(ahead.x))
            });
        }
        target.map_or(0.0, |target| {
            (YAW[0] * wrap(target - self.estimator.yaw())).clamp(-YAW[1], YAW[1])
        })
    }
}

/// Velocity towards a place so that it can be stopped at.
fn approach(error: &Vector3<f64>) -> Vector3<f64> {
    let distance = error.norm();
    if distance < 1e-9 {
        return Vector3::zeros();
    }
    // v² = 2 a (d − d₀) joins v = k d smoothly at d = a / k².
    let knee = BRAKING / (POSITION_GAIN * POSITION_GAIN);
    let speed = if distance < knee {
        POSITION_GAIN * distance
    } else {
        (2.0 * BRAKING * (distance - knee / 2.0)).sqrt()
    };
    error * (speed / distance)
}
