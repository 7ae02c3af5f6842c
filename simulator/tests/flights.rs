//! A drone does what the real firmware was seen to do.

mod station;

use std::f64::consts::FRAC_PI_2;
use std::time::Duration;

use mavlink::dialects::ardupilotmega::*;
use nalgebra::Vector3;
use station::*;
use volery_simulator::*;

const ACCEPTED: Option<MavResult> = Some(MavResult::MAV_RESULT_ACCEPTED);
const FAILED: Option<MavResult> = Some(MavResult::MAV_RESULT_FAILED);

/// Poses with 2 cm noise: take-off, five places and landing, each place met within 15 cm, both
/// families, with and without key, with a map turned against the world or not.
#[test]
fn drones_fly_on_poses_alone() {
    for (options, key, turn) in [
        (ardupilot(), true, 0.7),
        (ardupilot(), false, 0.0),
        (px4(), true, 0.0),
        (px4(), false, -1.1),
    ] {
        let signing = key.then_some(Signing { key: [3; 32], epoch: 1 << 40 });
        let mut rig = Rig::new(DroneOptions { signing, yaw: 0.4, ..options });
        let map = nalgebra::Rotation3::from_axis_angle(&Vector3::z_axis(), turn);
        rig.map_turn = turn;
        rig.run(0.1);
        rig.set_origin(100_000);
        rig.run(2.0);
        let is_px4 = rig.drone().options().flavor == Flavor::Px4;
        if is_px4 {
            rig.stream = Some(map * Vector3::new(1.0, 2.0, 1.2));
            rig.run(0.6);
        }
        assert_eq!((rig.set_mode(Mode::Guided), rig.arm(true)), (ACCEPTED, ACCEPTED));
        if !is_px4 {
            let climb = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.2];
            assert_eq!(rig.command(MavCmd::MAV_CMD_NAV_TAKEOFF, &climb), ACCEPTED);
        }
        rig.run(6.0);
        for place in
            [[4.0, 1.0, 1.5], [4.0, 4.0, 1.0], [0.0, 4.0, 2.0], [1.0, 2.0, 2.0], [1.0, 2.0, 1.0]]
        {
            let place = Vector3::from(place);
            rig.stream = Some(map * place);
            rig.run(9.0);
            assert!(rig.is_near(&place, 0.15), "{place} {:?}", rig.drone().body());
        }
        rig.stream = None;
        assert_eq!(rig.set_mode(Mode::Land), ACCEPTED);
        assert!(rig.run_until(12.0, |rig| !rig.drone().is_armed()));
        assert!(rig.is_near(&Vector3::new(1.0, 2.0, 0.0), 0.2));
        assert!(rig.events.contains(&Event::Landed) && rig.world.num_contacts() == 0);
    }
}

/// 20 % loss and 150 ms each way: within 30 cm when the autopilot knows the delay.
#[test]
fn a_known_delay_does_no_harm() {
    let faults = LinkFaults { loss: 0.2, delay: 150 * MS, ..LinkFaults::default() };
    for seed in 0..4 {
        let mut options = DroneOptions { seed, ..ardupilot() };
        options.parameters = vec![("VISO_DELAY_MS".into(), 170.0)];
        let poses = PoseOptions { delay: Duration::ZERO, ..PoseOptions::default() };
        let mut rig = Rig::with(options, LinkFaults::default(), poses.clone()).take_off();
        // The link gets worse in the air, so that no command of the start is lost.
        rig = rig.with_faults(faults.clone(), seed);
        for place in [[3.0, 2.0, 1.5], [1.0, 4.0, 1.2]].map(Vector3::from) {
            rig.stream = Some(place);
            rig.run(9.0);
            let mut worst: f64 = 0.0;
            rig.run_until(5.0, |rig| {
                worst = worst.max((rig.drone().body().position.coords - place).norm());
                false
            });
            assert!(worst < 0.30, "{worst} at {place}");
        }
    }
}

