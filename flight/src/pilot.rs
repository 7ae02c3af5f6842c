//! Flies one vehicle: the present command step by step, and the stream of setpoints.

use std::{collections::VecDeque, time::Duration};

use mavlink::dialects::ardupilotmega::{MavCmd, MavMessage, MavResult};

use crate::{
    Autopilot, Mode, Setpoint, VehicleId,
    command::{Acknowledgement, CommandStep, PendingCommand},
    event::{Alert, Happening},
    message,
    task::{CommandId, CommandState, Goal, Persistence, REFUSED_RETRY, Step},
    telemetry::Telemetry,
};

/// Between setpoints: as often as a vehicle should get them.
const STREAM_INTERVAL: Duration = Duration::from_millis(50);
/// Between the first setpoints of an emergency, and how many.
const BURST_INTERVAL: Duration = Duration::from_millis(20);
const BURST: u32 = 5;
/// Heartbeats in another mode before it counts: one can come late.
const FOREIGN_HEARTBEATS: u32 = 2;
/// Texts kept to explain a refusal.
const KEPT_TEXTS: usize = 4;

#[derive(Debug, Clone)]
struct Stream {
    setpoint: Setpoint,
    next: Duration,
    burst: u32,
}

#[derive(Debug, Clone)]
struct Task {
    id: CommandId,
    state: CommandState,
    steps: VecDeque<Step>,
    /// When the first of the steps began; `None` before it did.
    started: Option<Duration>,
    pending: Option<PendingCommand>,
    /// When a refused command is tried again.
    retry_at: Option<Duration>,
    refusal: Option<MavResult>,
}

/// Who is flown.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Flown<'a> {
    pub(crate) id: VehicleId,
    pub(crate) autopilot: Autopilot,
    pub(crate) telemetry: &'a Telemetry,
}

/// The hands on one vehicle.
#[derive(Debug, Clone, Default)]
pub(crate) struct Pilot {
    task: Option<Task>,
    stream: Option<Stream>,
    /// The mode it was told to be in and has been seen in.
    expected_mode: Option<Mode>,
    foreign_heartbeats: u32,
    texts: VecDeque<String>,
}

impl Pilot {
    /// Whether the vehicle flies to our setpoints.
    pub(crate) fn is_in_control(&self) -> bool {
        self.expected_mode == Some(Mode::Guided)
    }

    /// Where the vehicle is told to be.
    pub(crate) fn setpoint(&self) -> Option<&Setpoint> {
        self.stream.as_ref().map(|stream| &stream.setpoint)
    }

    /// Takes a new command in place of the present one.
    pub(crate) fn begin(&mut self, id: CommandId, steps: VecDeque<Step>) -> Vec<Happening> {
        let mut happenings = self.finish(CommandState::Superseded);
        self.texts.clear();
        let state = CommandState::Accepted;
        happenings.push(Happening::Command { id, state: state.clone() });
        self.task = Some(Task {
            id,
            state,
            steps,
            started: None,
            pending: None,
            retry_at: None,
            refusal: None,
        });
        happenings
    }

    /// Setpoints go to another place from now on.
    pub(crate) fn steer(&mut self, setpoint: Setpoint, now: Duration) {
        match &mut self.stream {
            Some(stream) => stream.setpoint = setpoint,
            None => self.stream = Some(Stream { setpoint, next: now, burst: 0 }),
        }
    }

    /// The next setpoints come at once and close together, so that one of them arrives.
    pub(crate) fn hurry(&mut self, now: Duration) {
        if let Some(stream) = &mut self.stream {
            stream.next = now;
            stream.burst = BURST;
        }
    }

    /// Forgets everything: the vehicle has started anew.
    pub(crate) fn reset(&mut self) -> Vec<Happening> {
        let happenings = self.finish(CommandState::Rejected("the vehicle restarted".to_owned()));
        *self = Self::default();
        happenings
    }

    /// Ends the present command. Its setpoint goes on: a vehicle in flight needs one.
    pub(crate) fn finish(&mut self, state: CommandState) -> Vec<Happening> {
        let ended = self.task.take().map(|task| Happening::Command { id: task.id, state });
        ended.into_iter().collect()
    }

    /// Keeps a text of the vehicle to explain a refusal.
    pub(crate) fn hear(&mut self, text: &str) {
        if self.texts.len() == KEPT_TEXTS {
            self.texts.pop_front();
        }
        self.texts.push_back(text.to_owned());
    }

    /// Looks at the mode of a heartbeat.
    pub(crate) fn heartbeat(&mut self, flown: Flown<'_>) -> Vec<Happening> {
        let is_changing = self.task.as_ref().is_some_and(|task| {
            task.steps.front().is_some_and(|step| matches!(step.goal, Goal::Mode(_)))
        });
        let as_told = match self.expected_mode {
            None => true,
            Some(mode) => is_changing || flown.telemetry.mode(flown.autopilot) == Some(mode),
        };
        self.foreign_heartbeats = if as_told { 0 } else { self.foreign_heartbeats + 1 };
        if self.foreign_heartbeats < FOREIGN_HEARTBEATS {
            return Vec::new();
        }
        self.foreign_heartbeats = 0;
        self.expected_mode = None;
        self.stream = None;
        let reason = "the vehicle left the mode that it was told to be in".to_owned();
        let mut happenings = self.finish(CommandState::Rejected(reason));
        happenings.push(Happening::Alert(Alert::ControlTaken));
        happenings
    }

