//! The messages we send.

#![expect(deprecated, reason = "autopilots in use do not know the successor of the origin message")]

use std::time::Duration;

use mavlink::dialects::ardupilotmega::{
    COMMAND_LONG_DATA, HEARTBEAT_DATA, MavAutopilot, MavCmd, MavEstimatorType, MavFrame,
    MavMessage, MavModeFlag, MavState, MavType, ODOMETRY_DATA, PositionTargetTypemask,
    SET_GPS_GLOBAL_ORIGIN_DATA, SET_POSITION_TARGET_LOCAL_NED_DATA, TIMESYNC_DATA,
    VISION_POSITION_ESTIMATE_DATA,
};
use nalgebra::Isometry3;

use crate::{
    Setpoint, VehicleId,
    frames::{local_from_map_setpoint, roll_pitch_yaw},
};

/// The autopilot among the components of a vehicle.
pub(crate) const AUTOPILOT_COMPONENT: u8 = 1;
/// Position and yaw are used, velocity is not.
const POSITION_YAW: u16 = 0x09F8;
/// Position, velocity and yaw are used.
const POSITION_VELOCITY_YAW: u16 = 0x09C0;
/// Disarms in the air.
const FORCE: f32 = 21196.0;

/// A command with its parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct CommandLong {
    /// Which.
    pub(crate) command: MavCmd,
    /// Parameters 1 to 7.
    pub(crate) params: [f32; 7],
}

impl CommandLong {
    fn new<const N: usize>(command: MavCmd, first: [f32; N]) -> Self {
        let mut params = [0.0; 7];
        params[..N].copy_from_slice(&first);
        Self { command, params }
    }

    /// Another mode; parameters as of [`Autopilot::mode_params`](crate::Autopilot::mode_params).
    pub(crate) fn set_mode(params: [f32; 3]) -> Self {
        Self::new(MavCmd::MAV_CMD_DO_SET_MODE, params)
    }

    /// Motors on, if the vehicle finds itself fit.
    pub(crate) fn arm() -> Self {
        Self::new(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [1.0])
    }

    /// Motors off, on the ground.
    pub(crate) fn disarm() -> Self {
        Self::new(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [0.0])
    }

    /// Motors off, wherever it is: it falls.
    pub(crate) fn cut_motors() -> Self {
        Self::new(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [0.0, FORCE])
    }

    /// Up to `height` meters above home.
    pub(crate) fn take_off(height: f64) -> Self {
        let up = height as f32;
        Self::new(MavCmd::MAV_CMD_NAV_TAKEOFF, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, up])
    }

    /// Down where it is.
    pub(crate) fn land() -> Self {
        Self::new(MavCmd::MAV_CMD_NAV_LAND, [])
    }

    /// Message `id` shall come every `interval`.
    pub(crate) fn set_interval(id: u32, interval: Duration) -> Self {
        let us = interval.as_micros() as f32;
        Self::new(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, [id as f32, us])
    }

    /// Message `id` shall come once.
    pub(crate) fn request_message(id: u32) -> Self {
        Self::new(MavCmd::MAV_CMD_REQUEST_MESSAGE, [id as f32])
    }

    /// For `vehicle`; `confirmation` counts the repetitions.
    pub(crate) fn message(&self, vehicle: VehicleId, confirmation: u8) -> MavMessage {
        let [param1, param2, param3, param4, param5, param6, param7] = self.params;
        MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            param1,
            param2,
            param3,
            param4,
            param5,
            param6,
            param7,
            command: self.command,
            target_system: vehicle.0,
            target_component: AUTOPILOT_COMPONENT,
            confirmation,
        })
    }
}

/// That the ground station lives.
pub(crate) fn heartbeat() -> MavMessage {
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode: 0,
        mavtype: MavType::MAV_TYPE_GCS,
        autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
        base_mode: MavModeFlag::empty(),
        system_status: MavState::MAV_STATE_ACTIVE,
        mavlink_version: 3,
    })
}

/// Our clock, asked for (`theirs` = 0) or answered.
pub(crate) fn time_sync(vehicle: VehicleId, theirs: i64, ours: i64) -> MavMessage {
    MavMessage::TIMESYNC(TIMESYNC_DATA {
        tc1: theirs,
        ts1: ours,
        target_system: vehicle.0,
        target_component: AUTOPILOT_COMPONENT,
    })
}

