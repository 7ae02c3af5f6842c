//! What a drone tells of itself.

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use mavlink::dialects::ardupilotmega::{
    ATTITUDE_DATA, ATTITUDE_QUATERNION_DATA, AUTOPILOT_VERSION_DATA, BATTERY_STATUS_DATA,
    EKF_STATUS_REPORT_DATA, ESTIMATOR_STATUS_DATA, EXTENDED_SYS_STATE_DATA, EkfStatusFlags,
    EstimatorStatusFlags, GPS_GLOBAL_ORIGIN_DATA, HEARTBEAT_DATA, LOCAL_POSITION_NED_DATA,
    MavBatteryFunction, MavBatteryType, MavLandedState, MavMessage, MavModeFlag,
    MavProtocolCapability, MavState, MavSysStatusSensor, MavType, MavVtolState,
    PARAM_REQUEST_READ_DATA, PARAM_SET_DATA, PARAM_VALUE_DATA, SYS_STATUS_DATA, SYSTEM_TIME_DATA,
};
use nalgebra::UnitQuaternion;

use super::{Drone, TICK};
use crate::Mode;

const HEARTBEAT: u32 = 0;
/// Parameters that are sent per tick when all are asked for.
const PARAMETERS_PER_TICK: usize = 4;
/// A healthy attitude, and what a known place adds.
const ESTIMATOR_FLAGS: [u16; 2] = [0x27, 0x318];
/// The estimator holds its place for want of anything better.
const CONSTANT_POSITION: u16 = 0x80;

/// What is sent when.
#[derive(Debug, Clone)]
pub(super) struct Streams {
    /// Interval and next time by message id.
    due: BTreeMap<u32, (Duration, Duration)>,
    parameters: VecDeque<usize>,
    lists: bool,
}

impl Default for Streams {
    fn default() -> Self {
        let heartbeat = (HEARTBEAT, (Duration::from_secs(1), Duration::ZERO));
        Self { due: [heartbeat].into(), parameters: VecDeque::new(), lists: false }
    }
}

impl Streams {
    pub(super) fn set(&mut self, id: u32, interval: Option<Duration>, now: Duration) {
        match interval {
            Some(interval) => self.due.insert(id, (interval.max(TICK), now)),
            None => self.due.remove(&id),
        };
    }

    pub(super) fn list_parameters(&mut self) {
        self.lists = true;
    }
}

impl Drone {
    pub(super) fn send_streams(&mut self) {
        let now = self.now;
        let mut due = Vec::new();
        for (id, (interval, next)) in &mut self.streams.due {
            if *next <= now {
                // A late tick does not send twice.
                *next = (*next + *interval).max(now);
                due.push(*id);
            }
        }
        for id in due {
            if let Some(message) = self.message(id) {
                self.send(&message);
            }
        }
        if std::mem::take(&mut self.streams.lists) {
            self.streams.parameters = (0..self.parameters.len()).collect();
        }
        for _ in 0..PARAMETERS_PER_TICK {
            if let Some(index) = self.streams.parameters.pop_front() {
                self.send_parameter_at(index);
            }
        }
    }

    pub(super) fn send_parameter(&mut self, m: &PARAM_REQUEST_READ_DATA) {
        let index = match usize::try_from(m.param_index) {
            Ok(index) => Some(index),
            Err(_) => m.param_id.to_str().ok().and_then(|name| self.parameters.index(name)),
        };
        match index {
            Some(index) => self.send_parameter_at(index),
            None => self.refuse("parameter"),
        }
    }

    pub(super) fn set_parameter(&mut self, m: &PARAM_SET_DATA) {
        let Ok(name) = m.param_id.to_str() else { return self.refuse("parameter") };
        let value = self.parameters.from_wire(name, m.param_value);
        match self.parameters.index(name) {
            Some(index) => {
                self.parameters.set(name, value);
                self.send_parameter_at(index);
            }
            None => self.refuse("parameter"),
        }
    }

