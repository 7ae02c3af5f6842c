//! Between the types of `volery_flight` and those of the API.

use std::time::Duration;

use volery_api::{
    CameraMount, CameraPose, DroneCommand, DroneCommandStatus, DroneLink, DronePlace, DronePose,
    DroneState, DroneTarget, FramePlace,
};
use volery_flight::{
    Alert, Command, CommandId, CommandState, Happening, Key, Landed, Mode, PoseFix, Setpoint,
    Vehicle, VehicleId,
};
use volery_geometry::{Isometry3, Point3, UnitQuaternion};

/// Distance that counts as there when nobody says, meters.
const TOLERANCE: f64 = 0.15;
/// Slowest flight that is waited for, meters per second, and time for the rest.
const SLOW: f64 = 0.2;
const SETTLING: Duration = Duration::from_secs(15);
/// Longest flight to one place.
const MAX_TIMEOUT: Duration = Duration::from_secs(600);

pub(super) fn command_status(
    id: CommandId,
    drone: VehicleId,
    state: &CommandState,
) -> DroneCommandStatus {
    let detail = match state {
        CommandState::Rejected(reason) => Some(reason.clone()),
        _ => None,
    };
    DroneCommandStatus { id: id.0, drone: drone.0, state: state.name().to_owned(), detail }
}

/// Kind, value and detail of an event.
pub(super) fn happening(happening: &Happening) -> (&'static str, String, Option<String>) {
    let plain = |kind, value: &str| (kind, value.to_owned(), None);
    match happening {
        Happening::Link(state) => plain("link", state.name()),
        Happening::Feed(state) => plain("feed", state.name()),
        Happening::Armed(armed) => plain("armed", if *armed { "true" } else { "false" }),
        Happening::Mode(mode) => plain("mode", &mode.to_string()),
        Happening::Landed(landed) => plain("landed", landed_name(*landed)),
        Happening::Rebooted => plain("rebooted", ""),
        Happening::Moved(address) => plain("moved", &address.to_string()),
        Happening::Text { severity, text } => ("text", text.clone(), Some(severity.to_string())),
        Happening::Command { id, state } => {
            ("command", state.name().to_owned(), Some(id.0.to_string()))
        }
        Happening::Alert(alert) => {
            let detail = match alert {
                Alert::Holds(_) => Some("holds".to_owned()),
                Alert::Lands(_) => Some("lands".to_owned()),
                Alert::PoseRefused(refusal) => Some(refusal.to_string()),
                Alert::Relocated(distance) => Some(format!("by {distance:.2} m")),
                Alert::SigningClock(behind) => {
                    Some(format!("{:.0} s behind", behind.as_secs_f64()))
                }
                Alert::Impostor(from) => Some(from.to_string()),
                _ => None,
            };
            ("alert", alert.name().to_owned(), detail)
        }
    }
}

fn landed_name(landed: Landed) -> &'static str {
    match landed {
        Landed::Unknown => "unknown",
        Landed::Ground => "ground",
        Landed::Air => "air",
        Landed::TakingOff => "taking_off",
        Landed::Landing => "landing",
    }
}

pub(super) fn drone_state(vehicle: &Vehicle, now: Duration, t_ns: u64) -> DroneState {
    let telemetry = &vehicle.telemetry;
    let ms = |time: Duration| time.as_secs_f64() * 1e3;
    let age = |at: Duration| ms(now.saturating_sub(at));
    let link = vehicle.link();
    DroneState {
        id: vehicle.id.0,
        t_ns,
        autopilot: vehicle.autopilot.name().to_owned(),
        endpoint: vehicle.address.to_string(),
        link: DroneLink {
            state: link.state(now).name().to_owned(),
            silence_ms: ms(link.silence(now)),
            loss: link.loss(),
            round_trip_ms: link.round_trip().map(ms),
        },
        armed: telemetry.armed,
        flying: telemetry.is_flying(),
        failsafe: telemetry.failsafe,
        mode: telemetry.mode(vehicle.autopilot).map(|mode| {
            let name = match mode {
                Mode::Guided => "guided",
                Mode::Land => "land",
                Mode::Other(_) => "other",
            };
            name.to_owned()
        }),
        in_control: vehicle.is_in_control(),
        battery: telemetry.battery,
        feed: vehicle.feed_state().name().to_owned(),
        sent_pose_age_ms: vehicle.last_pose().map(|fix| age(fix.captured)),
        estimate: telemetry.motion.zip(telemetry.yaw).map(|(motion, (yaw, _))| DronePlace {
            position: motion.position.coords.into(),
            velocity: motion.velocity.into(),
            yaw,
            age_ms: Some(age(motion.at)),
        }),
        target: vehicle.setpoint().map(|setpoint| DronePlace {
            position: setpoint.position.coords.into(),
            velocity: setpoint.velocity.into(),
            yaw: setpoint.yaw,
            age_ms: None,
        }),
    }
}

/// A command for a vehicle that is `here`.
pub(super) fn command(command: &DroneCommand, here: Option<Setpoint>) -> Command {
    match command {
        DroneCommand::Arm {} => Command::Arm,
        DroneCommand::Disarm {} => Command::Disarm,
        DroneCommand::Takeoff { height } => Command::TakeOff { height: *height },
        DroneCommand::Goto(target) => go(target, here),
        DroneCommand::Hold {} => Command::Hold,
        DroneCommand::Land {} => Command::Land,
        DroneCommand::Stop {} => Command::CutMotors,
    }
}