/// Without origin or poses nothing arms, and an origin that comes too early is lost.
#[test]
fn arming_needs_origin_and_poses() {
    let mut rig = Rig::new(DroneOptions { warm_up: Duration::ZERO, ..ardupilot() });
    rig.run(1.0);
    rig.set_origin(100_000);
    rig.run(1.0);
    let heard = |rig: &Rig| rig.inbox.iter().any(|m| matches!(m, MavMessage::GPS_GLOBAL_ORIGIN(_)));
    assert!(!heard(&rig));
    assert_eq!((rig.set_mode(Mode::Guided), rig.arm(true)), (ACCEPTED, FAILED));
    rig.run(3.0);
    rig.set_origin(100_000);
    rig.run(1.0);
    assert!(heard(&rig));
    rig.run(5.0);
    assert_eq!(rig.arm(true), FAILED, "its sensors settle");
    rig.run(10.0);
    rig.poses.fail(rig.now..Duration::MAX, PoseFault::Stop);
    rig.run(1.0);
    assert_eq!(rig.arm(true), FAILED, "poses are old");
}

/// Poses before the origin count their height twice, as seen on the real firmware.
#[test]
fn origin_comes_first() {
    let mut options = ardupilot();
    options.start.z = 0.0;
    let mut rig = Rig::new(options);
    rig.poses.fail(Duration::ZERO..Duration::MAX, PoseFault::Jump(Vector3::z()));
    rig.run(1.0);
    rig.set_origin(100_000);
    rig.run(2.0);
    let z = rig.drone().estimator().position().z;
    assert!((z + 2.0).abs() < 0.1, "{z}");
}

/// LAND 8 s after the last pose (ArduPilot), after 5 s (PX4); 2 s and 5 s after the last heartbeat;
/// 1 s after the last setpoint (PX4). All of them come down softly.
#[test]
fn drones_land_when_they_are_left_alone() {
    let land = |rig: &Rig| rig.drone().mode() == Mode::Land;
    for (options, wait) in [(ardupilot(), 8.0), (px4(), 5.0)] {
        let mut rig = Rig::new(options).take_off();
        rig.poses.fail(rig.now..Duration::MAX, PoseFault::Stop);
        assert!(!rig.run_until(wait - 0.1, land));
        assert!(rig.run_until(0.3, land), "vision");
        assert!(rig.run_until(12.0, |rig| !rig.drone().is_armed()) && !rig.drone().has_crashed());
    }
    for (options, wait) in [(ardupilot(), 2.0), (px4(), 5.0)] {
        let mut rig = Rig::new(options).take_off();
        rig.heartbeat = false;
        // The last heartbeat is up to a quarter of a second old.
        assert!(!rig.run_until(wait - 0.3, land));
        assert!(rig.run_until(0.4, land), "ground station");
        assert_eq!(rig.drone().failsafe(), Some("ground station lost"));
    }
    let mut rig = Rig::new(px4()).take_off();
    rig.stream = None;
    assert!(!rig.run_until(0.85, land) && rig.run_until(0.3, land), "offboard");
    let mut rig = Rig::new(ardupilot()).take_off();
    rig.run(5.0);
    assert_eq!(rig.drone().mode(), Mode::Guided, "ArduPilot keeps its target");
}

#[test]
fn a_flat_battery_brings_it_down() {
    let mut rig = Rig::new(ardupilot()).take_off();
    rig.world.drones[0].set_battery(10.5);
    let land = |rig: &Rig| rig.drone().mode() == Mode::Land;
    assert!(rig.run_until(8.0, land) && rig.drone().failsafe() == Some("battery critical"));
    let mut rig = Rig::new(DroneOptions { battery: 15.0, ..ardupilot() });
    rig.set_origin(100_000);
    rig.run(3.0);
    assert_eq!((rig.set_mode(Mode::Guided), rig.arm(true)), (ACCEPTED, FAILED));
}

