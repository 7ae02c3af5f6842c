//! Group flights: requests to plans, plans to the fleet.
//!
//! Every decision is made by [`volery_flight::group`], which is pure. Flights live as long as the
//! service: when it ends, drones hold and land by their own failsafes.

mod plan;
mod target;
mod wire;

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use nalgebra::Point3;
use tokio::sync::broadcast;
use uuid::Uuid;
use volery_api::{Flight, FlightNews, FramePlace};
use volery_flight::{
    Fleet, Vehicle, VehicleId,
    group::{BeginRefused, Conductor, FlightEvent, FlightState, StartRefused, sight},
    motion::{LegKind, MotionLimits, Trajectory, Waypoint},
};

use crate::fleet::LeaseRefusal;

pub(crate) use plan::{Space, Ways, parse_fence, plan};
pub(crate) use target::{PlannedTarget, plan_target, under_way};

/// Flights kept; the oldest that are over are forgotten.
const MAX_FLIGHTS: usize = 200;
/// Events that a slow listener may be behind.
const MAX_BEHIND: usize = 1024;
/// Events kept per flight.
const MAX_NEWS: usize = 200;

/// Why a flight does not do what was asked.
#[derive(Debug, thiserror::Error)]
pub(crate) enum FlightRefusal {
    /// There is none.
    #[error("there is no such flight")]
    Unknown,
    /// There are too many that are not over.
    #[error("{MAX_FLIGHTS} flights are not over")]
    TooMany,
    /// A drone flies in another one.
    #[error("drone {} flies in flight {flight}", .drone.0)]
    Busy {
        /// Who.
        drone: VehicleId,
        /// With whom.
        flight: Uuid,
    },
    /// Somebody else commands a drone.
    #[error(transparent)]
    Leased(#[from] LeaseRefusal),
    /// The state of the flight or of a drone forbids it.
    #[error(transparent)]
    Begin(#[from] BeginRefused),
    /// The flight is not in a state for it.
    #[error("the flight is {}", .0.code())]
    State(FlightState),
}

impl FlightRefusal {
    /// Stable name for programs.
    pub(crate) fn code(&self) -> &'static str {
        match self {
            Self::Unknown => "not_found",
            Self::TooMany => "too_many_flights",
            Self::Busy { .. } => "drone_busy",
            Self::Leased(_) => "drone_leased",
            Self::Begin(BeginRefused::TakeOff { .. }) => "no_takeoff",
            Self::Begin(BeginRefused::Start(refusal)) => match refusal {
                StartRefused::State { .. } => "flight_state",
                StartRefused::Starts(_) => "not_at_start",
                StartRefused::NotAirborne { .. } => "not_airborne",
                StartRefused::Unfit { .. } => "not_fit",
            },
            Self::State(_) => "flight_state",
        }
    }
}

/// What a flight shall do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Wish {
    /// Take off and begin.
    Start,
    /// Wait in the air.
    Pause,
    /// Go on.
    Resume,
    /// Land.
    Abort,
}

/// All flights.
#[derive(Debug)]
pub(crate) struct Flights {
    flights: BTreeMap<Uuid, Entry>,
    news: broadcast::Sender<(Uuid, FlightNews)>,
}

#[derive(Debug)]
struct Entry {
    map: Uuid,
    conductor: Conductor,
    news: VecDeque<FlightNews>,
}

impl Flights {
    pub(crate) fn new() -> Self {
        Self { flights: BTreeMap::new(), news: broadcast::channel(MAX_BEHIND).0 }
    }

    /// Events of all flights from now on.
    pub(crate) fn listen(&self) -> broadcast::Receiver<(Uuid, FlightNews)> {
        self.news.subscribe()
    }

    /// Keeps a flight that is planned.
    pub(crate) fn insert(
        &mut self,
        id: Uuid,
        map: Uuid,
        conductor: Conductor,
    ) -> Result<Flight, FlightRefusal> {
        if self.flights.len() >= MAX_FLIGHTS {
            // Ids rise with time.
            let waits = |entry: &Entry| !entry.is_active();
            let oldest = self.flights.iter().find(|(_, entry)| waits(entry)).map(|(id, _)| *id);
            self.flights.remove(&oldest.ok_or(FlightRefusal::TooMany)?);
        }
        self.flights.insert(id, Entry { map, conductor, news: VecDeque::new() });
        self.get(id).ok_or(FlightRefusal::Unknown)
    }

