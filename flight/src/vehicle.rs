//! One vehicle: its link, its estimator's feed, its pilot and its guard.

mod guard;

use core::net::SocketAddr;
use std::time::Duration;

use mavlink::dialects::ardupilotmega::MavMessage;
use nalgebra::Point3;

use crate::{
    Autopilot, Setpoint, VehicleId,
    event::{Alert, Happening},
    feed::{Feed, FeedState, PoseFix, PoseRefusal},
    frames::local_from_map_pose,
    link::{Link, LinkState},
    message::{self, VisionMessage},
    pilot::{Flown, Pilot},
    refusal::CommandRefusal,
    task::{self, Command, CommandId, CommandState},
    telemetry::{Telemetry, uptime},
    watchdog::{Reason, Verdict, WatchdogLimits, judge},
};

/// Braking that every multicopter manages, meters per second squared.
const BRAKING: f64 = 1.5;
/// A setpoint of a plan that is not renewed for this long ends in a hold.
const STEER_TIMEOUT: Duration = Duration::from_millis(500);
/// Somebody else who sends with its number is remembered for this long.
const IMPOSTOR_MEMORY: Duration = Duration::from_secs(3);

/// One vehicle.
#[derive(Debug, Clone)]
pub struct Vehicle {
    /// Its number.
    pub id: VehicleId,
    /// What flies it.
    pub autopilot: Autopilot,
    /// Where its messages come from and ours go.
    pub address: SocketAddr,
    /// What it says of itself.
    pub telemetry: Telemetry,
    /// Which message carries its poses.
    pub vision: VisionMessage,
    pub(crate) link: Link,
    pub(crate) feed: Feed,
    link_state: LinkState,
    pilot: Pilot,
    /// What the watchdog has done about it.
    verdict: Verdict,
    limits: WatchdogLimits,
    /// Setpoints of a plan must be renewed before this.
    steer_until: Option<Duration>,
    lease_until: Option<Duration>,
    /// Another vehicle answers from the same address.
    pub(crate) shares_address: bool,
    impostor_at: Option<Duration>,
    refusing_poses: bool,
}

impl Vehicle {
    pub(crate) fn new(
        id: VehicleId,
        autopilot: Autopilot,
        address: SocketAddr,
        now: Duration,
    ) -> Self {
        Self {
            id,
            autopilot,
            address,
            telemetry: Telemetry::default(),
            vision: VisionMessage::default(),
            link: Link::new(now),
            feed: Feed::default(),
            link_state: LinkState::Seen,
            pilot: Pilot::default(),
            verdict: Verdict::Continue,
            limits: WatchdogLimits::default(),
            steer_until: None,
            lease_until: None,
            shares_address: false,
            impostor_at: None,
            refusing_poses: false,
        }
    }

    /// The link: silence, loss, clock.
    pub fn link(&self) -> &Link {
        &self.link
    }

    /// Whether its estimator follows our poses.
    pub fn feed_state(&self) -> FeedState {
        self.feed.state()
    }

    /// The latest pose that was sent to it.
    pub fn last_pose(&self) -> Option<&PoseFix> {
        self.feed.last()
    }

    /// Where it is told to be.
    pub fn setpoint(&self) -> Option<&Setpoint> {
        self.pilot.setpoint()
    }

    /// Whether it flies to our setpoints.
    pub fn is_in_control(&self) -> bool {
        self.pilot.is_in_control()
    }

    /// What the watchdog has done about it.
    pub fn verdict(&self) -> Verdict {
        self.verdict
    }

    /// Where it is and looks, standing; `None` when its estimator does not know.
    pub fn here(&self) -> Option<Setpoint> {
        let (motion, (yaw, _)) = (self.telemetry.motion?, self.telemetry.yaw?);
        let known = self.telemetry.position_known == Some(true);
        known.then(|| Setpoint::at(motion.position, yaw))
    }

    /// Where it would stop if it braked now.
    pub fn stopping_point(&self) -> Option<Setpoint> {
        let velocity = self.telemetry.motion?.velocity;
        let here = self.here()?;
        let ahead = velocity * (velocity.norm() / (2.0 * BRAKING));
        Some(Setpoint { position: here.position + ahead, ..here })
    }

