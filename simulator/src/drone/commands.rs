//! Commands and their answers.

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{
    COMMAND_ACK_DATA, COMMAND_INT_DATA, COMMAND_LONG_DATA, MavCmd, MavFrame, MavMessage, MavResult,
    MavSeverity,
};

use super::Drone;
use crate::body::wrap;
use crate::{Event, Mode, Received};

use MavResult::{
    MAV_RESULT_ACCEPTED as ACCEPTED, MAV_RESULT_DENIED as DENIED, MAV_RESULT_FAILED as FAILED,
    MAV_RESULT_TEMPORARILY_REJECTED as REJECTED, MAV_RESULT_UNSUPPORTED as UNSUPPORTED,
};

/// Second parameter of disarming that works in the air.
const FORCE: f32 = 21196.0;
/// PX4 takes OFFBOARD when setpoints have come this lately.
const STREAM: f64 = 0.5;

impl Drone {
    pub(super) fn take_command_long(&mut self, from: &Received, m: &COMMAND_LONG_DATA) {
        let p = [m.param1, m.param2, m.param3, m.param4, m.param5, m.param6, m.param7];
        let result = self.command(m.command, &p);
        self.answer(from, m.command, result);
    }

    pub(super) fn take_command_int(&mut self, from: &Received, m: &COMMAND_INT_DATA) {
        let p = [m.param1, m.param2, m.param3, m.param4, m.x as f32, m.y as f32, m.z];
        let is_relative = m.frame == MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT;
        let result = if m.command == MavCmd::MAV_CMD_NAV_TAKEOFF && !self.is_px4() && !is_relative {
            DENIED
        } else {
            self.command(m.command, &p)
        };
        self.answer(from, m.command, result);
    }