    /// Takes an acknowledgement.
    pub(crate) fn acknowledge(
        &mut self,
        command: MavCmd,
        result: MavResult,
        now: Duration,
    ) -> Vec<Happening> {
        let Some(task) = &mut self.task else { return Vec::new() };
        let (Some(step), Some(pending)) = (task.steps.front(), &mut task.pending) else {
            return Vec::new();
        };
        if pending.command().command != command {
            return Vec::new();
        }
        match pending.acknowledge(result, now) {
            Acknowledgement::InProgress => {}
            // From here the state of the vehicle decides.
            Acknowledgement::Accepted => task.pending = None,
            Acknowledgement::Refused { result } => {
                let decides = step.persistence == Persistence::Once && !pending.was_repeated();
                task.refusal = Some(result);
                task.pending = None;
                if step.persistence != Persistence::Once {
                    task.retry_at = Some(now + REFUSED_RETRY);
                } else if decides {
                    let state = self.rejected(result);
                    return self.finish(state);
                }
            }
        }
        Vec::new()
    }

    fn rejected(&self, result: MavResult) -> CommandState {
        let mut reason = format!("{result:?}");
        for text in &self.texts {
            reason.push_str("; ");
            reason.push_str(text);
        }
        CommandState::Rejected(reason)
    }

    /// What to send at `now`.
    pub(crate) fn poll(
        &mut self,
        flown: Flown<'_>,
        now: Duration,
        out: &mut Vec<MavMessage>,
    ) -> Vec<Happening> {
        let happenings = self.advance(flown, now, out);
        if let Some(stream) = &mut self.stream
            && now >= stream.next
        {
            let interval = if stream.burst > 0 { BURST_INTERVAL } else { STREAM_INTERVAL };
            stream.burst = stream.burst.saturating_sub(1);
            // Late once does not mean late for good, but missed ones are not made up for.
            stream.next = (stream.next + interval).max(now);
            out.push(message::position_target(flown.id, &stream.setpoint, now));
        }
        happenings
    }

    fn advance(
        &mut self,
        flown: Flown<'_>,
        now: Duration,
        out: &mut Vec<MavMessage>,
    ) -> Vec<Happening> {
        let mut happenings = Vec::new();
        while let Some(mut task) = self.task.take() {
            let id = task.id;
            let state = match self.step(&mut task, flown, now, out) {
                Progress::StepDone => {
                    task.steps.pop_front();
                    task.started = None;
                    task.pending = None;
                    task.retry_at = None;
                    if !task.steps.is_empty() {
                        self.task = Some(task);
                        continue;
                    }
                    CommandState::Done
                }
                Progress::End(state) => {
                    if !flown.telemetry.armed {
                        self.stream = None;
                    }
                    state
                }
                Progress::Under(state) if state == task.state => {
                    self.task = Some(task);
                    break;
                }
                Progress::Under(state) => {
                    task.state = state.clone();
                    self.task = Some(task);
                    happenings.push(Happening::Command { id, state });
                    break;
                }
            };
            happenings.push(Happening::Command { id, state });
        }
        happenings
    }

    fn step(
        &mut self,
        task: &mut Task,
        flown: Flown<'_>,
        now: Duration,
        out: &mut Vec<MavMessage>,
    ) -> Progress {
        let Some(step) = task.steps.front() else { return Progress::StepDone };
        let Step { send, persistence, steer, goal, timeout } = *step;
        let urgent = persistence == Persistence::Always;
        let pending = || send.map(|command| PendingCommand::new(command, urgent));
        if task.started.is_none() {
            task.pending = pending();
            if let Some(setpoint) = steer {
                self.steer(setpoint, now);
            }
        }
        let over = now >= *task.started.get_or_insert(now) + timeout;
        let reached = match goal {
            Goal::Elapsed => over,
            goal => goal.is_reached(flown.telemetry, flown.autopilot),
        };
        if reached {
            self.reached(goal);
            return Progress::StepDone;
        }
        if over {
            return Progress::End(
                task.refusal.map_or(CommandState::TimedOut, |result| self.rejected(result)),
            );
        }
        if task.retry_at.is_some_and(|at| now >= at) {
            task.retry_at = None;
            task.pending = pending();
        }
        match task.pending.as_mut().map(|pending| (pending.poll(now), *pending.command())) {
            Some((CommandStep::Send { confirmation }, command)) => {
                out.push(command.message(flown.id, confirmation));
            }
            // What may be said again is said until its time is over.
            Some((CommandStep::GiveUp, _)) if persistence != Persistence::Once => {
                task.pending = None;
                task.retry_at = Some(now);
            }
            Some((CommandStep::GiveUp, _)) => return Progress::End(CommandState::TimedOut),
            Some((CommandStep::Wait, _)) | None => {}
        }
        let unsent = task.pending.is_some() && task.state != CommandState::Executing;
        Progress::Under(if unsent { CommandState::Sent } else { CommandState::Executing })
    }

    fn reached(&mut self, goal: Goal) {
        match goal {
            Goal::Mode(mode) => {
                self.expected_mode = Some(mode);
                self.foreign_heartbeats = 0;
                if mode != Mode::Guided {
                    self.stream = None;
                }
            }
            Goal::Disarmed => self.stream = None,
            _ => {}
        }
    }
}

/// How far the first step of a task is.
enum Progress {
    StepDone,
    Under(CommandState),
    End(CommandState),
}
