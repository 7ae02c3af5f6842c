//! SET_POSITION_TARGET_LOCAL_NED, as each family takes it.

use mavlink::dialects::ardupilotmega::{
    MavFrame, MavMessage, POSITION_TARGET_LOCAL_NED_DATA, PositionTargetTypemask,
    SET_POSITION_TARGET_LOCAL_NED_DATA,
};
use nalgebra::Vector3;

use super::Drone;
use super::guidance::Goal;
use crate::body::wrap;
use crate::{Event, Mode};

const POSITION: u16 = 0x007;
const VELOCITY: u16 = 0x038;
const YAW: u16 = 0x400;
const YAW_RATE: u16 = 0x800;

impl Drone {
    pub(super) fn take_setpoint(&mut self, m: &SET_POSITION_TARGET_LOCAL_NED_DATA) {
        let mask = m.type_mask.bits();
        let position = Vector3::new(m.x, m.y, m.z).cast::<f64>();
        let velocity = Vector3::new(m.vx, m.vy, m.vz).cast::<f64>();
        let all =
            position.iter().chain(&velocity).chain([&f64::from(m.yaw)]).all(|v| v.is_finite());
        if !all && !self.is_px4() {
            // Seen on the real firmware: a floating point trap ends it.
            self.is_halted = true;
            return self.note(Event::Halted);
        }
        // "No change" of PX4.
        let usable =
            |v: &Vector3<f64>, bits: u16| mask & bits == 0 && v.iter().all(|c| c.is_finite());
        let (has_position, has_velocity) =
            (usable(&position, POSITION), usable(&velocity, VELOCITY));
        if !self.is_frame_known(m.coordinate_frame, has_position) || !(has_position || has_velocity)
        {
            self.refuse("setpoint");
            if !self.is_px4() && self.mode == Mode::Guided && self.is_flying {
                self.hold();
            }
            return;
        }
        self.setpoint_heard = Some(self.now);
        if self.mode != Mode::Guided {
            return;
        }
        if !self.is_px4() && !self.is_flying {
            return self.refuse("setpoint on the ground");
        }
        let is_body = m.coordinate_frame == MavFrame::MAV_FRAME_BODY_NED;
        let yaw = self.estimator.yaw();
        let velocity = if is_body {
            let (sin, cos) = yaw.sin_cos();
            Vector3::new(
                cos * velocity.x - sin * velocity.y,
                sin * velocity.x + cos * velocity.y,
                velocity.z,
            )
        } else {
            velocity
        };
        let has_yaw = mask & YAW == 0 && m.yaw.is_finite();
        let has_rate = mask & YAW_RATE == 0 && m.yaw_rate.is_finite();
        self.goal = Goal {
            position: has_position.then_some(position),
            velocity: has_velocity.then_some(velocity),
            yaw: has_yaw.then(|| wrap(f64::from(m.yaw))),
            yaw_rate: (has_rate && !has_yaw).then_some(f64::from(m.yaw_rate)),
            pause: None,
            is_climbing: false,
            time: self.now,
        };
    }

    fn is_frame_known(&self, frame: MavFrame, has_position: bool) -> bool {
        match frame {
            MavFrame::MAV_FRAME_LOCAL_NED => true,
            MavFrame::MAV_FRAME_BODY_NED => !has_position,
            _ => false,
        }
    }

    /// The target as it stands: the only answer to setpoints.
    pub(super) fn target_echo(&self) -> MavMessage {
        let place = self.goal.position.unwrap_or(self.estimator.position()).cast::<f32>();
        let velocity = self.goal.velocity.unwrap_or_default().cast::<f32>();
        let mut mask = 0x1c0;
        for (is_missing, bits) in [
            (self.goal.position.is_none(), POSITION),
            (self.goal.velocity.is_none(), VELOCITY),
            (self.goal.yaw.is_none(), YAW),
            (self.goal.yaw_rate.is_none(), YAW_RATE),
        ] {
            mask |= if is_missing { bits } else { 0 };
        }
        MavMessage::POSITION_TARGET_LOCAL_NED(POSITION_TARGET_LOCAL_NED_DATA {
            time_boot_ms: self.uptime().as_millis() as u32,
            x: place.x,
            y: place.y,
            z: place.z,
            vx: velocity.x,
            vy: velocity.y,
            vz: velocity.z,
            yaw: self.goal.yaw.unwrap_or_default() as f32,
            yaw_rate: self.goal.yaw_rate.unwrap_or_default() as f32,
            type_mask: PositionTargetTypemask::from_bits_retain(mask),
            coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED,
            ..Default::default()
        })
    }
}
