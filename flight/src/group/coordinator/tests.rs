mod world;

use std::collections::BTreeSet;

use super::*;
use crate::group::deconflict;
use world::*;

/// Ten crossing vehicles arrive, keep apart by the required meter, and fly the plan within 0.2 m.
#[test]
fn ten_crossing_vehicles_fly_their_plan() {
    for ceiling in [6.0, 2.6] {
        let (tasks, options) = (crossing(), options(ceiling));
        let (mut flight, mut world) = started(&tasks, &options);
        let mut worst = 0f64;
        while !flight.state().is_over() && world.now < 120.0 {
            world.step(&mut flight);
            for (id, vehicle) in &world.vehicles {
                let planned = flight.plan().ways[id].sample(flight.clock()).position;
                worst = worst.max((vehicle.position - planned).norm());
            }
        }
        assert_eq!(flight.state(), FlightState::Finished);
        assert!(tasks.iter().all(|task| world.distance_to_goal(task) <= 0.25));
        assert!(world.closest >= 1.0, "{}", world.closest);
        assert!(worst <= 0.2, "{worst}");
        assert_eq!(world.when(|e| matches!(e, FlightEvent::Held { .. })), None, "no false alarm");
        assert_eq!(world.when(|e| matches!(e, FlightEvent::ClockHeld { .. })), None);
        assert!(world.now < flight.plan().duration().as_secs_f64() + 4.0, "{}", world.now);
    }
}

/// One slow vehicle holds the clock of all; they meet no more than before, and arrive later.
#[test]
fn one_that_lags_holds_the_clock_of_all() {
    let (tasks, options) = (crossing(), options(6.0));
    let (mut flight, mut world) = started(&tasks, &options);
    let slow = VehicleId(4);
    world.vehicles.get_mut(&slow).unwrap().top_speed = 0.25;
    let mut farthest = 0f64;
    while !flight.state().is_over() && world.now < 300.0 {
        world.step(&mut flight);
        let planned = flight.plan().ways[&slow].sample(flight.clock()).position;
        farthest = farthest.max((world.vehicles[&slow].position - planned).norm());
    }
    assert_eq!(flight.state(), FlightState::Finished);
    assert!(world.closest >= 1.0, "{}", world.closest);
    let held = world.when(|e| *e == FlightEvent::ClockHeld { vehicle: slow });
    assert!(held.is_some_and(|at| at < 30.0), "{held:?}");
    assert!((0.2..0.5).contains(&farthest), "{farthest}");
    assert!(world.now > flight.plan().duration().as_secs_f64() + 10.0);
    let lost = world.when(|e| matches!(e, FlightEvent::TakenOut { .. }));
    assert_eq!(lost, None, "to lag is no fault");
}

/// One that does not move at all stops everybody, until it does.
#[test]
fn one_that_is_stuck_stops_everybody() {
    let (tasks, options) = (crossing(), options(6.0));
    let (mut flight, mut world) = started(&tasks, &options);
    let stuck = VehicleId(5);
    world.vehicles.get_mut(&stuck).unwrap().top_speed = 0.0;
    world.fly(&mut flight, 20.0);
    let clock = flight.clock();
    assert_eq!(flight.clock_held_by(), Some(stuck));
    world.fly(&mut flight, 10.0);
    assert!(flight.clock() - clock < Duration::from_millis(100), "{:?}", flight.clock());
    world.vehicles.get_mut(&stuck).unwrap().top_speed = 1.5;
    world.fly(&mut flight, 120.0);
    assert_eq!(flight.state(), FlightState::Finished);
    assert!(world.closest >= 1.0, "{}", world.closest);
}

/// A vehicle whose camera dies holds, lands and is out; the other nine arrive and nobody comes
/// near anybody, whenever it happens.
#[test]
fn one_with_a_dead_camera_lands_and_the_others_arrive() {
    for (ceiling, dead, at) in [(6.0, 1, 3.0), (6.0, 7, 9.0), (2.6, 2, 12.0), (6.0, 10, 16.0)] {
        let (tasks, options) = (crossing(), options(ceiling));
        let (mut flight, mut world) = started(&tasks, &options);
        let dead = VehicleId(dead);
        world.fly(&mut flight, at);
        world.vehicles.get_mut(&dead).unwrap().verdict = Verdict::Hold(Reason::PoseStale);
        world.fly(&mut flight, 1.0);
        let held = FlightEvent::Held { vehicle: dead, reason: Reason::PoseStale };
        assert!(world.when(|e| *e == held).is_some_and(|held| held <= at + 0.1 + STEP));
        world.vehicles.get_mut(&dead).unwrap().verdict = Verdict::Land(Reason::PoseStale);
        world.fly(&mut flight, 200.0);
        let told = world.events.iter().filter(|(_, e)| !matches!(e, FlightEvent::Leg { .. }));
        assert_eq!(flight.state(), FlightState::Finished, "{:?}", told.collect::<Vec<_>>());
        assert_eq!(flight.taken_out().collect::<Vec<_>>(), [dead]);
        assert!(!world.vehicles[&dead].airborne);
        for task in tasks.iter().filter(|task| task.vehicle != dead) {
            assert!(world.distance_to_goal(task) <= 0.25, "{} at {at}", task.vehicle.0);
        }
        assert!(world.closest >= 1.0, "{} at {at}", world.closest);
    }
}

