//! One step of a flight.

use std::collections::BTreeMap;
use std::time::Duration;

use nalgebra::{Point3, Vector3};

use super::{Coordinator, FlightEvent, FlightState, Member, Order, Role, Seen, Tick};
use crate::group::separation::closest_between;
use crate::group::{Deconfliction, Intent, Neighbor, Separation, Task, deconflict, guard};
use crate::motion::{Trajectory, Waypoint};
use crate::watchdog::{Reason, Verdict};
use crate::{Setpoint, VehicleId};

/// How fast the clock's rate changes, per second: from full speed to rest in a second, so that
/// vehicles can brake.
const RATE_SLEW: f64 = 1.0;
/// A longer time between two steps counts as this: after a stall nobody is asked to leap.
const MAX_STEP: f64 = 0.25;
/// How far ahead ways are looked over for somebody who is landing. Seconds: the clock comes to
/// rest within one, vehicles within two.
const LOOK_AHEAD: f64 = 4.0;

type Sight = BTreeMap<VehicleId, Seen>;

impl Coordinator {
    /// One step, at least ten times a second: what is seen in, orders and events out. `now` is the
    /// caller's monotonic clock. A vehicle that is not seen is treated as silent.
    pub fn poll(&mut self, now: Duration, seen: &Sight) -> Tick {
        let before = self.polled.replace(now).unwrap_or(now);
        let dt = now.saturating_sub(before).as_secs_f64().min(MAX_STEP);
        let mut tick = Tick::default();
        if self.state == FlightState::Ready {
            if self.begins.is_none_or(|begins| now < begins) {
                return tick;
            }
            self.enter(FlightState::Running, &mut tick);
        }
        let verdicts = self.verdicts(seen);
        for (vehicle, verdict) in verdicts {
            self.apply(vehicle, verdict, seen, &mut tick);
        }
        self.note_landed(seen, &mut tick);
        match self.state {
            FlightState::Aborted => self.land_all(seen, &mut tick),
            FlightState::Running => self.run_clock(dt, seen, &mut tick),
            _ => self.slew(0.0, dt),
        }
        self.note_legs(&mut tick);
        tick.orders = self.orders();
        tick
    }

    fn enter(&mut self, state: FlightState, tick: &mut Tick) {
        self.state = state;
        tick.events.push(FlightEvent::State(state));
    }

    /// The graver of watchdog and guard for each member that flies.
    fn verdicts(&self, seen: &Sight) -> BTreeMap<VehicleId, Verdict> {
        let moving = self.state == FlightState::Running && self.rate > 0.0;
        let intent = |vehicle: &VehicleId| match self.members.get(vehicle).map(|m| m.role) {
            Some(Role::Flying) if moving => Intent::Follow(&self.plan.ways[vehicle], self.clock),
            Some(Role::Flying | Role::Held(_)) => Intent::Stop,
            _ => Intent::Forced,
        };
        let neighbors = seen.iter().filter(|(_, seen)| seen.airborne).map(|(id, seen)| {
            let Seen { position, velocity, .. } = *seen;
            (*id, Neighbor { position, velocity, intent: intent(id) })
        });
        let mut verdicts = guard(&neighbors.collect(), &self.options.guard);
        for (&vehicle, _) in self.members.iter().filter(|(_, member)| member.flies()) {
            let silent = Verdict::Hold(Reason::LinkLost);
            let own = seen.get(&vehicle).map_or(silent, |seen| seen.verdict);
            let gravest = verdicts.entry(vehicle).or_insert(own);
            if own.severity() >= gravest.severity() {
                *gravest = own; // its own trouble is the better reason
            }
        }
        verdicts
    }

    /// Holds, releases or takes out one member.
    fn apply(&mut self, vehicle: VehicleId, verdict: Verdict, seen: &Sight, tick: &mut Tick) {
        let Some(member) = self.members.get_mut(&vehicle).filter(|member| member.flies()) else {
            return;
        };
        let event = match (member.role, verdict) {
            (_, Verdict::Land(reason)) => {
                member.role = Role::Landing;
                FlightEvent::TakenOut { vehicle, reason: Some(reason) }
            }
            (Role::Flying, Verdict::Hold(reason)) => {
                let on_way = self.plan.ways[&vehicle].sample(Duration::from_secs_f64(self.clock));
                let place = match seen.get(&vehicle) {
                    Some(seen) => Waypoint {
                        position: stopping_point(seen, self.options.guard.braking),
                        yaw: seen.yaw,
                    },
                    None => Waypoint { position: on_way.position, yaw: on_way.yaw },
                };
                member.role = Role::Held(place);
                FlightEvent::Held { vehicle, reason }
            }
            (Role::Held(_), Verdict::Continue) => {
                member.role = Role::Flying;
                FlightEvent::Released { vehicle }
            }
            _ => return,
        };
        tick.events.push(event);
    }

