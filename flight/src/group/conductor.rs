//! A flight at the controls of a fleet.

use std::collections::BTreeMap;
use std::time::Duration;

use super::{Coordinator, FlightEvent, FlightState, Order, Seen, StartRefused};
use crate::motion::Trajectory;
use crate::watchdog::{Reason, Verdict};
use crate::{Command, CommandRefusal, Fleet, Vehicle, VehicleId};

/// Shortest time between two steps.
const PERIOD: Duration = Duration::from_millis(50);
/// Slower vehicles hover. Meters per second.
const HOVERING: f64 = 0.2;
/// For everybody to be in the air and at the start.
const TAKE_OFF_TIMEOUT: Duration = Duration::from_secs(60);

/// Why a flight cannot begin.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BeginRefused {
    /// The flight is not ready for it, or vehicles are not where it starts.
    #[error(transparent)]
    Start(#[from] StartRefused),
    /// A vehicle does not take off.
    #[error("vehicle {} does not take off: {refusal}", .vehicle.0)]
    TakeOff {
        /// Which one.
        vehicle: VehicleId,
        /// Why.
        refusal: CommandRefusal,
    },
}

/// Carries what a [`Coordinator`] orders to a [`Fleet`], and what the fleet sees back.
#[derive(Debug, Clone)]
pub struct Conductor {
    coordinator: Coordinator,
    /// Until when everybody must be at the start.
    begins_by: Option<Duration>,
    /// What each vehicle was told last, of what is told once.
    told: BTreeMap<VehicleId, Told>,
    polled: Option<Duration>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Told {
    Hold,
    Land,
}

impl Conductor {
    /// For a flight that is ready.
    pub fn new(coordinator: Coordinator) -> Self {
        Self { coordinator, begins_by: None, told: BTreeMap::new(), polled: None }
    }

    /// The flight.
    pub fn coordinator(&self) -> &Coordinator {
        &self.coordinator
    }

    /// The flight, to pause, resume or abort it.
    pub fn coordinator_mut(&mut self) -> &mut Coordinator {
        &mut self.coordinator
    }

    /// Ends the flight where everybody is: somebody else commands those who fly.
    pub fn stop(&mut self) {
        self.begins_by = None;
        self.coordinator.stop();
    }

    /// Leaves a vehicle that somebody else lands; the others go on.
    pub fn take_out(&mut self, vehicle: VehicleId) {
        self.coordinator.take_out(vehicle);
        self.told.insert(vehicle, Told::Land);
    }

    /// Whether vehicles are on their way up to the start.
    pub fn is_beginning(&self) -> bool {
        self.begins_by.is_some()
    }

    /// Whether it was told to begin: it has to be polled.
    pub fn is_begun(&self) -> bool {
        self.is_beginning() || self.coordinator.is_started()
    }

    /// Takes off with those who stand beneath their starts; the flight starts when everybody is
    /// there.
    ///
    /// # Errors
    ///
    /// [`BeginRefused`]: somebody is elsewhere or cannot take off; those who already do land again.
    pub fn begin(&mut self, fleet: &mut Fleet, now: Duration) -> Result<(), BeginRefused> {
        let seen = sight(fleet);
        match self.coordinator.start(now, &seen) {
            Ok(()) => return Ok(()),
            Err(refusal @ StartRefused::State { .. }) => return Err(refusal.into()),
            Err(refusal) => self.stands_beneath_starts(&seen).ok_or(refusal)?,
        }
        let mut taken_off = Vec::new();
        for (&vehicle, way) in &self.coordinator.plan().ways {
            let here = &seen[&vehicle];
            if here.airborne {
                continue;
            }
            let height = way.start().position.z - here.position.z;
            if let Err(refusal) = fleet.command(vehicle, &Command::TakeOff { height }, now) {
                for earlier in taken_off {
                    // Never refused.
                    let _ = fleet.command(earlier, &Command::Land, now);
                }
                return Err(BeginRefused::TakeOff { vehicle, refusal });
            }
            taken_off.push(vehicle);
        }
        self.begins_by = Some(now + TAKE_OFF_TIMEOUT);
        Ok(())
    }

    /// Whether everybody is known to be at or straight below the start.
    fn stands_beneath_starts(&self, seen: &BTreeMap<VehicleId, Seen>) -> Option<()> {
        let tolerance = self.coordinator.options().rules.start_tolerance;
        let ways = &self.coordinator.plan().ways;
        let beneath = ways.iter().all(|(vehicle, way)| {
            seen.get(vehicle).is_some_and(|seen| {
                let apart = way.start().position - seen.position;
                let level = apart.xy().norm() <= tolerance;
                level && (!seen.airborne || apart.z.abs() <= tolerance)
            })
        });
        beneath.then_some(())
    }