    /// One flight.
    pub(crate) fn get(&self, id: Uuid) -> Option<Flight> {
        self.flights.get(&id).map(|entry| wire::flight(id, entry))
    }

    /// All flights, the oldest first.
    pub(crate) fn list(&self) -> Vec<Flight> {
        self.flights.iter().map(|(id, entry)| wire::flight(*id, entry)).collect()
    }

    /// Starts, pauses, resumes or aborts a flight.
    pub(crate) fn wish(
        &mut self,
        id: Uuid,
        wish: Wish,
        fleet: &mut Fleet,
        now: Duration,
    ) -> Result<Flight, FlightRefusal> {
        let busy = self.busy(id);
        let entry = self.flights.get_mut(&id).ok_or(FlightRefusal::Unknown)?;
        let coordinator = entry.conductor.coordinator_mut();
        let state = coordinator.state();
        let done = match wish {
            Wish::Start => {
                let ways = &coordinator.plan().ways;
                if let Some((&drone, &other)) = busy.iter().find(|(id, _)| ways.contains_key(id)) {
                    return Err(FlightRefusal::Busy { drone, flight: other });
                }
                entry.conductor.begin(fleet, now)?;
                true
            }
            Wish::Pause => coordinator.pause(),
            Wish::Resume => coordinator.resume(),
            Wish::Abort => coordinator.abort(),
        };
        if !done {
            return Err(FlightRefusal::State(state));
        }
        Ok(wire::flight(id, entry))
    }

    /// Who flies in it.
    pub(crate) fn drones(&self, id: Uuid) -> impl Iterator<Item = VehicleId> {
        let entry = self.flights.get(&id).into_iter();
        entry.flat_map(|entry| entry.conductor.coordinator().plan().ways.keys().copied())
    }

    /// Drones in the air with another flight than `id`.
    fn busy(&self, id: Uuid) -> BTreeMap<VehicleId, Uuid> {
        let others =
            self.flights.iter().filter(|(other, entry)| **other != id && entry.is_active());
        let drones = |(other, entry): (&Uuid, &Entry)| {
            let ways = entry.conductor.coordinator().plan().ways.keys();
            ways.map(|drone| (*drone, *other)).collect::<Vec<_>>()
        };
        others.flat_map(drones).collect()
    }

    /// What drones that fly without `own` are about to do: those of flights follow their ways,
    /// others go to where they were told to be or stay.
    pub(crate) fn others(&self, own: &[VehicleId], fleet: &Fleet) -> Ways {
        let limits = MotionLimits::default();
        let mut ways = Ways::new();
        for (&vehicle, seen) in sight(fleet).iter().filter(|(_, seen)| seen.airborne) {
            let here = Waypoint { position: seen.position, yaw: seen.yaw };
            let mut way = Trajectory::standing(here);
            if let Some(there) = fleet.vehicle(vehicle).and_then(Vehicle::setpoint) {
                let there = Waypoint { position: there.position, yaw: there.yaw };
                way.fly(LegKind::Straight, there, &limits);
            }
            ways.insert(vehicle, way);
        }
        for entry in self.flights.values().filter(|entry| entry.is_active()) {
            let coordinator = entry.conductor.coordinator();
            let out: Vec<VehicleId> = coordinator.taken_out().collect();
            let rest = |(vehicle, way): (&VehicleId, &Trajectory)| {
                let follows = !out.contains(vehicle);
                follows.then(|| (*vehicle, way.rest_after(coordinator.clock())))
            };
            ways.extend(coordinator.plan().ways.iter().filter_map(rest));
        }
        ways.retain(|vehicle, _| !own.contains(vehicle));
        ways
    }

