//! Ten simulated drones fly as a group over MAVLink: plan, check, flight, in simulated time.
//!
//! The drones know where they are only from the poses they are sent. Distances are true ones.

mod rig;

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::time::Duration;

use nalgebra::Point3;
use rig::{Conditions, Rig};
use volery_flight::VehicleId;
use volery_flight::group::{
    Conductor, Coordinator, Deconfliction, FlightEvent, FlightOptions, FlightState, Geofence,
    Rules, Separation, Task, deconflict,
};
use volery_flight::motion::{Goal, MotionLimits, Waypoint};
use volery_simulator::{Drone, Flavor, PoseFault};

fn hall(tasks: &[Task], flavor: Flavor) -> Rig {
    let ground = |task: &Task| Point3::new(task.start.position.x, task.start.position.y, 0.0);
    let conditions = Conditions { flavor, key: Some([7; 32]), ..Conditions::default() };
    Rig::at(tasks.iter().map(ground).collect(), &conditions)
}

fn true_places(hall: &Rig) -> BTreeMap<VehicleId, Point3<f64>> {
    let drones = hall.world.drones.iter();
    drones.map(|drone| (VehicleId(drone.options().system_id), drone.body().position)).collect()
}

/// What a flight came to.
struct Outcome {
    state: FlightState,
    events: Vec<(Duration, FlightEvent)>,
    /// Largest true distance of a flying vehicle from its place on the plan, and from its way
    /// near that place: behind its time, and beside its way.
    behind: f64,
    beside: f64,
    seconds: f64,
}

impl Outcome {
    fn when(&self, wanted: impl Fn(&FlightEvent) -> bool) -> Option<Duration> {
        self.events.iter().find(|(_, event)| wanted(event)).map(|(at, _)| *at)
    }
}

/// Ten on a circle of 5 m, everybody to the place opposite.
fn crossing() -> Vec<Task> {
    let place = |k: u8| {
        let (sin, cos) = (TAU * f64::from(k) / 10.0).sin_cos();
        Point3::new(5.0 * cos, 5.0 * sin, 1.3)
    };
    let task = |k: u8| Task {
        vehicle: VehicleId(k + 1),
        start: Waypoint { position: place(k), yaw: 0.0 },
        goals: vec![Goal { position: place((k + 5) % 10), yaw: None }],
    };
    (0..10).map(task).collect()
}

fn options() -> FlightOptions {
    let low = Point3::new(-8.0, -8.0, 0.0);
    let rules = Rules {
        limits: MotionLimits::default(),
        separation: Separation::default(),
        geofence: Geofence::around(&low, &Point3::new(8.0, 8.0, 6.0), 0.5).unwrap(),
        air: None,
        others: Default::default(),
        start_tolerance: 0.3,
        metric_map: true,
    };
    FlightOptions::new(rules, Deconfliction::default())
}

/// Connects, takes off, flies the plan to its end. `meddle` may change the world before each step.
fn fly(hall: &mut Rig, tasks: &[Task], mut meddle: impl FnMut(&mut Rig, Duration)) -> Outcome {
    let options = options();
    let plan = deconflict(tasks, &options.rules, &options.how).unwrap();
    let mut flight =
        Conductor::new(Coordinator::new(plan, tasks.to_vec(), options.clone()).unwrap());
    // Estimators take a while; a start is refused until they are ready.
    while flight.begin(&mut hall.fleet, hall.now).is_err() {
        assert!(hall.now < Duration::from_secs(60), "nobody gets ready");
        hall.step();
    }
    let (mut events, mut behind, mut beside, mut started) = (Vec::new(), 0f64, 0f64, None);
    while !flight.coordinator().state().is_over() && hall.now < Duration::from_secs(300) {
        let since_start = hall.now.saturating_sub(started.unwrap_or(hall.now));
        meddle(hall, since_start);
        let is_ready = flight.coordinator().state() == FlightState::Ready;
        assert!(!is_ready || flight.is_begun(), "who polls what has begun would forget it");
        hall.step();
        let now = hall.now;
        events.extend(flight.poll(&mut hall.fleet, now).into_iter().map(|event| (now, event)));
        let coordinator = flight.coordinator();
        if coordinator.state() != FlightState::Running {
            continue;
        }
        started.get_or_insert(now);
        let out: Vec<VehicleId> = coordinator.taken_out().collect();
        for (id, place) in true_places(hall).into_iter().filter(|(id, _)| !out.contains(id)) {
            let way = &coordinator.plan().ways[&id];
            let distance = |t: Duration| (place - way.sample(t).position).norm();
            let clock = coordinator.clock();
            let around = (0..=30).map(|k| clock.saturating_sub(Duration::from_millis(50 * k)));
            behind = behind.max(distance(clock));
            beside = beside.max(around.map(distance).fold(f64::INFINITY, f64::min));
        }
    }
    let seconds = (hall.now - started.unwrap_or_default()).as_secs_f64();
    Outcome { state: flight.coordinator().state(), events, behind, beside, seconds }
}

