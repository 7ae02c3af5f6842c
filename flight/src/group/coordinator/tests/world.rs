//! Vehicles for flights in tests.

use std::f64::consts::TAU;

use super::*;
use crate::group::Geofence;
use crate::motion::{Goal, MotionLimits};

pub(super) const STEP: f64 = 0.05;

/// Vehicles that follow their orders with a lag of a good autopilot.
pub(super) struct World {
    pub(super) vehicles: BTreeMap<VehicleId, Vehicle>,
    pub(super) now: f64,
    pub(super) closest: f64,
    pub(super) events: Vec<(f64, FlightEvent)>,
}

#[derive(Clone, Copy)]
pub(super) struct Vehicle {
    pub(super) position: Point3<f64>,
    pub(super) velocity: Vector3<f64>,
    pub(super) top_speed: f64,
    pub(super) airborne: bool,
    pub(super) verdict: Verdict,
    pub(super) order: Option<Order>,
}

impl World {
    pub(super) fn new(tasks: &[Task]) -> Self {
        let vehicle = |task: &Task| Vehicle {
            position: task.start.position,
            velocity: Vector3::zeros(),
            top_speed: 1.5,
            airborne: true,
            verdict: Verdict::Continue,
            order: None,
        };
        Self {
            vehicles: tasks.iter().map(|task| (task.vehicle, vehicle(task))).collect(),
            now: 0.0,
            closest: f64::INFINITY,
            events: Vec::new(),
        }
    }

    pub(super) fn seen(&self) -> BTreeMap<VehicleId, Seen> {
        let seen = |v: &Vehicle| Seen {
            position: v.position,
            velocity: v.velocity,
            yaw: 0.0,
            airborne: v.airborne,
            verdict: v.verdict,
        };
        self.vehicles.iter().map(|(&id, v)| (id, seen(v))).collect()
    }

    pub(super) fn step(&mut self, flight: &mut Coordinator) {
        self.now += STEP;
        let tick = flight.poll(Duration::from_secs_f64(self.now), &self.seen());
        self.events.extend(tick.events.into_iter().map(|event| (self.now, event)));
        for (id, order) in tick.orders {
            self.vehicles.get_mut(&id).unwrap().order = Some(order);
        }
        for vehicle in self.vehicles.values_mut().filter(|v| v.airborne) {
            let wanted = match vehicle.order {
                Some(Order::Fly(setpoint) | Order::Hold(setpoint)) => {
                    setpoint.velocity + (setpoint.position - vehicle.position) * 2.0
                }
                Some(Order::Land) => Vector3::new(0.0, 0.0, -0.4),
                None => vehicle.velocity,
            };
            let wanted = wanted * (vehicle.top_speed / wanted.norm()).min(1.0);
            vehicle.velocity += (wanted - vehicle.velocity) * (STEP / 0.15);
            vehicle.position += vehicle.velocity * STEP;
            if vehicle.position.z <= 0.05 {
                vehicle.position.z = 0.0;
                (vehicle.velocity, vehicle.airborne) = (Vector3::zeros(), false);
            }
        }
        let all: Vec<Point3<f64>> = self.vehicles.values().map(|v| v.position).collect();
        for (index, a) in all.iter().enumerate() {
            for b in &all[index + 1..] {
                self.closest = self.closest.min((b - a).norm());
            }
        }
    }

    /// Steps until the flight is over or `seconds` have passed.
    pub(super) fn fly(&mut self, flight: &mut Coordinator, seconds: f64) {
        let end = self.now + seconds;
        while self.now < end && !flight.state().is_over() {
            self.step(flight);
        }
    }

    pub(super) fn when(&self, wanted: impl Fn(&FlightEvent) -> bool) -> Option<f64> {
        self.events.iter().find(|(_, event)| wanted(event)).map(|(at, _)| *at)
    }

    pub(super) fn distance_to_goal(&self, task: &Task) -> f64 {
        (self.vehicles[&task.vehicle].position - task.goals.last().unwrap().position).norm()
    }
}

pub(super) fn options(ceiling: f64) -> FlightOptions {
    let low = Point3::new(-8.0, -8.0, 0.0);
    let rules = Rules {
        limits: MotionLimits::default(),
        separation: Default::default(),
        geofence: Geofence::around(&low, &Point3::new(8.0, 8.0, ceiling), 0.5).unwrap(),
        air: None,
        others: Default::default(),
        start_tolerance: 0.3,
        metric_map: true,
    };
    FlightOptions::new(rules, Deconfliction::default())
}

pub(super) fn task(vehicle: u8, from: Point3<f64>, to: Point3<f64>) -> Task {
    Task {
        vehicle: VehicleId(vehicle),
        start: Waypoint { position: from, yaw: 0.0 },
        goals: vec![Goal { position: to, yaw: None }],
    }
}

pub(super) fn crossing() -> Vec<Task> {
    let place = |k: u8| {
        let (sin, cos) = (TAU * f64::from(k) / 10.0).sin_cos();
        Point3::new(5.0 * cos, 5.0 * sin, 1.3)
    };
    (0..10).map(|k| task(k + 1, place(k), place((k + 5) % 10))).collect()
}

pub(super) fn started(tasks: &[Task], options: &FlightOptions) -> (Coordinator, World) {
    let plan = deconflict(tasks, &options.rules, &options.how).unwrap();
    let mut flight = Coordinator::new(plan, tasks.to_vec(), options.clone()).unwrap();
    let world = World::new(tasks);
    flight.start(Duration::ZERO, &world.seen()).unwrap();
    (flight, world)
}