    /// Whether everybody hovers at the start.
    fn is_settled(&self, seen: &BTreeMap<VehicleId, Seen>) -> bool {
        let hovers = |(vehicle, way): (&VehicleId, &Trajectory)| {
            seen.get(vehicle).is_some_and(|seen| {
                let apart = (way.start().position - seen.position).norm();
                apart <= self.coordinator.options().there && seen.velocity.norm() <= HOVERING
            })
        };
        self.coordinator.plan().ways.iter().all(hovers)
    }

    /// One step, to be taken whenever the fleet is polled. Returns what happened.
    pub fn poll(&mut self, fleet: &mut Fleet, now: Duration) -> Vec<FlightEvent> {
        if self.polled.is_some_and(|polled| now < polled + PERIOD) {
            return Vec::new();
        }
        self.polled = Some(now);
        let seen = sight(fleet);
        if self.is_begun() && self.is_left(&seen) {
            return self.hold_all(fleet, now);
        }
        if let Some(by) = self.begins_by {
            if self.is_settled(&seen) && self.coordinator.start(now, &seen).is_ok() {
                self.begins_by = None;
            } else if now >= by || self.coordinator.state() != FlightState::Ready {
                self.begins_by = None;
                self.coordinator.abort();
            }
        }
        let tick = self.coordinator.poll(now, &seen);
        for (vehicle, order) in tick.orders {
            self.tell(fleet, vehicle, order, &seen, now);
        }
        tick.events
    }

    /// Whether the one who flies them has gone: the lease of a vehicle has run out.
    fn is_left(&self, seen: &BTreeMap<VehicleId, Seen>) -> bool {
        let left = [Verdict::Hold(Reason::LeaseOver), Verdict::Land(Reason::LeaseOver)];
        let taken_out: Vec<_> = self.coordinator.taken_out().collect();
        let mut ways = self.coordinator.plan().ways.keys();
        ways.any(|vehicle| {
            let verdict = seen.get(vehicle).map(|seen| seen.verdict);
            verdict.is_some_and(|verdict| left.contains(&verdict)) && !taken_out.contains(vehicle)
        })
    }

    /// Ends the flight, so that its vehicles are free for the next who comes, and holds them.
    fn hold_all(&mut self, fleet: &mut Fleet, now: Duration) -> Vec<FlightEvent> {
        let vehicles: Vec<VehicleId> = self.coordinator.plan().ways.keys().copied().collect();
        for vehicle in vehicles {
            let is_held = fleet.vehicle(vehicle).is_none_or(|v| v.verdict().severity() > 0);
            if !is_held && !self.coordinator.taken_out().any(|out| out == vehicle) {
                // Refused on the ground, where there is nothing to hold.
                let _ = fleet.command(vehicle, &Command::Hold, now);
            }
        }
        self.stop();
        vec![FlightEvent::State(FlightState::Stopped)]
    }

    /// Carries out an order. What the fleet refuses it refuses for a reason that its own guard
    /// acts upon, and the next step sees.
    fn tell(
        &mut self,
        fleet: &mut Fleet,
        vehicle: VehicleId,
        order: Order,
        seen: &BTreeMap<VehicleId, Seen>,
        now: Duration,
    ) {
        let told = match order {
            Order::Fly(setpoint) => {
                self.told.remove(&vehicle);
                let _ = fleet.steer(vehicle, setpoint, now);
                return;
            }
            Order::Hold(_) => Told::Hold,
            Order::Land => Told::Land,
        };
        if self.told.insert(vehicle, told) == Some(told) {
            return;
        }
        // The guard of the fleet has done so itself.
        let own = seen.get(&vehicle).map_or(0, |seen| seen.verdict.severity());
        let _ = match told {
            Told::Hold if own < 1 => fleet.command(vehicle, &Command::Hold, now),
            Told::Land if own < 2 => fleet.command(vehicle, &Command::Land, now),
            _ => return,
        };
    }
}

/// What is seen of all vehicles whose place is known.
pub fn sight(fleet: &Fleet) -> BTreeMap<VehicleId, Seen> {
    let seen = |vehicle: &Vehicle| {
        let motion = vehicle.telemetry.motion?;
        let airborne = vehicle.telemetry.is_flying();
        let verdict = match vehicle.verdict() {
            Verdict::Continue if airborne && !vehicle.is_in_control() => {
                Verdict::Hold(Reason::NotInControl)
            }
            verdict => verdict,
        };
        let yaw = vehicle.telemetry.yaw.map_or(0.0, |(yaw, _)| yaw);
        let (position, velocity) = (motion.position, motion.velocity);
        Some((vehicle.id, Seen { position, velocity, yaw, airborne, verdict }))
    };
    fleet.vehicles().filter_map(seen).collect()
}
