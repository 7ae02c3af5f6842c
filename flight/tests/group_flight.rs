//! Ten simulated drones fly as a group over MAVLink: plan, check, flight, in simulated time.
//!
//! The drones know where they are only from the poses they are sent. Distances are true ones.

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::net::SocketAddr;
use std::time::Duration;

use nalgebra::Point3;
use volery_flight::group::{
    Conductor, Coordinator, Deconfliction, FlightEvent, FlightOptions, FlightState, Geofence,
    Rules, Separation, Task, deconflict,
};
use volery_flight::motion::{Goal, MotionLimits, Waypoint};
use volery_flight::{Fleet, FleetOptions, PoseFix, VehicleId};
use volery_simulator::{
    Drone, DroneOptions, Flavor, PoseFault, PoseOptions, PoseSource, Space, World,
};

const STEP: Duration = Duration::from_millis(10);

fn address(id: VehicleId) -> SocketAddr {
    ([127, 0, 0, 1], 20_000 + u16::from(id.0)).into()
}

/// Fleet, drones and the poses between them.
struct Hall {
    fleet: Fleet,
    world: World,
    poses: BTreeMap<VehicleId, PoseSource>,
    now: Duration,
}

impl Hall {
    fn new(tasks: &[Task]) -> Self {
        let options = FleetOptions { accept_unsigned: true, ..FleetOptions::default() };
        let drone = |task: &Task| {
            let flavor =
                if task.vehicle.0.is_multiple_of(2) { Flavor::Px4 } else { Flavor::Ardupilot };
            let start = task.start.position;
            let ground = Point3::new(start.x, start.y, 0.0);
            Drone::new(DroneOptions::new(task.vehicle.0, flavor, ground))
        };
        let source = |task: &Task| {
            (task.vehicle, PoseSource::new(PoseOptions::default(), u64::from(task.vehicle.0)))
        };
        let low = Point3::new(-8.0, -8.0, 0.0);
        let hollow = Space::Hollow([low, Point3::new(8.0, 8.0, 6.0)]);
        Self {
            fleet: Fleet::new(options),
            world: World::new(hollow, tasks.iter().map(drone).collect(), 1.0),
            poses: tasks.iter().map(source).collect(),
            now: Duration::ZERO,
        }
    }

    /// One step of everything but the flight.
    fn step(&mut self) {
        self.now += STEP;
        self.world.step_to(self.now);
        for drone in &mut self.world.drones {
            let id = VehicleId(drone.options().system_id);
            for datagram in drone.poll() {
                self.fleet.receive(&datagram, address(id), self.now);
            }
            let source = self.poses.get_mut(&id).unwrap();
            for sample in source.poll(&drone.world_from_body(), self.now) {
                let fix = PoseFix {
                    map_from_body: sample.world_from_body,
                    captured: sample.captured,
                    position_sd: 0.02,
                    angle_sd: 0.01,
                };
                // Refused until the vehicle takes poses; later refusals show in the flight.
                let _ = self.fleet.pose(id, fix, self.now);
            }
        }
        for datagram in self.fleet.poll(self.now) {
            let drone = self
                .world
                .drones
                .iter_mut()
                .find(|drone| address(VehicleId(drone.options().system_id)) == datagram.to);
            drone.unwrap().receive(&datagram.bytes, self.now);
        }
    }

    fn true_places(&self) -> BTreeMap<VehicleId, Point3<f64>> {
        let place = |drone: &Drone| (VehicleId(drone.options().system_id), drone.body().position);
        self.world.drones.iter().map(place).collect()
    }
}

/// What a flight came to.
struct Outcome {
    state: FlightState,
    events: Vec<(Duration, FlightEvent)>,
    /// Largest distance of a flying vehicle from its place on the plan, true.
    off_plan: f64,
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
        start_tolerance: 0.3,
        metric_map: true,
    };
    FlightOptions::new(rules, Deconfliction::default())
}

/// Connects, takes off, flies the plan to its end. `meddle` may change the world before each step.
fn fly(hall: &mut Hall, tasks: &[Task], mut meddle: impl FnMut(&mut Hall, Duration)) -> Outcome {
    let options = options();
    let plan = deconflict(tasks, &options.rules, &options.how).unwrap();
    let mut flight =
        Conductor::new(Coordinator::new(plan, tasks.to_vec(), options.clone()).unwrap());
    // Estimators take a while; a start is refused until they are ready.
    while flight.begin(&mut hall.fleet, hall.now).is_err() {
        assert!(hall.now < Duration::from_secs(60), "nobody gets ready");
        hall.step();
    }
    let (mut events, mut off_plan, mut started) = (Vec::new(), 0f64, None);
    while !flight.coordinator().state().is_over() && hall.now < Duration::from_secs(300) {
        let since_start = hall.now.saturating_sub(started.unwrap_or(hall.now));
        meddle(hall, since_start);
        hall.step();
        let now = hall.now;
        events.extend(flight.poll(&mut hall.fleet, now).into_iter().map(|event| (now, event)));
        let coordinator = flight.coordinator();
        if coordinator.state() != FlightState::Running {
            continue;
        }
        started.get_or_insert(now);
        let out: Vec<VehicleId> = coordinator.taken_out().collect();
        for (id, place) in hall.true_places().into_iter().filter(|(id, _)| !out.contains(id)) {
            let planned = coordinator.plan().ways[&id].sample(coordinator.clock()).position;
            off_plan = off_plan.max((place - planned).norm());
        }
    }
    let seconds = (hall.now - started.unwrap_or_default()).as_secs_f64();
    Outcome { state: flight.coordinator().state(), events, off_plan, seconds }
}

/// Everybody arrives, nobody comes within a meter, and the flight is the plan.
#[test]
fn ten_drones_cross() {
    let tasks = crossing();
    let mut hall = Hall::new(&tasks);
    let outcome = fly(&mut hall, &tasks, |_, _| {});
    let closest = hall.world.closest().unwrap();
    let places = hall.true_places();
    let miss = |task: &Task| (places[&task.vehicle] - task.goals[0].position).norm();
    let worst_miss = tasks.iter().map(miss).fold(0.0, f64::max);
    println!(
        "10 drones: closest {:.2} m, off the plan {:.2} m, miss {worst_miss:.2} m, {:.1} s",
        closest.distance, outcome.off_plan, outcome.seconds
    );
    assert_eq!(outcome.state, FlightState::Finished, "{:?}", outcome.events.last());
    assert_eq!(hall.world.num_contacts(), 0);
    assert!(closest.distance >= 1.0, "{closest:?}");
    assert!(outcome.off_plan <= 0.2, "{}", outcome.off_plan);
    assert!(worst_miss <= 0.2, "{worst_miss}");
}

/// A drone whose camera dies in the middle lands; the other nine arrive.
#[test]
fn one_dead_camera_does_not_end_the_flight() {
    let tasks = crossing();
    let mut hall = Hall::new(&tasks);
    let dead = VehicleId(4);
    let mut died = None;
    let outcome = fly(&mut hall, &tasks, |hall, since_start| {
        if died.is_none() && since_start >= Duration::from_secs(8) {
            died = Some(hall.now);
            let ever = hall.now..Duration::MAX;
            hall.poses.get_mut(&dead).unwrap().fail(ever, PoseFault::Stop);
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
    let places = hall.true_places();
    for task in tasks.iter().filter(|task| task.vehicle != dead) {
        let miss = (places[&task.vehicle] - task.goals[0].position).norm();
        assert!(miss <= 0.2, "{} by {miss}", task.vehicle.0);
    }
    assert!(places[&dead].z < 0.1);
}
