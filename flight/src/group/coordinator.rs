//! Flies a plan: one clock for the whole group.

mod step;

use std::collections::BTreeMap;
use std::time::Duration;

use nalgebra::{Point3, Vector3};

use super::{Deconfliction, FlightPlan, Guard, Rules, Task, Violation};
use crate::motion::{LegKind, Waypoint};
use crate::watchdog::{Reason, Verdict};
use crate::{Setpoint, VehicleId};

/// Life of a flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum FlightState {
    /// Planned and checked, not started.
    Ready,
    /// The clock runs, or stands until somebody has caught up.
    Running,
    /// Everybody waits in the air.
    Paused,
    /// All that still fly have arrived; they stay there.
    Finished,
    /// Everybody lands.
    Aborted,
    /// Aborted where everybody was: nobody is landed, others command those who fly.
    Stopped,
}

impl FlightState {
    /// Stable name of the state.
    pub fn code(self) -> &'static str {
        match self {
            Self::Ready => "ready",
            Self::Running => "running",
            Self::Paused => "paused",
            Self::Finished => "finished",
            Self::Aborted | Self::Stopped => "aborted",
        }
    }

    /// Nothing comes after it.
    pub fn is_over(self) -> bool {
        matches!(self, Self::Finished | Self::Aborted | Self::Stopped)
    }
}

/// What is seen of a vehicle now.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// Where it is in the map.
    pub position: Point3<f64>,
    /// How it moves in the map.
    pub velocity: Vector3<f64>,
    /// Yaw in the map.
    pub yaw: f64,
    /// Whether it flies.
    pub airborne: bool,
    /// What its watchdog says.
    pub verdict: Verdict,
}

/// What a vehicle shall do now.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Order {
    /// Be here. Comes with every step.
    Fly(Setpoint),
    /// Stop and stay at this place.
    Hold(Setpoint),
    /// Land where it is.
    Land,
}

/// What happened in a flight.
#[derive(Debug, Clone, PartialEq)]
pub enum FlightEvent {
    /// The state changed.
    State(FlightState),
    /// A vehicle began a leg: at a `View` its frame is wanted.
    Leg {
        /// Who.
        vehicle: VehicleId,
        /// Number of the leg on its way.
        index: usize,
        /// What the leg is for.
        kind: LegKind,
    },
    /// A vehicle holds.
    Held {
        /// Who.
        vehicle: VehicleId,
        /// Why.
        reason: Reason,
    },
    /// A vehicle goes on.
    Released {
        /// Who.
        vehicle: VehicleId,
    },
    /// The clock runs at less than half of its rate for this vehicle, or stands, until it is on
    /// time, released or landed.
    ClockHeld {
        /// For whom.
        vehicle: VehicleId,
    },
    /// The clock runs fully again.
    ClockRuns,
    /// A vehicle is out of the flight and lands.
    TakenOut {
        /// Who.
        vehicle: VehicleId,
        /// Why; none if the flight was aborted.
        reason: Option<Reason>,
    },
    /// A vehicle that was taken out is on the ground.
    Landed {
        /// Who.
        vehicle: VehicleId,
    },
    /// The others have new ways round those who landed.
    Replanned,
    /// A vehicle has no way to its goals any more and stays where it is; if it cannot stay either,
    /// the flight pauses.
    NoWay {
        /// Who.
        vehicle: VehicleId,
    },
}

/// Orders and events of one step.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Tick {
    /// What each vehicle shall do; nothing before the start.
    pub orders: BTreeMap<VehicleId, Order>,
    /// What happened.
    pub events: Vec<FlightEvent>,
}

/// How a plan is flown.
#[derive(Debug, Clone, PartialEq)]
pub struct FlightOptions {
    /// What the plan was checked against.
    pub rules: Rules,
    /// How new ways are found when somebody drops out.
    pub how: Deconfliction,
    /// Keeps vehicles apart whatever the plan says.
    pub guard: Guard,
    /// A vehicle that is nearer than this to its start or its goal is there. Meters.
    pub there: f64,
    /// A vehicle that is nearer than this to its place on the way is on time. Meters.
    pub on_time: f64,
    /// The clock of all stands while a vehicle is farther than this from its place, and runs the
    /// slower the nearer it comes to that. Meters.
    pub lag: f64,
    /// How far a landing vehicle may stray. Meters.
    pub drift: f64,
}

impl FlightOptions {
    /// There within 0.15 m, on time within 0.2 m, the clock stands beyond 0.5 m; landing vehicles stray by 0.5 m.
    pub fn new(rules: Rules, how: Deconfliction) -> Self {
        let guard = Guard { separation: rules.separation, ..Guard::default() };
        Self { rules, how, guard, there: 0.15, on_time: 0.2, lag: 0.5, drift: 0.5 }
    }
}

/// Why a flight does not start.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum StartRefused {
    /// It runs already, or is over.
    #[error("the flight is {} and cannot start", .state.code())]
    State {
        /// Its state.
        state: FlightState,
    },
    /// Vehicles are not at their starts.
    #[error("{} vehicles are not at their starts", .0.len())]
    Starts(Vec<Violation>),
    /// A vehicle is on the ground.
    #[error("vehicle {} is not in the air", .vehicle.0)]
    NotAirborne {
        /// Which one.
        vehicle: VehicleId,
    },
    /// The watchdog of a vehicle does not let it fly.
    #[error("vehicle {} is not fit to fly: {}", .vehicle.0, .reason.code())]
    Unfit {
        /// Which one.
        vehicle: VehicleId,
        /// Why.
        reason: Reason,
    },
}

/// What a member of the group does.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Role {
    /// Follows its way.
    Flying,
    /// Stays here.
    Held(Waypoint),
    /// Out of the flight, going down.
    Landing,
    /// Out of the flight, down.
    Landed(Point3<f64>),
}

