//! What a vehicle does when its poses, its pilot or its link fail, in simulated time.

mod rig;

use std::time::Duration;

use nalgebra::{Point3, Vector3};
use rig::{Conditions, Rig};
use volery_flight::{
    Alert, Command, Happening, Setpoint, VehicleId,
    watchdog::{Reason, Verdict},
};
use volery_simulator::{Flavor, Mode, PoseFault};

const FOREVER: Duration = Duration::from_secs(10_000);
const FLAVORS: [Flavor; 2] = [Flavor::ArduPilot, Flavor::Px4];

/// When an alert first came.
fn alerted(rig: &Rig, wanted: Alert) -> Option<Duration> {
    let happening = Happening::Alert(wanted);
    rig.events.iter().find(|(_, event)| event.happening == happening).map(|(at, _)| *at)
}

/// A vehicle in flight towards a place far ahead.
fn under_way(flavor: Flavor, seed: u64) -> Rig {
    let mut rig = Rig::new(1, &Conditions { flavor, seed, ..Conditions::default() });
    rig.take_off();
    rig.go(1, Point3::new(8.0, 0.0, 1.5), 0.3);
    rig.run(2.0);
    rig
}

/// Holds within 0.6 s of the last frame, lands after 1.5 s, and nothing breaks.
#[test]
fn without_poses_a_vehicle_holds_and_then_lands() {
    for flavor in FLAVORS {
        for seed in 1..=5 {
            let mut rig = under_way(flavor, seed);
            let start = rig.now;
            rig.sources[0].fail(start..FOREVER, PoseFault::Stop);
            assert!(rig.run_until(20.0, |rig| !rig.world.drones[0].is_armed()));
            let held = alerted(&rig, Alert::Holds(Reason::PoseStale)).unwrap() - start;
            let landed = alerted(&rig, Alert::Lands(Reason::PoseStale)).unwrap() - start;
            assert!(held <= Duration::from_millis(600), "{held:?}");
            assert!(landed <= Duration::from_millis(1600), "{landed:?}");
            assert_eq!(rig.world.num_contacts(), 0, "{:?}", rig.world.events());
        }
    }
}

/// A jump that stays is never followed: the vehicle lands where it truly is.
#[test]
fn a_jump_is_not_followed() {
    for flavor in FLAVORS {
        for (seed, distance) in [1.2, 2.0, 4.0, 20.0].into_iter().enumerate() {
            let mut rig = under_way(flavor, seed as u64);
            let start = rig.now;
            let step = Vector3::new(0.0, distance, 0.0);
            rig.sources[0].fail(start..FOREVER, PoseFault::Jump(step));
            let before = rig.refusals.len();
            rig.run(4.0);
            assert!(rig.world.drones[0].is_flying());
            assert!(rig.refusals.len() > before);
            // Frames taken before the fault may still be on their way.
            let last = rig.fleet.vehicle(VehicleId(1)).unwrap().last_pose().unwrap();
            assert!(last.captured <= start, "{distance} m was passed on");
            let side = rig.world.drones[0].body().position.y.abs();
            assert!(side < 0.5, "{flavor:?} {distance}: {side}");
            assert_eq!(rig.world.num_contacts(), 0);
        }
    }
}

/// The mirror place: right where it should be, looking the other way.
#[test]
fn a_flipped_yaw_is_not_followed() {
    for flavor in FLAVORS {
        let mut rig = under_way(flavor, 3);
        let start = rig.now;
        rig.sources[0].fail(start..FOREVER, PoseFault::Turn(std::f64::consts::PI));
        rig.run(4.0);
        assert!(rig.world.drones[0].is_flying());
        let last = rig.fleet.vehicle(VehicleId(1)).unwrap().last_pose().unwrap();
        assert!(last.captured <= start, "{:#?}", rig.tail());
        assert_eq!(rig.world.num_contacts(), 0);
    }
}

/// A short outage ends in a hold, from which the vehicle can be flown on.
#[test]
fn after_a_short_outage_the_flight_goes_on() {
    for flavor in FLAVORS {
        let mut rig = under_way(flavor, 4);
        let start = rig.now;
        rig.sources[0].fail(start..start + Duration::from_millis(900), PoseFault::Stop);
        rig.run(5.0);
        assert!(alerted(&rig, Alert::Holds(Reason::PoseStale)).is_some());
        assert_eq!(alerted(&rig, Alert::Lands(Reason::PoseStale)), None, "{:#?}", rig.tail());
        let goal = Point3::new(0.0, 0.0, 1.5);
        let command = rig.go(1, goal, 0.0);
        rig.finish(&[command], 40.0);
        rig.run(2.0);
        assert!(rig.error(1, &goal) < 0.15);
    }
}

