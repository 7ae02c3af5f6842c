//! Poses from outside on their way to the estimator.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{
    GPS_GLOBAL_ORIGIN_DATA, MavEstimatorType, MavFrame, MavMessage, MavSeverity, ODOMETRY_DATA,
    VISION_POSITION_ESTIMATE_DATA,
};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::Drone;
use crate::estimator::{Fusion, Gate, Sighting};

/// An origin is lost without a word before the estimator is up.
const ORIGIN_AFTER: Duration = Duration::from_secs(4);
/// Poses that come faster are dropped.
const MIN_SPACING: Duration = Duration::from_millis(20);
/// Largest lag that a sender's clock is followed through.
const MAX_LAG_S: f64 = 0.5;
/// PX4 starts with poses this near to each other, and stops after this gap.
const PX4_GAPS: [Duration; 2] = [Duration::from_millis(200), Duration::from_millis(400)];
/// PX4 follows a jump after so long.
const PX4_PATIENCE: Duration = Duration::from_secs(1);
/// ArduPilot's gate, standard deviations (EK3_POS_I_GATE).
const ARDUPILOT_GATE: f64 = 5.0;

/// What is known of the sender of poses.
#[derive(Debug, Clone, Default)]
pub(super) struct Vision {
    /// Least of arrival minus stamp, seconds.
    offset: Option<f64>,
    last_arrival: Option<Duration>,
    reset_counter: Option<u8>,
    /// Height of the first pose if it came before the origin: it is added twice.
    height_error: f64,
    pub(super) num_taken: u64,
}

impl Drone {
    /// ArduPilot needs an origin before poses; one that comes too early or twice is not taken.
    pub(super) fn set_origin(&mut self, origin: [i32; 3]) {
        if self.uptime() < ORIGIN_AFTER {
            return self.refuse("origin too early");
        }
        if self.origin.is_none() {
            self.origin = Some(origin);
            if !self.is_px4() {
                if origin[2] == 0 {
                    self.vision.height_error -= 0.8;
                }
                self.say(MavSeverity::MAV_SEVERITY_INFO, "EKF3 IMU0 origin set");
            }
        }
        self.send_origin();
    }

    pub(super) fn send_origin(&mut self) {
        if let Some([latitude, longitude, altitude]) = self.origin {
            self.send(&MavMessage::GPS_GLOBAL_ORIGIN(GPS_GLOBAL_ORIGIN_DATA {
                latitude,
                longitude,
                altitude,
                ..Default::default()
            }));
        }
    }

    pub(super) fn see_pose(&mut self, m: &VISION_POSITION_ESTIMATE_DATA) {
        let position = Vector3::new(m.x, m.y, m.z).cast();
        let variance = [m.covariance[0], m.covariance[20]].map(f64::from);
        self.see(m.usec, position, f64::from(m.yaw), variance, m.reset_counter);
    }

    pub(super) fn see_odometry(&mut self, m: &ODOMETRY_DATA) {
        let frames: &[MavFrame] = if self.is_px4() {
            &[MavFrame::MAV_FRAME_LOCAL_NED, MavFrame::MAV_FRAME_LOCAL_FRD]
        } else {
            &[MavFrame::MAV_FRAME_LOCAL_FRD]
        };
        if !frames.contains(&m.frame_id) || m.child_frame_id != MavFrame::MAV_FRAME_BODY_FRD {
            return self.refuse("odometry frame");
        }
        let is_mocap = m.estimator_type == MavEstimatorType::MAV_ESTIMATOR_TYPE_MOCAP;
        if self.is_px4() && is_mocap {
            return self.refuse("odometry type");
        }
        if m.quality < 0 {
            return self.refuse("odometry quality");
        }
        let [w, x, y, z] = m.q.map(f64::from);
        let q = Quaternion::new(w, x, y, z);
        if q.norm().is_nan() || q.norm() < 0.5 {
            return self.refuse("not finite");
        }
        let (_, _, yaw) = UnitQuaternion::from_quaternion(q).euler_angles();
        let position = Vector3::new(m.x, m.y, m.z).cast();
        let variance = [m.pose_covariance[0], m.pose_covariance[20]].map(f64::from);
        self.see(m.time_usec, position, yaw, variance, m.reset_counter);
    }