    /// Members that were landing and are down; new ways are wanted if they lie in the way.
    fn note_landed(&mut self, seen: &Sight, tick: &mut Tick) {
        let down: Vec<(VehicleId, Point3<f64>)> = self
            .members
            .iter()
            .filter(|(_, member)| member.role == Role::Landing)
            .filter_map(|(&vehicle, _)| Some((vehicle, seen.get(&vehicle)?)))
            .filter(|(_, seen)| !seen.airborne)
            .map(|(vehicle, seen)| (vehicle, seen.position))
            .collect();
        for (vehicle, place) in down {
            if let Some(member) = self.members.get_mut(&vehicle) {
                member.role = Role::Landed(place);
            }
            tick.events.push(FlightEvent::Landed { vehicle });
            let apart = Separation { vertical_weight: 1.0, ..self.options.rules.separation };
            self.replan |= self.passes(place, f64::INFINITY, &apart);
        }
    }

    /// Whether somebody who is clear of `place` now will not be within the next `ahead` seconds.
    fn passes(&self, place: Point3<f64>, ahead: f64, apart: &Separation) -> bool {
        let there = Trajectory::standing(Waypoint { position: place, yaw: 0.0 });
        let comes_near = |way: &Trajectory| {
            let now = way.sample(Duration::from_secs_f64(self.clock)).position - place;
            let until = (self.clock + ahead).min(way.seconds().max(self.clock));
            let nearest = closest_between(way, &there, self.clock, until, apart).distance;
            apart.measure(&now) >= apart.distance && nearest < apart.distance
        };
        self.flying().any(|vehicle| comes_near(&self.plan.ways[&vehicle]))
    }