/// One that lands where another would come through low is flown around.
#[test]
fn the_landed_are_flown_around() {
    let options = options(2.2);
    let tasks = [
        task(1, Point3::new(0.0, -2.0, 0.6), Point3::new(0.0, 2.0, 0.6)),
        task(2, Point3::new(-6.0, 0.5, 0.6), Point3::new(6.0, 0.5, 0.6)),
    ];
    let (mut flight, mut world) = started(&tasks, &options);
    // It lands when it crosses the other's way.
    while world.vehicles[&VehicleId(1)].position.y < 0.3 {
        world.step(&mut flight);
    }
    world.vehicles.get_mut(&VehicleId(1)).unwrap().verdict = Verdict::Land(Reason::BatteryLow);
    world.fly(&mut flight, 100.0);
    assert!(world.when(|e| *e == FlightEvent::Replanned).is_some(), "{:?}", world.events);
    assert_eq!(flight.state(), FlightState::Finished);
    assert!(world.distance_to_goal(&tasks[1]) <= 0.25);
    assert!(world.closest >= 0.9, "{}", world.closest);
}

/// A stranger that flies through is not met: members hold and go on when it has passed.
#[test]
fn members_hold_for_a_stranger() {
    let options = options(4.0);
    let tasks = [task(1, Point3::new(-5.0, 0.0, 1.5), Point3::new(5.0, 0.0, 1.5))];
    let (mut flight, mut world) = started(&tasks, &options);
    let stranger = Vehicle {
        position: Point3::new(0.0, -6.0, 1.5),
        velocity: Vector3::new(0.0, 0.9, 0.0),
        ..world.vehicles[&VehicleId(1)]
    };
    world.vehicles.insert(VehicleId(99), stranger);
    world.fly(&mut flight, 60.0);
    assert!(
        world.when(|e| matches!(e, FlightEvent::Held { reason: Reason::TooClose, .. })).is_some()
    );
    assert!(world.when(|e| matches!(e, FlightEvent::Released { .. })).is_some());
    assert_eq!(flight.state(), FlightState::Finished);
    assert!(world.closest >= 0.9, "{}", world.closest);
}

/// Paused, everybody comes to rest and the clock stands; resumed, everybody arrives.
#[test]
fn a_pause_stops_everybody_and_ends() {
    let (tasks, options) = (crossing(), options(6.0));
    let (mut flight, mut world) = started(&tasks, &options);
    world.fly(&mut flight, 8.0);
    assert!(flight.pause() && !flight.pause());
    world.fly(&mut flight, 3.0);
    let clock = flight.clock();
    world.fly(&mut flight, 5.0);
    assert_eq!(flight.clock(), clock);
    assert!(world.vehicles.values().all(|v| v.velocity.norm() < 0.01));
    assert!(flight.resume());
    world.fly(&mut flight, 120.0);
    assert_eq!(flight.state(), FlightState::Finished);
    assert!(world.closest >= 1.0, "{}", world.closest);
    assert!(!flight.abort() && !flight.resume(), "over is over");
}

/// Aborted in the middle, everybody whose column is free lands, nobody on another.
#[test]
fn an_abort_lands_without_contact() {
    for at in [2.0, 6.0, 10.0, 14.0] {
        let (tasks, options) = (crossing(), options(6.0));
        let (mut flight, mut world) = started(&tasks, &options);
        world.fly(&mut flight, at);
        assert!(flight.abort());
        for _ in 0..600 {
            world.step(&mut flight);
        }
        assert!(world.closest >= 0.9, "{} at {at}", world.closest);
        let down = world.vehicles.values().filter(|v| !v.airborne).count();
        assert!(down >= 5, "{down}");
        assert!(world.vehicles.values().all(|v| v.velocity.norm() < 0.01));
    }
}