fn go(target: &DroneTarget, here: Option<Setpoint>) -> Command {
    let position = Point3::from(target.position);
    // A vehicle that does not know where it is is refused anyway.
    let yaw = target.yaw.or(here.map(|here| here.yaw)).unwrap_or(f64::NAN);
    let distance = here.map_or(0.0, |here| (here.position - position).norm());
    let by_distance = distance / SLOW + SETTLING.as_secs_f64();
    let timeout = target.timeout_s.unwrap_or(by_distance);
    Command::Go {
        setpoint: Setpoint::at(position, yaw),
        tolerance: target.tolerance_m.unwrap_or(TOLERANCE),
        timeout: Duration::try_from_secs_f64(timeout).unwrap_or(MAX_TIMEOUT).min(MAX_TIMEOUT),
    }
}

/// A signing key from 64 hex digits.
pub(crate) fn key(text: &str) -> Option<Key> {
    if text.len() != 64 || !text.bytes().all(|b| b.is_ascii_hexdigit()) {
        return None;
    }
    let mut key = [0; 32];
    for (byte, at) in key.iter_mut().zip((0..).step_by(2)) {
        *byte = u8::from_str_radix(&text[at..at + 2], 16).ok()?;
    }
    Some(Key(key))
}

/// A pose that was taken `age_ms` before `now`; `None` when a number cannot be a time.
pub(super) fn pose_fix(pose: &DronePose, now: Duration) -> Option<PoseFix> {
    let age = Duration::try_from_secs_f64(pose.age_ms / 1e3).ok()?;
    // A pose from before the start of the clock is too old by any measure.
    let captured = now.checked_sub(age).unwrap_or(Duration::ZERO);
    let (position_sd, angle_sd) = (pose.position_sd, pose.angle_sd);
    let (position, orientation, resets) = (pose.position, pose.orientation, pose.reset_counter);
    let numbers = PoseFix::from_numbers;
    Some(numbers(position, orientation, captured, position_sd, angle_sd, resets))
}

/// The drone's pose by that of its camera; `None` without the covariance of both.
pub(super) fn camera_fix(
    map_from_camera: &CameraPose,
    covariance: Option<&[f64]>,
    body_from_camera: Option<CameraMount>,
    captured: Duration,
    resets: u32,
) -> Option<PoseFix> {
    let covariance: &[f64; 36] = covariance?.try_into().ok()?;
    let greatest = |axes: std::ops::Range<usize>| {
        axes.map(|axis| covariance[7 * axis]).fold(0.0, f64::max).sqrt()
    };
    let (position_sd, angle_sd) = (greatest(0..3), greatest(3..6));
    let mount = body_from_camera.unwrap_or_default();
    let map_from_body = isometry(map_from_camera.position, map_from_camera.orientation)
        * isometry(mount.position, mount.orientation).inverse();
    Some(PoseFix { map_from_body, captured, position_sd, angle_sd, resets })
}

/// The place that a frame gave for a vehicle that believes to be `here`.
pub(super) fn frame_place(
    fix: &PoseFix,
    here: Option<Setpoint>,
    goal: Option<Point3<f64>>,
    sent: Result<(), String>,
) -> FramePlace {
    let Isometry3 { rotation, translation } = fix.map_from_body;
    FramePlace {
        position: translation.vector.into(),
        orientation: [rotation.w, rotation.i, rotation.j, rotation.k],
        correction_m: here.map(|here| (here.position.coords - translation.vector).norm()),
        goal_distance_m: goal.map(|goal| (goal.coords - translation.vector).norm()),
        sent: sent.is_ok(),
        reason: sent.err(),
    }
}

fn isometry(position: [f64; 3], [w, x, y, z]: [f64; 4]) -> Isometry3<f64> {
    let rotation = nalgebra::Quaternion::new(w, x, y, z);
    Isometry3::from_parts(position.into(), UnitQuaternion::new_normalize(rotation))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A level camera that looks ahead, 10 cm before the middle of a drone that flies along y.
    #[test]
    fn the_drone_stands_behind_its_camera() {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let mount = CameraMount { position: [0.1, 0.0, 0.02], ..CameraMount::default() };
        // The camera's axes in the map: x right is x, y down is -z, z ahead is y.
        let camera = CameraPose { position: [1.0, 2.0, 3.0], orientation: [half, -half, 0.0, 0.0] };
        let mut covariance = [0.0; 36];
        covariance[0] = 4e-4;
        covariance[35] = 1e-4;
        let fix = camera_fix(&camera, Some(&covariance), Some(mount), Duration::ZERO, 0).unwrap();
        let place = fix.map_from_body.translation.vector;
        assert!((place - Point3::new(1.0, 1.9, 2.98).coords).norm() < 1e-12, "{place}");
        let ahead = fix.map_from_body.rotation * volery_geometry::Vector3::x();
        assert!((ahead - volery_geometry::Vector3::y()).norm() < 1e-12, "{ahead}");
        assert!((fix.position_sd - 0.02).abs() < 1e-12 && (fix.angle_sd - 0.01).abs() < 1e-12);
        assert!(camera_fix(&camera, None, Some(mount), Duration::ZERO, 0).is_none());
    }
}
