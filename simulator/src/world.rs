//! Drones in one space: who touches what.

use std::collections::BTreeSet;
use std::time::Duration;

use nalgebra::{Point3, Vector3};

use crate::{Drone, Event, Space, TICK};

/// Radius of the ball around a drone, meters.
pub const RADIUS: f64 = 0.15;
/// Its middle above the feet, meters.
const MIDDLE: f64 = 0.08;

/// The smallest distance that two flying drones had.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Closest {
    /// Between their middles, meters.
    pub distance: f64,
    /// System ids.
    pub pair: [u8; 2],
    /// When.
    pub time: Duration,
}

/// All drones, their space and the clock of both.
#[derive(Debug, Clone)]
pub struct World {
    /// The drones. Datagrams go to and from them directly.
    pub drones: Vec<Drone>,
    space: Space,
    /// Distance under which a pair is reported.
    separation: f64,
    now: Duration,
    closest: Option<Closest>,
    too_close: BTreeSet<[u8; 2]>,
    touching: BTreeSet<u8>,
    num_contacts: u32,
}

impl World {
    /// The clock begins at zero. Pairs nearer than `separation` are reported.
    pub fn new(space: Space, drones: Vec<Drone>, separation: f64) -> Self {
        Self {
            drones,
            space,
            separation,
            now: Duration::ZERO,
            closest: None,
            too_close: BTreeSet::new(),
            touching: BTreeSet::new(),
            num_contacts: 0,
        }
    }

    /// Runs the ticks that are due by `now`.
    pub fn step_to(&mut self, now: Duration) {
        while self.now + TICK <= now {
            self.now += TICK;
            self.tick();
        }
    }

    /// Time of the last tick.
    pub fn now(&self) -> Duration {
        self.now
    }

    /// The smallest distance of two flying drones so far.
    pub fn closest(&self) -> Option<Closest> {
        self.closest
    }

    /// How often a drone touched a wall, a thing or a drone, or crashed to the floor.
    pub fn num_contacts(&self) -> u32 {
        self.num_contacts
    }

    /// What happened since the last call, by system id.
    pub fn events(&mut self) -> Vec<(Duration, u8, Event)> {
        let mut all = Vec::new();
        for drone in &mut self.drones {
            let system_id = drone.options().system_id;
            all.extend(drone.events().into_iter().map(|(time, event)| (time, system_id, event)));
        }
        all
    }

    fn tick(&mut self) {
        for drone in &mut self.drones {
            let before = drone.body().position;
            let was_whole = !drone.has_crashed();
            drone.step(self.now);
            self.num_contacts += u32::from(was_whole && drone.has_crashed());
            let system_id = drone.options().system_id;
            let middle = middle_of(drone);
            let is_free = !drone.is_flying() || self.space.is_free(&middle, RADIUS);
            if is_free {
                self.touching.remove(&system_id);
                continue;
            }
            drone.bump(before);
            if self.touching.insert(system_id) {
                drone.note(Event::Contact);
                self.num_contacts += 1;
            }
        }
        self.watch_pairs();
    }

    fn watch_pairs(&mut self) {
        for first in 0..self.drones.len() {
            for second in first + 1..self.drones.len() {
                let [a, b] = [first, second].map(|index| &self.drones[index]);
                if !(a.is_flying() && b.is_flying()) {
                    continue;
                }
                let distance = (middle_of(a) - middle_of(b)).norm();
                let pair = [a, b].map(|drone| drone.options().system_id);
                if self.closest.is_none_or(|closest| distance < closest.distance) {
                    self.closest = Some(Closest { distance, pair, time: self.now });
                }
                if distance < 2.0 * RADIUS {
                    self.num_contacts += 1;
                    self.drones[first].wreck();
                    self.drones[second].wreck();
                }
                if distance >= self.separation {
                    self.too_close.remove(&pair);
                } else if self.too_close.insert(pair) {
                    self.drones[first].note(Event::TooClose { other: pair[1], distance });
                }
            }
        }
    }
}

/// Near the floor the middle of the ball stays over it: the feet may touch.
fn middle_of(drone: &Drone) -> Point3<f64> {
    let feet = drone.body().position;
    let middle = feet + Vector3::z() * MIDDLE;
    Point3::new(middle.x, middle.y, middle.z.max(RADIUS))
}