#[derive(Debug, Clone)]
struct Member {
    role: Role,
    leg: Option<usize>,
}

/// Flies a plan. Knows no sockets and no time: [`poll`](Self::poll) takes what is seen and gives
/// what shall be done.
///
/// All vehicles share one clock, which says where on its way each shall be. It runs as slowly as
/// the slowest vehicle flies, so that nobody meets whom the plan lets pass. Its rate changes
/// smoothly; velocities of setpoints scale with it.
#[derive(Debug, Clone)]
pub struct Coordinator {
    plan: FlightPlan,
    tasks: Vec<Task>,
    options: FlightOptions,
    state: FlightState,
    members: BTreeMap<VehicleId, Member>,
    /// Seconds on the plan.
    clock: f64,
    /// How fast the clock runs, 0 to 1.
    rate: f64,
    clock_held_by: Option<VehicleId>,
    /// Somebody who landed lies in the way of others.
    replan: bool,
    begins: Option<Duration>,
    polled: Option<Duration>,
}

impl Coordinator {
    /// Takes a plan that passes its check. `tasks` are what it was made of: with them new ways can
    /// be found when a vehicle drops out; without, the flight pauses then.
    ///
    /// # Errors
    ///
    /// Everything that is wrong with the plan.
    pub fn new(
        plan: FlightPlan,
        tasks: Vec<Task>,
        mut options: FlightOptions,
    ) -> Result<Self, Vec<Violation>> {
        let violations = plan.check(&options.rules);
        if !violations.is_empty() {
            return Err(violations);
        }
        // They will have moved on when new ways are looked for; the guard sees where they are.
        options.rules.others.clear();
        let flying = Member { role: Role::Flying, leg: None };
        let members = plan.ways.keys().map(|&vehicle| (vehicle, flying.clone())).collect();
        Ok(Self {
            plan,
            tasks,
            options,
            state: FlightState::Ready,
            members,
            clock: 0.0,
            rate: 0.0,
            clock_held_by: None,
            replan: false,
            begins: None,
            polled: None,
        })
    }

    /// Starts at the time `at`, if everybody is fit, in the air and at the start.
    ///
    /// # Errors
    ///
    /// The first thing that is missing.
    pub fn start(
        &mut self,
        at: Duration,
        seen: &BTreeMap<VehicleId, Seen>,
    ) -> Result<(), StartRefused> {
        if self.state != FlightState::Ready {
            return Err(StartRefused::State { state: self.state });
        }
        let places = seen.iter().map(|(&vehicle, seen)| (vehicle, seen.position)).collect();
        let astray = self.plan.check_starts(&places, &self.options.rules);
        if !astray.is_empty() {
            return Err(StartRefused::Starts(astray));
        }
        for &vehicle in self.plan.ways.keys() {
            match seen[&vehicle] {
                Seen { airborne: false, .. } => return Err(StartRefused::NotAirborne { vehicle }),
                Seen { verdict: Verdict::Hold(reason) | Verdict::Land(reason), .. } => {
                    return Err(StartRefused::Unfit { vehicle, reason });
                }
                _ => {}
            }
        }
        self.begins = Some(at);
        Ok(())
    }

    /// Whether it was started, also before its first step.
    pub fn is_started(&self) -> bool {
        self.begins.is_some()
    }

    /// Everybody waits in the air; true if it was flying.
    pub fn pause(&mut self) -> bool {
        self.change(FlightState::Running, FlightState::Paused)
    }

    /// Goes on after a pause; true if it was paused.
    pub fn resume(&mut self) -> bool {
        self.change(FlightState::Paused, FlightState::Running)
    }

    /// Everybody lands, one above another waiting until its column is free.
    pub fn abort(&mut self) -> bool {
        let goes_on = !self.state.is_over();
        if goes_on {
            self.state = FlightState::Aborted;
        }
        goes_on
    }

    /// Nobody is ordered anything any more.
    pub(crate) fn stop(&mut self) {
        if !self.state.is_over() {
            self.state = FlightState::Stopped;
        }
    }

    /// A member lands, by the order of somebody else; the others go on.
    pub(crate) fn take_out(&mut self, vehicle: VehicleId) {
        if let Some(member) = self.members.get_mut(&vehicle)
            && matches!(member.role, Role::Flying | Role::Held(_))
        {
            member.role = Role::Landing;
        }
    }

    fn change(&mut self, from: FlightState, to: FlightState) -> bool {
        let fits = self.state == from;
        if fits {
            self.state = to;
        }
        fits
    }

    /// State of the flight.
    pub fn state(&self) -> FlightState {
        self.state
    }

    /// How the plan is flown.
    pub fn options(&self) -> &FlightOptions {
        &self.options
    }

    /// The plan as it is flown now.
    pub fn plan(&self) -> &FlightPlan {
        &self.plan
    }

    /// Time on the plan.
    pub fn clock(&self) -> Duration {
        Duration::from_secs_f64(self.clock)
    }

    /// The vehicle that the clock is slowed for.
    pub fn clock_held_by(&self) -> Option<VehicleId> {
        self.clock_held_by
    }

    /// Whether somebody is still in the air.
    pub fn is_landing(&self) -> bool {
        self.members.values().any(|member| !matches!(member.role, Role::Landed(_)))
    }

    /// Vehicles that are out of the flight.
    pub fn taken_out(&self) -> impl Iterator<Item = VehicleId> + '_ {
        let out = |member: &Member| matches!(member.role, Role::Landing | Role::Landed(_));
        self.members.iter().filter(move |(_, member)| out(member)).map(|(&vehicle, _)| vehicle)
    }
}

#[cfg(test)]
mod tests;