/// Setpoints never leap, whatever happens, also after a stall of the caller.
#[test]
fn setpoints_do_not_leap() {
    let (tasks, options) = (crossing(), options(6.0));
    let (mut flight, mut world) = started(&tasks, &options);
    let mut before: BTreeMap<VehicleId, Point3<f64>> = BTreeMap::new();
    for k in 0..400 {
        if k == 150 {
            world.now += 30.0;
        }
        if k % 60 == 0 {
            flight.pause();
        } else if k % 60 == 25 {
            flight.resume();
        }
        world.step(&mut flight);
        for (id, vehicle) in &world.vehicles {
            if let Some(Order::Fly(setpoint)) = vehicle.order {
                let last = before.insert(*id, setpoint.position).unwrap_or(setpoint.position);
                // A quarter of a second at full speed, level and vertical.
                assert!((setpoint.position - last).norm() <= 0.25 * 1.12 + 1e-9);
            }
        }
    }
}

/// Nothing starts that is not ready, and before the start nobody is ordered anything.
#[test]
fn the_start_is_refused_until_all_are_ready() {
    let options = options(4.0);
    let tasks = [
        task(1, Point3::new(-3.0, 0.0, 1.5), Point3::new(3.0, 0.0, 1.5)),
        task(2, Point3::new(-3.0, 3.0, 1.5), Point3::new(3.0, 3.0, 1.5)),
    ];
    let plan = deconflict(&tasks, &options.rules, &options.how).unwrap();
    let mut flight = Coordinator::new(plan, tasks.to_vec(), options).unwrap();
    let refused = |flight: &mut Coordinator, change: fn(&mut Vehicle)| {
        let mut world = World::new(&tasks);
        change(world.vehicles.get_mut(&VehicleId(2)).unwrap());
        flight.start(Duration::ZERO, &world.seen()).unwrap_err()
    };
    let astray = refused(&mut flight, |v| v.position.x += 0.4);
    assert!(matches!(astray, StartRefused::Starts(found) if found.len() == 1));
    let grounded = refused(&mut flight, |v| v.airborne = false);
    assert_eq!(grounded, StartRefused::NotAirborne { vehicle: VehicleId(2) });
    let unfit = refused(&mut flight, |v| v.verdict = Verdict::Hold(Reason::PoseStale));
    assert!(matches!(unfit, StartRefused::Unfit { reason: Reason::PoseStale, .. }));
    let mut world = World::new(&tasks);
    let mut one = world.seen();
    one.remove(&VehicleId(1));
    assert!(matches!(flight.start(Duration::ZERO, &one), Err(StartRefused::Starts(_))));

    world.step(&mut flight);
    assert!(world.vehicles.values().all(|v| v.order.is_none()));
    flight.start(Duration::from_secs(2), &world.seen()).unwrap();
    world.fly(&mut flight, 1.5);
    assert_eq!(flight.state(), FlightState::Ready, "not before the agreed time");
    world.fly(&mut flight, 60.0);
    assert_eq!(flight.state(), FlightState::Finished);
    let again = flight.start(Duration::ZERO, &world.seen());
    assert_eq!(again, Err(StartRefused::State { state: FlightState::Finished }));
}

/// A plan that breaks a rule never becomes a flight.
#[test]
fn a_bad_plan_is_no_flight() {
    let options = options(4.0);
    let tasks = crossing();
    let plan = deconflict(&tasks, &options.rules, &options.how).unwrap();
    let mut strict = options.clone();
    strict.rules.separation.distance = 3.0;
    let refused = Coordinator::new(plan, tasks, strict).unwrap_err();
    assert!(refused.iter().all(|violation| violation.code() == "too_close"));
}

/// Events tell each leg of each vehicle once, in order (P87).
#[test]
fn every_leg_is_told_once() {
    let (tasks, options) = (crossing(), options(6.0));
    let (mut flight, mut world) = started(&tasks, &options);
    world.fly(&mut flight, 120.0);
    for task in &tasks {
        let told: Vec<usize> = world
            .events
            .iter()
            .filter_map(|(_, event)| match event {
                FlightEvent::Leg { vehicle, index, .. } if *vehicle == task.vehicle => Some(*index),
                _ => None,
            })
            .collect();
        let legs = flight.plan().ways[&task.vehicle].legs().count();
        assert_eq!(told, (0..legs).collect::<Vec<_>>());
        let distinct: BTreeSet<_> = told.iter().collect();
        assert_eq!(distinct.len(), told.len());
    }
}
