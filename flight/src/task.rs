//! What a user wants of a vehicle, as steps that the vehicle's state proves done.

use std::{collections::VecDeque, time::Duration};

use nalgebra::Point3;

use crate::{
    Autopilot, Mode, Setpoint,
    message::CommandLong,
    telemetry::{Landed, Telemetry},
};

/// Time that PX4 wants to see setpoints before it flies to them.
const STREAM_LEAD: Duration = Duration::from_millis(700);
/// Refused arming is tried again: estimators take a while to trust their sensors.
pub(crate) const REFUSED_RETRY: Duration = Duration::from_secs(2);
/// For a change of mode and for arming, refusals included.
const READY_TIMEOUT: Duration = Duration::from_secs(30);
/// For leaving the ground after the order to.
const LIFT_TIMEOUT: Duration = Duration::from_secs(10);
/// For coming down from a room's height.
const LAND_TIMEOUT: Duration = Duration::from_secs(90);
/// How far from its height a take-off may end, meters.
const HEIGHT_TOLERANCE: f64 = 0.15;
/// A vehicle slower than this stands, meters per second.
const STANDING: f64 = 0.2;
/// For standing still after the order to.
const STOP_TIMEOUT: Duration = Duration::from_secs(10);
/// Height that counts as off the ground, meters.
const LIFTED: f64 = 0.3;

/// What a user wants of a vehicle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Command {
    /// Motors on.
    Arm,
    /// Motors off, on the ground.
    Disarm,
    /// Motors on if they are not, up, and hover.
    TakeOff {
        /// Above the place where it stands, meters.
        height: f64,
    },
    /// Fly straight to a place and stay there.
    Go {
        /// The place; its velocity is not used.
        setpoint: Setpoint,
        /// Distance that counts as there, meters.
        tolerance: f64,
        /// Time for it.
        timeout: Duration,
    },
    /// Stop and stay.
    Hold,
    /// Down where it is, motors off.
    Land,
    /// Motors off at once: it falls.
    CutMotors,
}

impl Command {
    /// Its name on the wire of the API.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Arm => "arm",
            Self::Disarm => "disarm",
            Self::TakeOff { .. } => "takeoff",
            Self::Go { .. } => "goto",
            Self::Hold => "hold",
            Self::Land => "land",
            Self::CutMotors => "stop",
        }
    }

    /// Whether every number in it can be flown.
    pub(crate) fn is_sane(&self) -> bool {
        match self {
            Self::TakeOff { height } => *height > 0.2 && *height < 100.0,
            Self::Go { setpoint, tolerance, .. } => {
                setpoint.is_finite() && *tolerance > 0.0 && tolerance.is_finite()
            }
            _ => true,
        }
    }
}

/// Number of a command, for life.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct CommandId(pub u64);

impl CommandId {
    /// Of what the guard commands by itself.
    pub const GUARD: Self = Self(0);
}

/// How far a command has come.
#[derive(Debug, Clone, PartialEq)]
pub enum CommandState {
    /// It will be sent.
    Accepted,
    /// Sent, not yet acknowledged.
    Sent,
    /// The vehicle is at it.
    Executing,
    /// Done, as the vehicle's state shows.
    Done,
    /// The vehicle refused, in its own words.
    Rejected(String),
    /// It did not happen in time.
    TimedOut,
    /// Another command took its place.
    Superseded,
}

impl CommandState {
    /// Its name on the wire of the API.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Accepted => "accepted",
            Self::Sent => "sent",
            Self::Executing => "executing",
            Self::Done => "done",
            Self::Rejected(_) => "rejected",
            Self::TimedOut => "timed_out",
            Self::Superseded => "superseded",
        }
    }

    /// Whether nothing more will come.
    pub fn is_final(&self) -> bool {
        !matches!(self, Self::Accepted | Self::Sent | Self::Executing)
    }
}

/// What a step waits for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Goal {
    Mode(Mode),
    Armed,
    Disarmed,
    OffGround {
        from: f64,
    },
    Height {
        z: f64,
    },
    Place {
        position: Point3<f64>,
        tolerance: f64,
    },
    Standing,
    /// The time of the step is over, and that is fine.
    Elapsed,
}