/// Where the local frame lies on the earth: any place will do, but its altitude must not be zero.
pub(crate) fn set_origin(vehicle: VehicleId) -> MavMessage {
    MavMessage::SET_GPS_GLOBAL_ORIGIN(SET_GPS_GLOBAL_ORIGIN_DATA {
        latitude: 473_977_420,
        longitude: 85_455_940,
        altitude: 100_000,
        target_system: vehicle.0,
        time_usec: 0,
    })
}

/// Where to be, always with the yaw: left to itself a vehicle turns along its path, and its camera
/// away from the map. With a velocity, where to pass and how fast.
pub(crate) fn position_target(
    vehicle: VehicleId,
    setpoint: &Setpoint,
    now: Duration,
) -> MavMessage {
    let (position, velocity, yaw) = local_from_map_setpoint(setpoint);
    let stays = velocity.norm() == 0.0;
    let mask = if stays { POSITION_YAW } else { POSITION_VELOCITY_YAW };
    MavMessage::SET_POSITION_TARGET_LOCAL_NED(SET_POSITION_TARGET_LOCAL_NED_DATA {
        time_boot_ms: now.as_millis() as u32,
        x: position.x as f32,
        y: position.y as f32,
        z: position.z as f32,
        vx: velocity.x as f32,
        vy: velocity.y as f32,
        vz: velocity.z as f32,
        afx: 0.0,
        afy: 0.0,
        afz: 0.0,
        yaw: yaw as f32,
        yaw_rate: 0.0,
        type_mask: PositionTargetTypemask::from_bits_retain(mask),
        target_system: vehicle.0,
        target_component: AUTOPILOT_COMPONENT,
        coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED,
    })
}

/// Which message carries poses to an estimator.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum VisionMessage {
    /// VISION_POSITION_ESTIMATE: both autopilots take it.
    #[default]
    PositionEstimate,
    /// ODOMETRY in LOCAL_FRD; without velocity, which is NaN and never zero.
    Odometry,
}

/// A pose for an estimator.
///
/// * `local_from_body`: local frame, body FRD.
/// * `captured`: on the clock that answers TIMESYNC.
/// * `sd`: standard deviations of position (meters) and angles, when known.
pub(crate) fn vision_pose(
    kind: VisionMessage,
    local_from_body: &Isometry3<f64>,
    captured: Duration,
    sd: Option<(f64, f64)>,
    reset_counter: u8,
) -> MavMessage {
    let [x, y, z] = local_from_body.translation.vector.map(|c| c as f32).into();
    let usec = captured.as_micros() as u64;
    let covariance = covariance(sd);
    match kind {
        VisionMessage::PositionEstimate => {
            let [roll, pitch, yaw] = roll_pitch_yaw(&local_from_body.rotation).map(|a| a as f32);
            MavMessage::VISION_POSITION_ESTIMATE(VISION_POSITION_ESTIMATE_DATA {
                usec,
                x,
                y,
                z,
                roll,
                pitch,
                yaw,
                covariance,
                reset_counter,
            })
        }
        VisionMessage::Odometry => {
            let q = local_from_body.rotation.quaternion();
            let unknown = f32::NAN;
            MavMessage::ODOMETRY(ODOMETRY_DATA {
                time_usec: usec,
                x,
                y,
                z,
                q: [q.w, q.i, q.j, q.k].map(|c| c as f32),
                vx: unknown,
                vy: unknown,
                vz: unknown,
                rollspeed: unknown,
                pitchspeed: unknown,
                yawspeed: unknown,
                pose_covariance: covariance,
                velocity_covariance: self::covariance(None),
                frame_id: MavFrame::MAV_FRAME_LOCAL_FRD,
                child_frame_id: MavFrame::MAV_FRAME_BODY_FRD,
                reset_counter,
                estimator_type: MavEstimatorType::MAV_ESTIMATOR_TYPE_VISION,
                quality: 100,
            })
        }
    }
}

/// Upper triangle of a 6×6 matrix with variances on its diagonal; NaN first when unknown.
fn covariance(sd: Option<(f64, f64)>) -> [f32; 21] {
    const DIAGONAL: [usize; 6] = [0, 6, 11, 15, 18, 20];
    let mut upper = [0.0; 21];
    match sd {
        None => upper[0] = f32::NAN,
        Some((position, angle)) => {
            for (axis, index) in DIAGONAL.into_iter().enumerate() {
                let sd = if axis < 3 { position } else { angle };
                upper[index] = (sd * sd) as f32;
            }
        }
    }
    upper
}

#[cfg(test)]
mod tests;