/// ArduPilot follows a jump of 1 m at once, PX4 after a second, or at once with a new counter.
#[test]
fn jumps_are_followed_as_the_families_do() {
    let jump = PoseFault::Jump(Vector3::x());
    let moved = |rig: &Rig| 1.0 - rig.drone().body().position.x;
    let mut rig = Rig::new(ardupilot()).take_off();
    rig.go_to(Vector3::new(1.0, 2.0, 1.2));
    rig.run(3.0);
    rig.poses.fail(rig.now..Duration::MAX, jump);
    rig.run(6.0);
    assert!((moved(&rig) - 1.0).abs() < 0.15, "{}", moved(&rig));
    for (counter, wait) in [(0, 1.0), (1, 0.0)] {
        let mut rig = Rig::new(px4()).take_off();
        rig.run(2.0);
        let before = rig.drone().estimator().position().x;
        rig.poses.fail(rig.now..Duration::MAX, jump);
        // The first pose of the new frame carries the new counter.
        rig.run(0.05);
        rig.reset_counter = counter;
        let jumped = |rig: &Rig| rig.drone().estimator().position().x - before > 0.7;
        assert!(!rig.run_until(wait, jumped));
        assert!(rig.run_until(0.25, jumped), "{counter}");
    }
}

#[test]
fn pause_stops_and_goes_on_and_velocity_ends() {
    let mut rig = Rig::new(ardupilot()).take_off();
    rig.go_to(Vector3::new(7.0, 2.0, 1.2));
    rig.run(3.0);
    let at = rig.drone().body().position.x;
    assert_eq!(rig.command(MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, &[0.0]), ACCEPTED);
    rig.run(4.0);
    let stopped = rig.drone().body().position.x;
    assert!(stopped - at < 0.9 && rig.drone().body().velocity.norm() < 0.15, "{at} {stopped}");
    assert_eq!(rig.command(MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, &[1.0]), ACCEPTED);
    rig.run(10.0);
    assert!(rig.is_near(&Vector3::new(7.0, 2.0, 1.2), 0.15));
    rig.set_target(Vector3::new(-0.5, 0.0, 0.0), VELOCITY, MavFrame::MAV_FRAME_LOCAL_NED, 0.0);
    rig.run(8.0);
    let flown = 7.0 - rig.drone().body().position.x;
    assert!((1.2..2.0).contains(&flown), "{flown} in 3 s of 0.5 m/s");
}

#[test]
fn yaw_is_in_the_setpoint_or_along_the_path() {
    let mut rig = Rig::new(ardupilot()).take_off();
    let ned = MavFrame::MAV_FRAME_LOCAL_NED;
    rig.set_target(Vector3::new(1.0, 2.0, 1.2), POSITION_YAW, ned, FRAC_PI_2);
    rig.run(5.0);
    assert!((rig.drone().body().yaw - FRAC_PI_2).abs() < 0.05);
    let mut options = ardupilot();
    options.parameters = vec![("WP_YAW_BEHAVIOR".into(), 2.0)];
    let mut rig = Rig::new(options).take_off();
    rig.go_to(Vector3::new(1.0, 6.0, 1.2));
    rig.run(4.0);
    assert!((rig.drone().body().yaw - FRAC_PI_2).abs() < 0.2);
}

/// What the real firmware was seen to do with bad targets.
#[test]
fn bad_targets() {
    let mut rig = Rig::new(ardupilot()).take_off();
    let far = Vector3::new(9.0, 9.0, 1.2);
    let global = MavFrame::MAV_FRAME_LOCAL_ENU;
    for (mask, frame) in [(POSITION, global), (0x0fff, MavFrame::MAV_FRAME_LOCAL_NED)] {
        rig.set_target(far, mask, frame, 0.0);
        rig.run(2.0);
        assert!(rig.is_near(&Vector3::new(1.0, 2.0, 1.2), 0.25));
    }
    rig.go_to(Vector3::new(f64::NAN, 0.0, 1.0));
    rig.run(2.0);
    assert!(rig.events.contains(&Event::Halted) && rig.drone().has_crashed());
    let mut rig = Rig::new(px4()).take_off();
    rig.go_to(Vector3::new(f64::NAN, 0.0, 1.0));
    rig.run(2.0);
    assert!(!rig.drone().has_crashed() && rig.drone().is_flying());
}