    fn send_parameter_at(&mut self, index: usize) {
        let Some((name, param_type, param_value)) = self.parameters.wire(index) else {
            return self.refuse("parameter");
        };
        self.send(&MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
            param_value,
            param_count: self.parameters.len() as u16,
            param_index: index as u16,
            param_id: name.into(),
            param_type,
        }));
    }

    /// Message `id` as it would be sent now, `None` for those it does not know.
    pub(super) fn message(&self, id: u32) -> Option<MavMessage> {
        let time_boot_ms = self.uptime().as_millis() as u32;
        let [pitch, roll] = self.body.tilt().map(|angle| angle as f32);
        let yaw = self.estimator.yaw() as f32;
        let yawspeed = self.body.yaw_rate as f32;
        let p = self.estimator.position().cast::<f32>();
        let v = self.estimator.velocity().cast::<f32>();
        Some(match id {
            HEARTBEAT => self.heartbeat(),
            1 => self.system_status(),
            2 => MavMessage::SYSTEM_TIME(SYSTEM_TIME_DATA { time_unix_usec: 0, time_boot_ms }),
            30 => MavMessage::ATTITUDE(ATTITUDE_DATA {
                time_boot_ms,
                roll,
                pitch,
                yaw,
                yawspeed,
                ..Default::default()
            }),
            31 => {
                let q = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
                MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA {
                    time_boot_ms,
                    q1: q.w,
                    q2: q.i,
                    q3: q.j,
                    q4: q.k,
                    yawspeed,
                    ..Default::default()
                })
            }
            32 => MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA {
                time_boot_ms,
                x: p.x,
                y: p.y,
                z: p.z,
                vx: v.x,
                vy: v.y,
                vz: v.z,
            }),
            49 => {
                let [latitude, longitude, altitude] = self.origin?;
                MavMessage::GPS_GLOBAL_ORIGIN(GPS_GLOBAL_ORIGIN_DATA {
                    latitude,
                    longitude,
                    altitude,
                    ..Default::default()
                })
            }
            85 => self.target_echo(),
            147 => self.battery_status(),
            148 => self.version(),
            193 if !self.is_px4() => MavMessage::EKF_STATUS_REPORT(EKF_STATUS_REPORT_DATA {
                flags: EkfStatusFlags::from_bits_retain(self.estimator_flags()),
                pos_horiz_variance: self.estimator.innovation.powi(2) as f32,
                pos_vert_variance: 0.01,
                velocity_variance: 0.01,
                ..Default::default()
            }),
            230 if self.is_px4() => {
                let accuracy = self.estimator.position_sigma() as f32;
                MavMessage::ESTIMATOR_STATUS(ESTIMATOR_STATUS_DATA {
                    time_usec: self.uptime().as_micros() as u64,
                    flags: EstimatorStatusFlags::from_bits_retain(self.estimator_flags()),
                    pos_horiz_ratio: (self.estimator.innovation / 0.5) as f32,
                    pos_horiz_accuracy: accuracy,
                    pos_vert_accuracy: accuracy,
                    ..Default::default()
                })
            }
            245 => MavMessage::EXTENDED_SYS_STATE(EXTENDED_SYS_STATE_DATA {
                vtol_state: MavVtolState::MAV_VTOL_STATE_UNDEFINED,
                landed_state: self.landed_state(),
            }),
            _ => return None,
        })
    }

    fn estimator_flags(&self) -> u16 {
        ESTIMATOR_FLAGS[0]
            | if self.has_position() { ESTIMATOR_FLAGS[1] } else { CONSTANT_POSITION }
    }

    fn heartbeat(&self) -> MavMessage {
        let mut base_mode = MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED;
        base_mode.set(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED, self.is_armed());
        base_mode.set(MavModeFlag::MAV_MODE_FLAG_GUIDED_ENABLED, self.mode == Mode::Guided);
        let system_status = match (self.failsafe, self.is_armed()) {
            (Some(_), _) => MavState::MAV_STATE_CRITICAL,
            (None, true) => MavState::MAV_STATE_ACTIVE,
            (None, false) => MavState::MAV_STATE_STANDBY,
        };
        MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            custom_mode: self.options.flavor.number(self.mode).unwrap_or_default(),
            mavtype: MavType::MAV_TYPE_QUADROTOR,
            autopilot: self.options.flavor.autopilot(),
            base_mode,
            system_status,
            mavlink_version: 3,
        })
    }

    fn system_status(&self) -> MavMessage {
        let present = MavSysStatusSensor::MAV_SYS_STATUS_PREARM_CHECK
            | MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_3D_GYRO
            | MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_3D_ACCEL
            | MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_VISION_POSITION
            | MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_BATTERY;
        let mut health = present;
        let is_fit = self.is_armed() || self.objection().is_none();
        health.set(MavSysStatusSensor::MAV_SYS_STATUS_PREARM_CHECK, is_fit);
        MavMessage::SYS_STATUS(SYS_STATUS_DATA {
            onboard_control_sensors_present: present,
            onboard_control_sensors_enabled: present,
            onboard_control_sensors_health: health,
            load: 200,
            voltage_battery: self.millivolts(),
            current_battery: 800,
            battery_remaining: self.battery.round() as i8,
            ..Default::default()
        })
    }

    fn battery_status(&self) -> MavMessage {
        let mut voltages = [u16::MAX; 10];
        voltages[0] = self.millivolts();
        MavMessage::BATTERY_STATUS(BATTERY_STATUS_DATA {
            battery_function: MavBatteryFunction::MAV_BATTERY_FUNCTION_ALL,
            mavtype: MavBatteryType::MAV_BATTERY_TYPE_LIPO,
            temperature: 2500,
            voltages,
            current_battery: 800,
            energy_consumed: -1,
            battery_remaining: self.battery.round() as i8,
            ..Default::default()
        })
    }

    /// Three cells of lithium polymer.
    fn millivolts(&self) -> u16 {
        (10_500.0 + 21.0 * self.battery) as u16
    }

    fn version(&self) -> MavMessage {
        let capabilities = MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_MAVLINK2
            | MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_COMMAND_INT
            | MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_FLIGHT_TERMINATION
            | MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED;
        MavMessage::AUTOPILOT_VERSION(AUTOPILOT_VERSION_DATA {
            capabilities,
            uid: u64::from(self.options.system_id),
            flight_sw_version: if self.is_px4() { 0x010f_00ff } else { 0x0407_00ff },
            ..Default::default()
        })
    }

    fn landed_state(&self) -> MavLandedState {
        let has_climbed =
            self.goal.position.is_none_or(|p| self.estimator.position().z < p.z + 0.15);
        match (self.is_flying, self.mode) {
            (false, _) => MavLandedState::MAV_LANDED_STATE_ON_GROUND,
            (true, Mode::Land) => MavLandedState::MAV_LANDED_STATE_LANDING,
            (true, _) if self.goal.is_climbing && !has_climbed => {
                MavLandedState::MAV_LANDED_STATE_TAKEOFF
            }
            (true, _) => MavLandedState::MAV_LANDED_STATE_IN_AIR,
        }
    }
}