    fn answer(&mut self, from: &Received, command: MavCmd, result: MavResult) {
        self.send(&MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
            command,
            result,
            target_system: from.system_id,
            target_component: from.component_id,
            ..Default::default()
        }));
        self.note(Event::Command { command: command as u32, result: result as u32 });
    }

    fn command(&mut self, command: MavCmd, p: &[f32; 7]) -> MavResult {
        match command {
            MavCmd::MAV_CMD_COMPONENT_ARM_DISARM => self.arm(p[0] > 0.5, p[1] == FORCE),
            MavCmd::MAV_CMD_DO_SET_MODE => {
                if p[0] as u32 & 1 == 0 {
                    return DENIED;
                }
                let number = if self.is_px4() {
                    (p[1] as u32) << 16 | (p[2] as u32) << 24
                } else {
                    p[1] as u32
                };
                self.set_mode_number(number)
            }
            MavCmd::MAV_CMD_NAV_TAKEOFF => self.take_off(f64::from(p[6])),
            MavCmd::MAV_CMD_NAV_LAND => self.set_mode(Mode::Land),
            MavCmd::MAV_CMD_DO_PAUSE_CONTINUE => self.pause(p[0] < 0.5),
            MavCmd::MAV_CMD_CONDITION_YAW => self.turn(p),
            MavCmd::MAV_CMD_DO_CHANGE_SPEED if p[1] > 0.0 => {
                self.speed = Some(f64::from(p[1]).min(5.0));
                ACCEPTED
            }
            MavCmd::MAV_CMD_DO_CHANGE_SPEED => DENIED,
            MavCmd::MAV_CMD_DO_FLIGHTTERMINATION if p[0] > 0.5 => {
                self.disarm("termination");
                ACCEPTED
            }
            MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL => self.set_interval(p[0] as u32, p[1]),
            MavCmd::MAV_CMD_REQUEST_MESSAGE => self.send_requested(p[0] as u32),
            _ => UNSUPPORTED,
        }
    }

    fn arm(&mut self, on: bool, force: bool) -> MavResult {
        if !on {
            if self.is_flying && !force {
                return if self.is_px4() { DENIED } else { FAILED };
            }
            self.disarm("command");
            return ACCEPTED;
        }
        if self.is_armed() {
            return ACCEPTED;
        }
        if let Some(why) = self.objection() {
            let label = if self.is_px4() { "Arming denied: " } else { "Arm: " };
            self.say(MavSeverity::MAV_SEVERITY_CRITICAL, &format!("{label}{why}"));
            return if self.is_px4() { REJECTED } else { FAILED };
        }
        self.armed_at = Some(self.now);
        if !(self.is_px4() && self.mode == Mode::Guided) {
            self.hold();
        }
        self.note(Event::Armed);
        ACCEPTED
    }

    pub(super) fn set_mode_number(&mut self, number: u32) -> MavResult {
        self.options.flavor.mode(number).map_or(FAILED, |mode| self.set_mode(mode))
    }

    fn set_mode(&mut self, mode: Mode) -> MavResult {
        let needs_position = !matches!(mode, Mode::Manual | Mode::Land);
        if needs_position && self.is_armed() && !self.has_position() {
            return FAILED;
        }
        let quiet = self.setpoint_heard.map_or(f64::INFINITY, |heard| self.since(heard));
        if self.is_px4() && mode == Mode::Guided && quiet > STREAM {
            self.say(MavSeverity::MAV_SEVERITY_CRITICAL, "Offboard denied: no setpoints");
            return REJECTED;
        }
        self.enter(mode, "command");
        ACCEPTED
    }

    pub(super) fn enter(&mut self, mode: Mode, why: &'static str) {
        if mode != self.mode {
            self.note(Event::Mode { mode, why });
            self.mode = mode;
            self.speed = None;
            self.hold();
            self.setpoint_heard = self.setpoint_heard.map(|_| self.now);
        }
    }

    /// `height` above home (ArduPilot) or above the sea (PX4).
    fn take_off(&mut self, height: f64) -> MavResult {
        if !self.is_armed() || self.is_flying || !height.is_finite() {
            return FAILED;
        }
        let height = if self.is_px4() {
            let Some([.., altitude]) = self.origin else { return REJECTED };
            height - f64::from(altitude) * 1e-3
        } else {
            height
        };
        if height <= 0.0 || !self.is_px4() && self.mode != Mode::Guided {
            return FAILED;
        }
        if self.is_px4() {
            self.enter(Mode::TakeOff, "command");
        }
        let mut target = self.estimator.position();
        target.z -= height;
        self.goal.position = Some(target);
        self.goal.is_climbing = true;
        ACCEPTED
    }

    fn pause(&mut self, stop: bool) -> MavResult {
        if self.is_px4() {
            return UNSUPPORTED;
        }
        if self.mode != Mode::Guided {
            return FAILED;
        }
        self.goal.pause = stop.then(|| self.stopping_point());
        ACCEPTED
    }

    /// CONDITION_YAW: degrees, speed, direction, relative.
    fn turn(&mut self, p: &[f32; 7]) -> MavResult {
        if self.is_px4() {
            return UNSUPPORTED;
        }
        if self.mode != Mode::Guided || !p[0].is_finite() {
            return FAILED;
        }
        let angle = f64::from(p[0]).to_radians();
        let sign = if p[2] < 0.0 { -1.0 } else { 1.0 };
        let yaw = if p[3] > 0.5 { self.estimator.yaw() + sign * angle } else { angle };
        (self.goal.yaw, self.goal.yaw_rate) = (Some(wrap(yaw)), None);
        ACCEPTED
    }

    fn set_interval(&mut self, id: u32, microseconds: f32) -> MavResult {
        if self.message(id).is_none() {
            return DENIED;
        }
        let interval = match microseconds {
            us if us < 0.0 => None,
            0.0 => Some(Duration::from_secs(1)),
            us => Some(Duration::from_micros(us as u64)),
        };
        self.streams.set(id, interval, self.now);
        ACCEPTED
    }

    fn send_requested(&mut self, id: u32) -> MavResult {
        match self.message(id) {
            Some(message) => {
                self.send(&message);
                ACCEPTED
            }
            None => DENIED,
        }
    }
}