#[test]
fn arming_and_modes_have_their_rules() {
    let mut rig = Rig::new(ardupilot()).take_off();
    assert_eq!(rig.arm(false), FAILED, "in the air");
    let climb = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.2];
    assert_eq!(rig.command(MavCmd::MAV_CMD_NAV_TAKEOFF, &climb), FAILED, "a repeat in flight");
    assert_eq!(rig.set_mode(Mode::Loiter), ACCEPTED);
    rig.run(3.0);
    assert!(rig.drone().has_crashed(), "without a pilot LOITER sinks");
    let mut rig = Rig::new(px4());
    rig.run(3.0);
    assert_eq!(rig.set_mode(Mode::Guided), Some(MavResult::MAV_RESULT_TEMPORARILY_REJECTED));
    let mut rig = Rig::new(ardupilot());
    rig.set_origin(100_000);
    rig.run(3.0);
    assert_eq!((rig.set_mode(Mode::Guided), rig.arm(true)), (ACCEPTED, ACCEPTED));
    rig.go_to(Vector3::new(1.0, 2.0, 1.2));
    rig.run(5.0);
    assert!(!rig.drone().is_flying(), "a target on the ground does nothing");
    rig.run(5.5);
    assert!(!rig.drone().is_armed(), "DISARM_DELAY");
}

#[test]
fn telemetry_comes_when_it_is_asked_for() {
    let mut rig = Rig::new(ardupilot());
    rig.run(3.0);
    assert!(rig.inbox.iter().all(|m| matches!(m, MavMessage::HEARTBEAT(_))));
    let interval = MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL;
    assert_eq!(rig.command(interval, &[32.0, 100_000.0]), ACCEPTED);
    assert_eq!(rig.command(interval, &[9999.0, 1.0]), Some(MavResult::MAV_RESULT_DENIED));
    assert_eq!(rig.command(MavCmd::MAV_CMD_REQUEST_MESSAGE, &[148.0]), ACCEPTED);
    rig.inbox.clear();
    rig.send(&MavMessage::TIMESYNC(TIMESYNC_DATA { ts1: 12345, ..TIMESYNC_DATA::DEFAULT }));
    rig.run(2.0);
    let positions = rig.inbox.iter().filter(|m| matches!(m, MavMessage::LOCAL_POSITION_NED(_)));
    assert!((19..=21).contains(&positions.count()));
    assert!(
        rig.inbox
            .iter()
            .any(|m| matches!(m, MavMessage::TIMESYNC(t) if t.ts1 == 12345 && t.tc1 > 0))
    );
    rig.inbox.clear();
    rig.send(&MavMessage::PARAM_REQUEST_LIST(PARAM_REQUEST_LIST_DATA {
        target_system: 7,
        target_component: 1,
    }));
    rig.run(1.0);
    let names: std::collections::BTreeSet<_> = rig
        .inbox
        .iter()
        .filter_map(|m| match m {
            MavMessage::PARAM_VALUE(p) => {
                Some((p.param_id.to_str().unwrap().to_owned(), p.param_count))
            }
            _ => None,
        })
        .collect();
    assert!(names.iter().all(|(_, count)| usize::from(*count) == names.len()) && names.len() > 20);
}

/// Equal seeds give equal flights, other seeds others.
#[test]
fn flights_repeat() {
    let fly = |seed| {
        let mut rig = Rig::new(DroneOptions { seed, ..ardupilot() }).take_off();
        rig.go_to(Vector3::new(2.0, 3.0, 1.5));
        rig.run(5.0);
        rig.drone().body().clone()
    };
    assert_eq!(fly(1), fly(1));
    assert_ne!(fly(1), fly(2));
}
