//! Bytes as pymavlink 2.4.50 writes them, sequence number 7, from system 255, component 190.

use nalgebra::{Point3, Vector3};

use super::*;
use crate::{
    Autopilot, Key, Mode,
    signing::Verifier,
    wire::{Sender, read_frame, write_frame},
};

const ID: VehicleId = VehicleId(3);
const STATION: Sender = Sender { system_id: 255, component_id: 190 };

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn check(message: &MavMessage, golden: &str) {
    assert_eq!(hex(&write_frame(STATION, 7, message, None)), golden);
}

#[test]
fn commands_are_as_pymavlink_writes_them() {
    check(&heartbeat(), "fd09000007ffbe0000000000000006080004037efa");
    let arm = CommandLong::arm().message(ID, 2);
    check(
        &arm,
        "fd21000007ffbe4c00000000803f0000000000000000000000000000000000000000000000009001030102\
        41fd",
    );
    let land = CommandLong::set_mode(Autopilot::Px4.mode_params(Mode::Land)).message(ID, 0);
    check(
        &land,
        "fd20000007ffbe4c00000000803f000080400000c04000000000000000000000000000000000b000030103\
        6f",
    );
    let up = CommandLong::take_off(1.5).message(ID, 0);
    check(
        &up,
        "fd20000007ffbe4c00000000000000000000000000000000000000000000000000000000c03f160003019e\
        49",
    );
    let interval = CommandLong::set_interval(32, Duration::from_millis(50)).message(ID, 0);
    check(
        &interval,
        "fd20000007ffbe4c000000000042005043470000000000000000000000000000000000000000ff010301f9\
        4c",
    );
    check(&set_origin(ID), "fd0d000007ffbe3000004c52401c44f41705a08601000343c2");
}

/// Map (1, 2, 1.5) with yaw 0.5 is local (1, −2, −1.5) with yaw −0.5.
#[test]
fn setpoints_are_as_pymavlink_writes_them() {
    let now = Duration::from_millis(1500);
    let stay = Setpoint::at(Point3::new(1.0, 2.0, 1.5), 0.5);
    check(
        &position_target(ID, &stay, now),
        "fd35000007ffbe540000dc0500000000803f000000c00000c0bf0000000000000000000000000000000000\
        00000000000000000000bf00000000f809030101a0e7",
    );
    let pass = Setpoint { velocity: Vector3::new(0.5, 0.25, 0.0), ..stay };
    check(
        &position_target(ID, &pass, now),
        "fd35000007ffbe540000dc0500000000803f000000c00000c0bf0000003f000080be000000000000000000\
        00000000000000000000bf00000000c009030101cd02",
    );
}

#[test]
fn poses_are_as_pymavlink_writes_them() {
    let captured = Duration::from_micros(1_234_567);
    let position = Vector3::new(1.0, -2.0, -1.5);
    let sd = Some((0.5, 0.25));
    let turned = Isometry3::new(position, Vector3::z() * -0.5);
    let vision = vision_pose(VisionMessage::PositionEstimate, &turned, captured, sd, 4);
    check(
        &vision,
        "fd75000007ffbe66000087d61200000000000000803f000000c00000c0bf0000000000000000000000bf00\
        00803e00000000000000000000000000000000000000000000803e00000000000000000000000000000000\
        0000803e0000000000000000000000000000803d00000000000000000000803d000000000000803d04a851",
    );
    let level = Isometry3::new(position, Vector3::zeros());
    let odometry = vision_pose(VisionMessage::Odometry, &level, captured, sd, 4);
    check(
        &odometry,
        "fde9000007ffbe4b010087d61200000000000000803f000000c00000c0bf0000803f000000000000000000\
        0000000000c07f0000c07f0000c07f0000c07f0000c07f0000c07f0000803e000000000000000000000000\
        00000000000000000000803e000000000000000000000000000000000000803e0000000000000000000000\
        000000803d00000000000000000000803d000000000000803d0000c07f0000000000000000000000000000\
        00000000000000000000000000000000000000000000000000000000000000000000000000000000000000\
        0000000000000000000000000000000000000000000000140c0402645b32",
    );
}

/// Link id 2, signing time 0x0102030405, the key 0, 1, 2, ... 31.
#[test]
fn signatures_are_pymavlinks() {
    let key = Key(std::array::from_fn(|i| i as u8));
    let time = 0x0001_0203_0405;
    let bytes = write_frame(STATION, 7, &heartbeat(), Some((&key, 2, time)));
    let golden = "fd09010007ffbe00000000000000060800040399020205040302010042edfab8cf43";
    assert_eq!(hex(&bytes), golden);
    let (frame, rest) = read_frame(&bytes);
    assert!(rest.is_empty());
    let mut verifier = Verifier::default();
    assert_eq!(verifier.verify(&key, &frame.unwrap(), time), Ok(()));
}