/// A flight begins in the air where another one ended.
#[test]
fn drones_that_hover_fly_back() {
    let there: Vec<Task> = crossing().into_iter().take(2).collect();
    let back: Vec<Task> = there
        .iter()
        .map(|task| Task {
            start: Waypoint { position: task.goals[0].position, yaw: 0.0 },
            goals: vec![Goal { position: task.start.position, yaw: None }],
            ..task.clone()
        })
        .collect();
    let mut hall = hall(&there, Flavor::ArduPilot);
    for tasks in [there, back] {
        assert_eq!(fly(&mut hall, &tasks, |_, _| {}).state, FlightState::Finished);
        let places = true_places(&hall);
        for task in &tasks {
            let miss = (places[&task.vehicle] - task.goals[0].position).norm();
            assert!(miss <= 0.2, "{miss}");
        }
    }
}

/// Whoever flies them is gone: all stop, and the flight is over, so that others may fly them.
#[test]
fn a_lapsed_lease_ends_the_flight() {
    let tasks: Vec<Task> = crossing().into_iter().take(3).collect();
    let mut hall = hall(&tasks, Flavor::ArduPilot);
    let mut lapses = None;
    let outcome = fly(&mut hall, &tasks, |hall, since| {
        if since > Duration::from_secs(6) && lapses.is_none() {
            lapses = Some(hall.now);
            hall.fleet.lease(VehicleId(2), Some(hall.now));
        }
    });
    assert_eq!(outcome.state, FlightState::Stopped);
    let stopped = outcome.when(|event| *event == FlightEvent::State(FlightState::Stopped)).unwrap();
    assert!(stopped - lapses.unwrap() < Duration::from_millis(200), "{stopped:?} {lapses:?}");
    hall.run(3.0);
    for drone in &hall.world.drones {
        assert!(drone.is_flying() && drone.body().velocity.norm() < 0.2, "{:?}", drone.body());
    }
    assert_eq!(hall.world.num_contacts(), 0);
}

/// Everybody arrives, nobody comes within a meter, and the flight is the plan: beside its way by
/// at most half of the margin planned for a pair, behind its time by less than what would stop the clock, and its nearest approach
/// is that of the plan within 0.2 m.
#[test]
fn ten_drones_cross() {
    for flavor in [Flavor::ArduPilot, Flavor::Px4] {
        let tasks = crossing();
        let mut hall = hall(&tasks, flavor);
        let options = options();
        let plan = deconflict(&tasks, &options.rules, &options.how).unwrap();
        let truly = Separation { vertical_weight: 1.0, ..options.rules.separation };
        let planned = plan.closest(&truly).unwrap();
        let outcome = fly(&mut hall, &tasks, |_, _| {});
        let closest = hall.world.closest().unwrap();
        let places = true_places(&hall);
        let miss = |task: &Task| (places[&task.vehicle] - task.goals[0].position).norm();
        let worst_miss = tasks.iter().map(miss).fold(0.0, f64::max);
        let Outcome { behind, beside, seconds, .. } = outcome;
        println!(
            "10 {flavor:?}: closest {:.2} m (planned {planned:.2} m), behind {behind:.2} m, \
             beside {beside:.2} m, miss {worst_miss:.2} m, {seconds:.1} s",
            closest.distance,
        );
        assert_eq!(outcome.state, FlightState::Finished, "{:?}", outcome.events.last());
        assert_eq!(hall.world.num_contacts(), 0);
        assert!(closest.distance >= 1.0, "{closest:?}");
        assert!((closest.distance - planned).abs() <= 0.2, "{closest:?} {planned}");
        assert!(beside <= 0.5 * options.how.margin && behind <= options.lag, "{beside} {behind}");
        assert!(worst_miss <= 0.2, "{worst_miss}");
    }
}