    fn flying(&self) -> impl Iterator<Item = VehicleId> + '_ {
        self.members.iter().filter(|(_, member)| member.flies()).map(|(&vehicle, _)| vehicle)
    }

    fn slew(&mut self, target: f64, dt: f64) {
        let step = RATE_SLEW * dt;
        self.rate = target.clamp(self.rate - step, self.rate + step);
        self.clock += self.rate * dt;
    }

    fn run_clock(&mut self, dt: f64, seen: &Sight, tick: &mut Tick) {
        let (rate, slowest) = self.pace(seen);
        // Told when the clock runs at less than half of its rate, until it runs fully again.
        let held_by = match self.clock_held_by {
            Some(_) => slowest,
            None => slowest.filter(|_| rate < 0.5),
        };
        if held_by != self.clock_held_by {
            tick.events.push(match held_by {
                Some(vehicle) => FlightEvent::ClockHeld { vehicle },
                None => FlightEvent::ClockRuns,
            });
            self.clock_held_by = held_by;
        }
        self.slew(if self.replan { 0.0 } else { rate }, dt);
        self.clock = self.clock.min(self.plan.duration().as_secs_f64());
        if self.replan && self.rate == 0.0 {
            self.find_new_ways(tick);
        }
        if self.flying().next().is_none() {
            self.enter(FlightState::Aborted, tick);
        } else if self.clock().max(self.plan.duration()) == self.clock()
            && self.flying().all(|vehicle| self.lag(vehicle, seen) <= self.options.there)
        {
            self.enter(FlightState::Finished, tick);
        }
    }

    /// How fast the clock may run, and the member that keeps it from running at full rate.
    fn pace(&self, seen: &Sight) -> (f64, Option<VehicleId>) {
        let options = &self.options;
        let column = Separation {
            distance: options.rules.separation.distance + options.drift,
            vertical_weight: 0.0,
        };
        let in_the_way = |vehicle: VehicleId| {
            let place = seen.get(&vehicle).map(|seen| seen.position);
            place.is_none_or(|place| self.passes(place, LOOK_AHEAD, &column))
        };
        let pace = |vehicle: VehicleId, member: &Member| match member.role {
            Role::Flying => {
                let late = self.lag(vehicle, seen) - options.on_time;
                (1.0 - late / (options.lag - options.on_time)).clamp(0.0, 1.0)
            }
            Role::Landing if !in_the_way(vehicle) => 1.0,
            Role::Landed(_) => 1.0,
            Role::Held(_) | Role::Landing => 0.0,
        };
        let paces = self.members.iter().map(|(&id, member)| (pace(id, member), Some(id)));
        let slowest = |a: (f64, _), b: (f64, _)| if b.0 < a.0 { b } else { a };
        paces.fold((1.0, None), slowest)
    }

    /// How far a member is from its place on the way.
    fn lag(&self, vehicle: VehicleId, seen: &Sight) -> f64 {
        let place = self.plan.ways[&vehicle].sample(self.clock()).position;
        seen.get(&vehicle).map_or(f64::INFINITY, |seen| (seen.position - place).norm())
    }

    /// Plans the rest of the flight round those who landed.
    fn find_new_ways(&mut self, tick: &mut Tick) {
        self.replan = false;
        let done = self.plan.stages.iter().filter(|end| **end <= self.clock()).count();
        let rest = |task: &Task| {
            let here = self.plan.ways[&task.vehicle].sample(self.clock());
            Task {
                vehicle: task.vehicle,
                start: Waypoint { position: here.position, yaw: here.yaw },
                goals: task.goals.iter().skip(done).copied().collect(),
            }
        };
        let flying: Vec<VehicleId> = self.flying().collect();
        let mut tasks: Vec<Task> =
            self.tasks.iter().filter(|t| flying.contains(&t.vehicle)).map(rest).collect();
        let obstacles = self.members.values().filter_map(|member| match member.role {
            Role::Landed(place) => Some(place),
            _ => None,
        });
        let how = Deconfliction { obstacles: obstacles.collect(), ..self.options.how.clone() };
        let plan = loop {
            match deconflict(&tasks, &self.options.rules, &how) {
                Ok(plan) if plan.ways.len() == flying.len() => break plan,
                Ok(_) => return self.enter(FlightState::Paused, tick), // unknown goals
                Err(none) => {
                    let vehicle = none.vehicle;
                    tick.events.push(FlightEvent::NoWay { vehicle });
                    let blocked = tasks.iter_mut().find(|task| task.vehicle == vehicle);
                    match blocked.filter(|task| !task.goals.is_empty()) {
                        Some(task) => task.goals.clear(),
                        None => return self.enter(FlightState::Paused, tick),
                    }
                }
            }
        };
        self.plan = plan;
        self.tasks = tasks;
        self.clock = 0.0;
        self.members.values_mut().for_each(|member| member.leg = None);
        tick.events.push(FlightEvent::Replanned);
    }

    /// Lets everybody land whose column is free.
    fn land_all(&mut self, seen: &Sight, tick: &mut Tick) {
        self.rate = 0.0;
        let room = self.options.rules.separation.distance;
        let below = |a: &Seen, b: &Seen| {
            (a.position - b.position).xy().norm() < room && b.position.z < a.position.z
        };
        let free = |vehicle: VehicleId| match seen.get(&vehicle) {
            Some(here) => !seen.iter().any(|(id, other)| *id != vehicle && below(here, other)),
            None => true,
        };
        let landing: Vec<VehicleId> = self.flying().filter(|vehicle| free(*vehicle)).collect();
        for vehicle in landing {
            if let Some(member) = self.members.get_mut(&vehicle) {
                member.role = Role::Landing;
            }
            tick.events.push(FlightEvent::TakenOut { vehicle, reason: None });
        }
    }

    fn note_legs(&mut self, tick: &mut Tick) {
        let clock = self.clock();
        for (&vehicle, member) in self.members.iter_mut().filter(|(_, member)| member.flies()) {
            let leg = self.plan.ways[&vehicle].leg_at(clock);
            if let Some((index, kind)) = leg.filter(|(index, _)| member.leg != Some(*index)) {
                tick.events.push(FlightEvent::Leg { vehicle, index, kind });
                member.leg = Some(index);
            }
        }
    }

    fn orders(&self) -> BTreeMap<VehicleId, Order> {
        let stay = |place: Waypoint| Setpoint {
            position: place.position,
            velocity: Vector3::zeros(),
            yaw: place.yaw,
        };
        let order = |vehicle: &VehicleId, member: &Member| match member.role {
            Role::Flying => {
                let mut setpoint = self.plan.ways[vehicle].sample(self.clock());
                setpoint.velocity *= self.rate;
                Order::Fly(setpoint)
            }
            Role::Held(place) => Order::Hold(stay(place)),
            Role::Landing | Role::Landed(_) => Order::Land,
        };
        self.members.iter().map(|(id, member)| (*id, order(id, member))).collect()
    }
}

impl Member {
    fn flies(&self) -> bool {
        matches!(self.role, Role::Flying | Role::Held(_))
    }
}

/// Where a vehicle comes to rest, `p + v ‖v‖ / 2a`.
fn stopping_point(seen: &Seen, braking: f64) -> Point3<f64> {
    seen.position + seen.velocity * (seen.velocity.norm() / (2.0 * braking))
}