    fn see(
        &mut self,
        usec: u64,
        mut position: Vector3<f64>,
        yaw: f64,
        variance: [f64; 2],
        reset_counter: u8,
    ) {
        if !yaw.is_finite() || position.iter().any(|v| !v.is_finite()) {
            return self.refuse("not finite");
        }
        if !self.uses_vision() {
            return self.refuse("vision is switched off");
        }
        if !self.is_px4() && self.origin.is_none() {
            // Seen on the real firmware: the height of such poses counts twice for good.
            self.vision.height_error = position.z;
            return self.refuse("pose before origin");
        }
        let gap = self.vision.last_arrival.map(|last| self.now.saturating_sub(last));
        if gap.is_some_and(|gap| gap < MIN_SPACING.mul_f64(0.95)) {
            return self.refuse("too fast");
        }
        self.vision.last_arrival = Some(self.now);
        if self.is_px4()
            && gap.is_some_and(|gap| gap > PX4_GAPS[usize::from(self.estimator.has_started())])
            && !self.estimator.has_started()
        {
            self.estimator.lose();
        }
        position.z += self.vision.height_error;
        let sighting = self.sighting(usec, position, yaw, variance);
        let is_new_frame = self.vision.reset_counter.is_some_and(|old| old != reset_counter);
        self.vision.reset_counter = Some(reset_counter);
        let fusion = if is_new_frame && self.is_px4() {
            self.estimator.reset(self.now, &sighting)
        } else if self.is_px4() {
            let sigmas = self.parameter("EKF2_EVP_GATE");
            self.estimator.correct(self.now, &sighting, sigmas, Gate::Refuse(PX4_PATIENCE))
        } else {
            self.estimator.correct(self.now, &sighting, ARDUPILOT_GATE, Gate::Follow)
        };
        match fusion {
            Fusion::Gated => self.refuse("innovation"),
            Fusion::Fused | Fusion::Reset => self.vision.num_taken += 1,
        }
    }

    /// With the moment that the autopilot takes it for: by the least lag seen and the delay that it
    /// was told.
    fn sighting(
        &mut self,
        usec: u64,
        position: Vector3<f64>,
        yaw: f64,
        [position_variance, yaw_variance]: [f64; 2],
    ) -> Sighting {
        let arrival = self.now.as_secs_f64();
        let (delay_ms, floors) = if self.is_px4() {
            ("EKF2_EV_DELAY", ["EKF2_EVP_NOISE", "EKF2_EVA_NOISE"])
        } else {
            ("VISO_DELAY_MS", ["VISO_POS_M_NSE", "VISO_YAW_M_NSE"])
        };
        let delay = self.parameter(delay_ms) * 1e-3;
        // PX4 without a converged TIMESYNC counts from the arrival.
        let without_jitter = if self.is_px4() {
            arrival
        } else {
            let lag = arrival - usec as f64 * 1e-6;
            let offset = match self.vision.offset {
                Some(offset) if lag >= offset && lag <= offset + MAX_LAG_S => offset,
                _ => lag,
            };
            self.vision.offset = Some(offset);
            usec as f64 * 1e-6 + offset
        };
        let [position_noise, yaw_noise] =
            [(position_variance, floors[0]), (yaw_variance, floors[1])].map(|(variance, floor)| {
                let floor = self.parameter(floor).max(0.01);
                if variance > 0.0 && variance.is_finite() {
                    variance.sqrt().max(floor)
                } else {
                    floor
                }
            });
        let time = Duration::from_secs_f64((without_jitter - delay).max(0.0));
        Sighting { time, position, yaw, position_noise, yaw_noise }
    }

    /// Whether the parameters let poses reach the estimator. A yaw that does not come from vision
    /// is not told from a place that is not known: without compass neither is usable.
    fn uses_vision(&self) -> bool {
        if self.is_px4() {
            let control = self.parameter("EKF2_EV_CTRL") as u32;
            control & 0b1001 == 0b1001
        } else {
            self.parameter("VISO_TYPE") != 0.0
                && ["EK3_SRC1_POSXY", "EK3_SRC1_POSZ", "EK3_SRC1_YAW"]
                    .iter()
                    .all(|name| self.parameter(name) == 6.0)
        }
    }

    /// Whether the place is known well enough to fly.
    pub(super) fn has_position(&self) -> bool {
        let flags_hold = if self.is_px4() {
            Duration::from_secs_f64(self.parameter("EKF2_NOAID_TOUT").max(0.0) * 1e-6)
        } else {
            Duration::from_millis(7100)
        };
        self.estimator.has_started() && self.pose_age().is_some_and(|age| age <= flags_hold)
    }

    /// Since the last pose that was taken.
    pub(super) fn pose_age(&self) -> Option<Duration> {
        self.estimator.last().map(|last| self.now.saturating_sub(last))
    }
}