/// A drone that is slow holds the clock of all: later, but no nearer to each other.
#[test]
fn a_slow_drone_holds_the_clock() {
    let tasks = crossing();
    let conditions = Conditions { flavor: Flavor::ArduPilot, ..Conditions::default() };
    let ground = |task: &Task| Point3::new(task.start.position.x, task.start.position.y, 0.0);
    let slow = VehicleId(4);
    let mut hall = Rig::at(tasks.iter().map(ground).collect(), &conditions);
    let mut drone = hall.world.drones[3].options().clone();
    drone.parameters.push(("WPNAV_SPEED".to_owned(), 30.0));
    hall.world.drones[3] = Drone::new(drone);
    let outcome = fly(&mut hall, &tasks, |_, _| {});
    let closest = hall.world.closest().unwrap();
    println!(
        "slow drone: closest {:.2} m, behind {:.2} m, {:.1} s",
        closest.distance, outcome.behind, outcome.seconds
    );
    assert_eq!(outcome.state, FlightState::Finished, "{:?}", outcome.events.last());
    let held = outcome.when(|e| *e == FlightEvent::ClockHeld { vehicle: slow });
    assert!(held.is_some(), "the clock waits for it");
    assert!(closest.distance >= 1.0, "{closest:?}");
    assert!(outcome.seconds > 45.0, "{}", outcome.seconds);
    assert_eq!(hall.world.num_contacts(), 0);
}

/// A drone whose camera dies in the middle lands; the other nine arrive.
#[test]
fn one_dead_camera_does_not_end_the_flight() {
    let tasks = crossing();
    let mut hall = hall(&tasks, Flavor::Px4);
    let dead = VehicleId(4);
    let mut died = None;
    let outcome = fly(&mut hall, &tasks, |hall, since_start| {
        if died.is_none() && since_start >= Duration::from_secs(8) {
            died = Some(hall.now);
            let ever = hall.now..Duration::MAX;
            hall.sources[usize::from(dead.0) - 1].fail(ever, PoseFault::Stop);
        }
    });
    let died = died.unwrap();
    let closest = hall.world.closest().unwrap();
    let held = outcome
        .when(|e| matches!(e, FlightEvent::Held { vehicle, .. } if *vehicle == dead))
        .expect("it holds");
    let landed = outcome.when(|e| *e == FlightEvent::Landed { vehicle: dead }).expect("it lands");
    println!(
        "dead camera: held after {:.2} s, down after {:.1} s, closest {:.2} m, flight {:.1} s",
        (held - died).as_secs_f64(),
        (landed - died).as_secs_f64(),
        closest.distance,
        outcome.seconds
    );
    assert_eq!(outcome.state, FlightState::Finished, "{:?}", outcome.events);
    assert!(held - died <= Duration::from_millis(700), "0.6 s and a step of the flight");
    assert_eq!(hall.world.num_contacts(), 0);
    assert!(closest.distance >= 1.0, "{closest:?}");
    let places = true_places(&hall);
    for task in tasks.iter().filter(|task| task.vehicle != dead) {
        let miss = (places[&task.vehicle] - task.goals[0].position).norm();
        assert!(miss <= 0.2, "{} by {miss}", task.vehicle.0);
    }
    assert!(places[&dead].z < 0.1);
}