    /// Takes a message that is known to come from this vehicle.
    pub(crate) fn take(
        &mut self,
        sequence: u8,
        message: &MavMessage,
        now: Duration,
    ) -> (Option<MavMessage>, Vec<Happening>) {
        let mut happenings = Vec::new();
        let (answer, rebooted) = self.link.take(self.id, sequence, message, now);
        if rebooted {
            self.telemetry = Telemetry::default();
            self.feed = Feed::default();
            self.verdict = Verdict::Continue;
            happenings.push(Happening::Rebooted);
            happenings.extend(self.pilot.reset());
        }
        let uptime = uptime(message);
        if uptime.is_some() && uptime < self.telemetry.uptime {
            // Overtaken on the way: what is known is newer.
            return (answer, happenings);
        }
        self.telemetry.uptime = uptime.or(self.telemetry.uptime);
        let before = (self.telemetry.armed, self.telemetry.custom_mode, self.telemetry.landed);
        let so_at = uptime.map_or(now, |uptime| self.link.time_of(uptime, now));
        self.telemetry.take(message, so_at);
        let Telemetry { armed, custom_mode, landed, .. } = self.telemetry;
        if armed != before.0 {
            happenings.push(Happening::Armed(armed));
        }
        if let Some(mode) = custom_mode
            && before.1 != custom_mode
        {
            happenings.push(Happening::Mode(mode));
        }
        if landed != before.2 {
            happenings.push(Happening::Landed(landed));
        }
        match message {
            MavMessage::HEARTBEAT(_) => {
                let flown =
                    Flown { id: self.id, autopilot: self.autopilot, telemetry: &self.telemetry };
                happenings.extend(self.pilot.heartbeat(flown));
            }
            MavMessage::COMMAND_ACK(ack) => {
                happenings.extend(self.pilot.acknowledge(ack.command, ack.result, now));
            }
            MavMessage::STATUSTEXT(m) => {
                let text = m.text.to_str().unwrap_or_default().to_owned();
                self.pilot.hear(&text);
                happenings.push(Happening::Text { severity: m.severity as u8, text });
            }
            _ => {}
        }
        (answer, happenings)
    }

    /// Checks a pose. Returns the message that carries it.
    pub(crate) fn check_pose(
        &mut self,
        fix: PoseFix,
        max_age: Duration,
        now: Duration,
    ) -> (Result<MavMessage, PoseRefusal>, Option<Happening>) {
        if matches!(self.feed.state(), FeedState::Idle | FeedState::Origin) {
            return (Err(PoseRefusal::NotFed), None);
        }
        let resets = self.feed.gate().reset_counter();
        let way = self.link.round_trip().unwrap_or_default() / 2;
        match self.feed.gate().check(fix, &self.telemetry, max_age, way, now) {
            Ok(reset_counter) => {
                self.refusing_poses = false;
                let relocated =
                    (reset_counter != resets && self.telemetry.is_flying()).then(|| {
                        let place = Point3::from(fix.map_from_body.translation.vector);
                        let distance =
                            self.here().map_or(0.0, |here| (here.position - place).norm());
                        Happening::Alert(Alert::Relocated(distance))
                    });
                let local_from_body = local_from_map_pose(&fix.map_from_body);
                let sd = Some((fix.position_sd, fix.angle_sd));
                let kind = self.vision;
                let message =
                    message::vision_pose(kind, &local_from_body, fix.captured, sd, reset_counter);
                (Ok(message), relocated)
            }
            Err(refusal) => {
                let is_new = !self.refusing_poses && refusal != PoseRefusal::NotNewer;
                self.refusing_poses |= is_new;
                let alert = is_new.then_some(Happening::Alert(Alert::PoseRefused(refusal)));
                (Err(refusal), alert)
            }
        }
    }

    /// Takes a command, if the vehicle can follow it.
    pub(crate) fn command(
        &mut self,
        id: CommandId,
        command: &Command,
        now: Duration,
    ) -> Result<Vec<Happening>, CommandRefusal> {
        let before = (self.lease_until, self.verdict);
        if self.lease_until.is_some_and(|until| until <= now) {
            // Whoever commands is there: the lease of somebody who is not binds no more.
            self.lease_until = None;
            if self.verdict == Verdict::Hold(Reason::LeaseOver) {
                self.verdict = judge(&self.health(now), &self.limits);
            }
        }
        if let Err(refusal) = self.check_command(command, now) {
            (self.lease_until, self.verdict) = before;
            return Err(refusal);
        }
        let nowhere = Setpoint::at(nalgebra::Point3::origin(), 0.0);
        let here = self.here().unwrap_or(nowhere);
        let stop = self.stopping_point().unwrap_or(nowhere);
        self.steer_until = None;
        Ok(self.pilot.begin(id, task::steps(command, self.autopilot, here, stop)))
    }