impl Goal {
    /// Whether the vehicle says so.
    pub(crate) fn is_reached(&self, telemetry: &Telemetry, autopilot: Autopilot) -> bool {
        let motion = telemetry.motion;
        match *self {
            Self::Mode(mode) => telemetry.mode(autopilot) == Some(mode),
            Self::Armed => telemetry.armed,
            Self::Disarmed => !telemetry.armed,
            Self::OffGround { from } => {
                telemetry.landed == Landed::Air
                    || motion.is_some_and(|m| m.position.z > from + LIFTED)
            }
            // What it says of the ground comes rarely, and decides what it may be told next.
            Self::Height { z } => {
                telemetry.is_flying()
                    && motion.is_some_and(|m| (m.position.z - z).abs() < HEIGHT_TOLERANCE)
            }
            Self::Place { position, tolerance } => motion.is_some_and(|m| {
                (m.position - position).norm() < tolerance && m.velocity.norm() < STANDING
            }),
            Self::Standing => motion.is_some_and(|m| m.velocity.norm() < STANDING),
            Self::Elapsed => false,
        }
    }
}

/// What to do about a message that is refused or not answered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Persistence {
    /// A refusal is the end.
    Once,
    /// A refusal may be temporary.
    Refusals,
    /// Again and again, as quickly as can be.
    Always,
}

/// One step of a command.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Step {
    /// Sent, and repeated until acknowledged.
    pub(crate) send: Option<CommandLong>,
    /// What to do when that does not work.
    pub(crate) persistence: Persistence,
    /// Flown to from the start of the step.
    pub(crate) steer: Option<Setpoint>,
    /// Proves the step.
    pub(crate) goal: Goal,
    pub(crate) timeout: Duration,
}

impl Step {
    fn wait(goal: Goal, timeout: Duration) -> Self {
        Self { send: None, persistence: Persistence::Once, steer: None, goal, timeout }
    }

    fn send(command: CommandLong, goal: Goal, timeout: Duration) -> Self {
        Self { send: Some(command), ..Self::wait(goal, timeout) }
    }

    fn with(self, persistence: Persistence) -> Self {
        Self { persistence, ..self }
    }

    fn steer(setpoint: Setpoint, goal: Goal, timeout: Duration) -> Self {
        Self { steer: Some(setpoint), ..Self::wait(goal, timeout) }
    }
}

/// The steps of `command` for a vehicle that is at `here` and would stop at `stop`.
pub(crate) fn steps(
    command: &Command,
    autopilot: Autopilot,
    here: Setpoint,
    stop: Setpoint,
) -> VecDeque<Step> {
    match *command {
        Command::Arm => arm(autopilot, here),
        Command::Disarm => {
            [Step::send(CommandLong::disarm(), Goal::Disarmed, READY_TIMEOUT)].into()
        }
        Command::TakeOff { height } => {
            let from = here.position.z;
            let mut above = here;
            above.position.z += height;
            // Twice the time at a slow climb.
            let climb = LIFT_TIMEOUT + Duration::from_secs_f64(height / 0.15);
            let up = Goal::Height { z: above.position.z };
            let mut steps = arm(autopilot, here);
            if autopilot.needs_stream() {
                steps.push_back(Step::steer(above, up, climb));
            } else {
                let lifted = Goal::OffGround { from };
                steps.push_back(Step::send(CommandLong::take_off(height), lifted, LIFT_TIMEOUT));
                steps.push_back(Step::wait(up, climb));
                steps.push_back(Step::steer(above, up, STOP_TIMEOUT));
            }
            steps
        }
        Command::Go { setpoint, tolerance, timeout } => {
            let goal = Goal::Place { position: setpoint.position, tolerance };
            [Step::steer(Setpoint { velocity: Default::default(), ..setpoint }, goal, timeout)]
                .into()
        }
        Command::Hold => [Step::steer(stop, Goal::Standing, STOP_TIMEOUT)].into(),
        Command::Land => {
            let land = if autopilot.needs_stream() {
                CommandLong::set_mode(autopilot.mode_params(Mode::Land))
            } else {
                CommandLong::land()
            };
            let landing = Step::send(land, Goal::Mode(Mode::Land), READY_TIMEOUT);
            [landing.with(Persistence::Always), Step::wait(Goal::Disarmed, LAND_TIMEOUT)].into()
        }
        Command::CutMotors => {
            let cut = Step::send(CommandLong::cut_motors(), Goal::Disarmed, READY_TIMEOUT);
            [cut.with(Persistence::Always)].into()
        }
    }
}

fn arm(autopilot: Autopilot, here: Setpoint) -> VecDeque<Step> {
    let mut steps = VecDeque::new();
    if autopilot.needs_stream() {
        steps.push_back(Step::steer(here, Goal::Elapsed, STREAM_LEAD));
    }
    let guided = CommandLong::set_mode(autopilot.mode_params(Mode::Guided));
    let goal = Goal::Mode(Mode::Guided);
    let patient = Persistence::Refusals;
    steps.push_back(Step::send(guided, goal, READY_TIMEOUT).with(patient));
    steps.push_back(Step::send(CommandLong::arm(), Goal::Armed, READY_TIMEOUT).with(patient));
    steps
}