    /// Where the flight that a drone is in, or flew last, leads it.
    pub(crate) fn goal(&self, drone: VehicleId) -> Option<Point3<f64>> {
        let latest = self.flights.values().rev().find(|entry| entry.has_flown(drone))?;
        let way = &latest.conductor.coordinator().plan().ways[&drone];
        Some(way.sample(way.duration()).position)
    }

    /// A frame of a drone's camera was placed: noted in the flight that it is in, or flew last.
    pub(crate) fn note_frame(&mut self, drone: VehicleId, t_ns: u64, place: &FramePlace) {
        let latest = self.flights.iter_mut().rev().find(|(_, entry)| entry.has_flown(drone));
        let Some((&id, entry)) = latest else { return };
        let news = FlightNews {
            t_ns,
            kind: "frame".to_owned(),
            drone: Some(drone.0),
            value: place.correction_m.map(|correction| format!("{correction:.3} m")),
        };
        entry.note(id, news, &self.news);
    }

    /// Makes way for a command to a drone: a flight of its own ends, and from a group it can only
    /// be taken down.
    pub(crate) fn make_way(
        &mut self,
        drone: VehicleId,
        down: bool,
        t_ns: u64,
    ) -> Result<(), FlightRefusal> {
        for (&id, entry) in self.flights.iter_mut().filter(|(_, entry)| entry.is_active()) {
            let coordinator = entry.conductor.coordinator();
            let ways = &coordinator.plan().ways;
            if !ways.contains_key(&drone) || coordinator.taken_out().any(|out| out == drone) {
                continue;
            }
            if ways.len() == 1 {
                entry.stop(id, t_ns, &self.news);
            } else if down {
                entry.conductor.take_out(drone);
            } else {
                return Err(FlightRefusal::Busy { drone, flight: id });
            }
        }
        Ok(())
    }

    /// Ends all flights where they are.
    pub(crate) fn stop_all(&mut self, t_ns: u64) {
        for (&id, entry) in self.flights.iter_mut().filter(|(_, entry)| entry.is_active()) {
            entry.stop(id, t_ns, &self.news);
        }
    }

    /// One step of every flight, before the fleet is polled.
    pub(crate) fn poll(&mut self, fleet: &mut Fleet, now: Duration, t_ns: u64) {
        for (&id, entry) in self.flights.iter_mut().filter(|(_, entry)| entry.is_active()) {
            for event in entry.conductor.poll(fleet, now) {
                entry.note(id, wire::news(&event, t_ns), &self.news);
            }
        }
    }
}

impl Entry {
    /// Whether a drone flies or flew in it. The latest of such flights has the greatest id.
    fn has_flown(&self, drone: VehicleId) -> bool {
        let coordinator = self.conductor.coordinator();
        let flew = coordinator.state() != FlightState::Ready;
        flew && coordinator.plan().ways.contains_key(&drone)
    }

    /// Keeps and tells what happened.
    fn note(&mut self, id: Uuid, news: FlightNews, to: &broadcast::Sender<(Uuid, FlightNews)>) {
        tracing::info!(flight = %id, kind = %news.kind, drone = news.drone,
            value = news.value.as_deref(), "flight {id}: {}", news.kind);
        if self.news.len() == MAX_NEWS {
            self.news.pop_front();
        }
        // Nobody may listen.
        let _ = to.send((id, news.clone()));
        self.news.push_back(news);
    }

    /// Ends it where its drones are: somebody else commands them.
    fn stop(&mut self, id: Uuid, t_ns: u64, to: &broadcast::Sender<(Uuid, FlightNews)>) {
        self.conductor.stop();
        let stopped = FlightEvent::State(FlightState::Stopped);
        self.note(id, wire::news(&stopped, t_ns), to);
    }

    /// Whether drones follow it.
    fn is_active(&self) -> bool {
        let coordinator = self.conductor.coordinator();
        match coordinator.state() {
            FlightState::Ready => self.conductor.is_begun(),
            FlightState::Running | FlightState::Paused => true,
            FlightState::Aborted => coordinator.is_landing(),
            FlightState::Finished | FlightState::Stopped => false,
        }
    }
}