    fn check_command(&self, command: &Command, now: Duration) -> Result<(), CommandRefusal> {
        if !command.is_sane() {
            return Err(CommandRefusal::BadNumber);
        }
        let flying = self.telemetry.is_flying();
        if matches!(command, Command::Land | Command::CutMotors) {
            // Never refused: at worst nobody hears them.
            return Ok(());
        }
        if self.link.state(now) != LinkState::Linked {
            return Err(CommandRefusal::NotLinked);
        }
        let ready = self.feed.state() == FeedState::Ready && self.here().is_some();
        match command {
            Command::Arm | Command::TakeOff { .. } => {
                let impostor =
                    self.impostor_at.is_some_and(|at| now.saturating_sub(at) < IMPOSTOR_MEMORY);
                if self.shares_address || impostor {
                    return Err(CommandRefusal::Conflict);
                }
                if flying && !matches!(command, Command::Arm) {
                    return Err(CommandRefusal::Flying);
                }
                if ready { Ok(()) } else { Err(CommandRefusal::NotReady) }
            }
            Command::Disarm if flying => Err(CommandRefusal::Flying),
            Command::Go { .. } | Command::Hold if !flying => Err(CommandRefusal::NotFlying),
            Command::Go { .. } | Command::Hold if !self.is_in_control() => {
                Err(CommandRefusal::NotInControl)
            }
            Command::Go { .. } if !ready || self.verdict != Verdict::Continue => {
                Err(CommandRefusal::NotReady)
            }
            Command::Hold if self.here().is_none() => Err(CommandRefusal::NotReady),
            _ => Ok(()),
        }
    }

    /// Whether it would follow setpoints now.
    pub(crate) fn may_steer(&self, now: Duration) -> Result<(), CommandRefusal> {
        let setpoint = Setpoint::at(nalgebra::Point3::origin(), 0.0);
        let there = Command::Go { setpoint, tolerance: 1.0, timeout: STEER_TIMEOUT };
        self.check_command(&there, now)
    }

    /// Steers a vehicle in flight to a setpoint of a plan, which must be renewed.
    pub(crate) fn steer(
        &mut self,
        setpoint: Setpoint,
        now: Duration,
    ) -> Result<Vec<Happening>, CommandRefusal> {
        if !setpoint.is_finite() {
            return Err(CommandRefusal::BadNumber);
        }
        self.may_steer(now)?;
        self.steer_until = Some(now + STEER_TIMEOUT);
        self.pilot.steer(setpoint, now);
        Ok(self.pilot.finish(CommandState::Superseded))
    }

    /// Somebody promises to be there until `until`, or need not be there any more.
    pub(crate) fn lease(&mut self, until: Option<Duration>) {
        self.lease_until = until;
    }

    /// Stops a vehicle in flight at once, and disarms one on the ground.
    pub(crate) fn all_stop(&mut self, id: CommandId, now: Duration) -> Option<Vec<Happening>> {
        let command = if self.telemetry.is_flying() { Command::Hold } else { Command::Disarm };
        if !self.telemetry.armed {
            return None;
        }
        let mut happenings = self.command(id, &command, now).ok()?;
        happenings.extend(self.poll(now, &mut Vec::new()));
        self.pilot.hurry(now);
        Some(happenings)
    }

    /// Remembers that `from` sends with the number of this vehicle. Returns an alert when that is
    /// news.
    pub(crate) fn notice_impostor(&mut self, from: SocketAddr, now: Duration) -> Option<Happening> {
        let known = self.impostor_at.is_some_and(|at| now.saturating_sub(at) < IMPOSTOR_MEMORY);
        self.impostor_at = Some(now);
        (!known).then_some(Happening::Alert(Alert::Impostor(from)))
    }

    /// What to send at `now`.
    pub(crate) fn poll(&mut self, now: Duration, out: &mut Vec<MavMessage>) -> Vec<Happening> {
        let mut happenings = Vec::new();
        let state = self.link.state(now);
        if std::mem::replace(&mut self.link_state, state) != state {
            happenings.push(Happening::Link(state));
        }
        let reachable = matches!(state, LinkState::Linked) && !self.shares_address;
        let has_origin = !self.autopilot.needs_origin() || self.link.has_origin();
        happenings.extend(
            self.feed.update(reachable, has_origin, &self.telemetry, now).map(Happening::Feed),
        );
        if state != LinkState::Lost {
            out.extend(self.link.poll(self.id, self.autopilot.needs_origin(), now));
        }
        happenings.extend(self.guard(now));
        let flown = Flown { id: self.id, autopilot: self.autopilot, telemetry: &self.telemetry };
        happenings.extend(self.pilot.poll(flown, now, out));
        happenings
    }
}