/// Whoever promised to be there and is not any more leaves a vehicle that stands still.
#[test]
fn a_lapsed_lease_holds() {
    let mut rig = under_way(Flavor::ArduPilot, 5);
    let end = rig.now + Duration::from_millis(500);
    rig.fleet.lease(VehicleId(1), Some(end));
    rig.run(4.0);
    let held = alerted(&rig, Alert::Holds(Reason::LeaseOver)).unwrap();
    assert!(held >= end && held <= end + Duration::from_millis(100), "{held:?} {end:?}");
    assert!(rig.world.drones[0].body().velocity.norm() < 0.2);
    let command = Command::Go {
        setpoint: Setpoint::at(Point3::new(0.0, 0.0, 1.5), 0.0),
        tolerance: 0.2,
        timeout: Duration::from_secs(9),
    };
    let plan = Setpoint::at(Point3::new(5.0, 0.0, 1.5), 0.0);
    assert!(rig.fleet.steer(VehicleId(1), plan, rig.now).is_err(), "a plan is nobody");
    assert!(
        rig.fleet.command(VehicleId(1), &command, rig.now).is_ok(),
        "whoever commands is there"
    );
    rig.run(2.0);
    assert!(rig.fleet.vehicle(VehicleId(1)).unwrap().verdict() == Verdict::Continue);
}

/// A vehicle whose pilot does not come back lands; on the ground a lapsed lease means nothing.
#[test]
fn a_vehicle_without_a_pilot_lands() {
    let mut rig = under_way(Flavor::Px4, 5);
    let end = rig.now + Duration::from_millis(500);
    rig.fleet.lease(VehicleId(1), Some(end));
    assert!(rig.run_until(60.0, |rig| !rig.world.drones[0].is_armed()));
    let landed = alerted(&rig, Alert::Lands(Reason::LeaseOver)).unwrap();
    assert!(landed >= end + Duration::from_secs(30), "{landed:?} {end:?}");
    rig.run(1.0);
    rig.take_off();
    rig.run(2.0);
    assert!(rig.fleet.vehicle(VehicleId(1)).unwrap().verdict() == Verdict::Continue);
}

/// A plan that is not renewed ends in a hold, not in a flight to its last point.
#[test]
fn a_plan_that_stops_holds() {
    let mut rig = under_way(Flavor::Px4, 6);
    for step in 0..20 {
        let setpoint = Setpoint {
            position: Point3::new(3.0 + 0.05 * f64::from(step), 0.0, 1.5),
            velocity: Vector3::x() * 0.5,
            yaw: 0.3,
        };
        rig.fleet.steer(VehicleId(1), setpoint, rig.now).unwrap();
        rig.run(0.1);
    }
    rig.run(3.0);
    let velocity = rig.world.drones[0].body().velocity;
    assert!(velocity.norm() < 0.2, "{velocity:?}");
}

/// All vehicles in flight stop; a vehicle on the ground loses its motors.
#[test]
fn all_stop_stops_all() {
    for flavor in FLAVORS {
        let mut rig = Rig::new(3, &Conditions { flavor, ..Conditions::default() });
        rig.take_off();
        for id in 1..=3 {
            let y = 1.5 * f64::from(id - 1);
            rig.go(id, Point3::new(8.0, y, 1.5), 0.0);
        }
        rig.run(2.0);
        let before: Vec<_> = rig.world.drones.iter().map(|d| d.body().position).collect();
        assert_eq!(rig.fleet.all_stop(rig.now).len(), 3);
        rig.run(4.0);
        for (drone, before) in rig.world.drones.iter().zip(before) {
            assert!(drone.body().velocity.norm() < 0.2);
            assert!((drone.body().position - before).norm() < 1.5);
            assert_eq!(drone.mode(), Mode::Guided);
        }
    }
}

/// The failsafe of a vehicle is left alone: no setpoint, no change back.
#[test]
fn a_vehicle_that_lands_by_itself_is_left_alone() {
    let mut rig = under_way(Flavor::ArduPilot, 7);
    // Its battery is at its end.
    let options = rig.world.drones[0].options().clone();
    assert!(options.battery > 50.0);
    rig.fleet.command(VehicleId(1), &Command::Land, rig.now).unwrap();
    assert!(rig.run_until(20.0, |rig| !rig.world.drones[0].is_armed()));
    assert!(rig.fleet.vehicle(VehicleId(1)).unwrap().setpoint().is_none());
    rig.run(3.0);
    assert_eq!(rig.world.drones[0].mode(), Mode::Land);
}
