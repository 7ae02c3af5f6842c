//! Group flights: requests to plans, plans to the fleet.
//!
//! Every decision is made by [`volery_flight::group`], which is pure. Flights live as long as the
//! service: when it ends, drones hold and land by their own failsafes.

mod plan;
mod wire;

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use tokio::sync::broadcast;
use uuid::Uuid;
use volery_api::{Flight, FlightNews};
use volery_flight::{
    Fleet, VehicleId,
    group::{BeginRefused, Conductor, FlightEvent, FlightState, StartRefused},
};

use crate::fleet::LeaseRefusal;

pub(crate) use plan::{Space, parse_fence, plan};

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
    /// All was stopped: its drones hold, and nobody steers them.
    stopped: bool,
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
        self.flights.insert(id, Entry { map, conductor, news: VecDeque::new(), stopped: false });
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
        if entry.stopped {
            return Err(FlightRefusal::State(FlightState::Aborted));
        }
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

    /// Ends all flights where they are: their drones are left to the hold that they were told.
    pub(crate) fn all_stop(&mut self, t_ns: u64) {
        for (&id, entry) in self.flights.iter_mut().filter(|(_, entry)| entry.is_active()) {
            entry.stopped = true;
            let event = FlightEvent::State(FlightState::Aborted);
            entry.note(id, wire::news(&event, t_ns), &self.news);
        }
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

    fn state(&self) -> FlightState {
        if self.stopped { FlightState::Aborted } else { self.conductor.coordinator().state() }
    }

    /// Whether drones follow it.
    fn is_active(&self) -> bool {
        let coordinator = self.conductor.coordinator();
        match coordinator.state() {
            _ if self.stopped => false,
            FlightState::Ready => self.conductor.is_begun(),
            FlightState::Running | FlightState::Paused => true,
            FlightState::Aborted => coordinator.is_landing(),
            FlightState::Finished => false,
        }
    }
}
