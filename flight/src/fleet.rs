//! Many vehicles on one socket.

mod reception;

use std::{collections::BTreeMap, time::Duration};

use mavlink::dialects::ardupilotmega::MavMessage;

use crate::{
    Setpoint, VehicleId,
    event::{Event, Happening},
    feed::{PoseFix, PoseRefusal},
    link::LinkState,
    message::VisionMessage,
    options::{Datagram, FleetOptions},
    refusal::{CommandRefusal, Refused},
    signing::{Key, StreamTime, Verifier},
    task::{Command, CommandId},
    vehicle::Vehicle,
    wire::{Sender, write_frame},
};

/// We, towards vehicles: their failsafe counts the ground station of this number.
pub(crate) const GROUND_STATION: Sender = Sender { system_id: 255, component_id: 190 };
/// Largest datagram that passes every network whole.
const MAX_DATAGRAM: usize = 1200;
/// Between polls while there is anyone to talk to.
const PERIOD: Duration = Duration::from_millis(10);
/// Between polls while there is nobody.
const IDLE_PERIOD: Duration = Duration::from_millis(250);

/// What belongs to a vehicle whether it is heard or not.
#[derive(Debug, Clone, Default)]
struct Registration {
    key: Option<Key>,
    vision: VisionMessage,
    verifier: Verifier,
    /// Of the frames sent to it.
    sequence: u8,
    signing_time: u64,
    /// When it was last said that its clock is behind.
    clock_told: Option<Duration>,
}

/// Many vehicles on one socket.
///
/// Pure: datagrams and time come in by [`Fleet::receive`] and [`Fleet::poll`]; datagrams go out by
/// [`Fleet::poll`], what happened by [`Fleet::take_events`].
#[derive(Debug, Clone, Default)]
pub struct Fleet {
    options: FleetOptions,
    registrations: BTreeMap<VehicleId, Registration>,
    vehicles: BTreeMap<VehicleId, Vehicle>,
    outbox: Vec<Datagram>,
    events: Vec<Event>,
    refused: Refused,
    accepted: u64,
    next_command: u64,
    polled: Duration,
}

impl Fleet {
    /// Without vehicles.
    pub fn new(options: FleetOptions) -> Self {
        let mut fleet = Self::default();
        for &time in &options.stream_times {
            let id = VehicleId(time.sender.system_id);
            fleet.registrations.entry(id).or_default().verifier.remember(time);
        }
        Self { options, ..fleet }
    }

    /// The vehicle's own key; from now on nothing else of it is accepted.
    pub fn set_key(&mut self, id: VehicleId, key: Option<Key>) {
        let registration = self.registrations.entry(id).or_default();
        let before = std::mem::replace(&mut registration.key, key);
        if before.is_some() && before != registration.key {
            registration.verifier = Verifier::default();
        }
    }

    /// Which message carries the vehicle's poses.
    pub fn set_vision_message(&mut self, id: VehicleId, vision: VisionMessage) {
        self.registrations.entry(id).or_default().vision = vision;
        if let Some(vehicle) = self.vehicles.get_mut(&id) {
            vehicle.vision = vision;
        }
    }

    /// Forgets a vehicle that is not heard any more. Returns whether it was forgotten.
    pub fn forget(&mut self, id: VehicleId, now: Duration) -> bool {
        let gone = self.vehicles.get(&id).is_some_and(|v| v.link().state(now) == LinkState::Lost);
        if gone {
            self.vehicles.remove(&id);
        }
        gone
    }

    /// Vehicles that were heard, by number.
    pub fn vehicles(&self) -> impl Iterator<Item = &Vehicle> {
        self.vehicles.values()
    }

    /// One vehicle.
    pub fn vehicle(&self, id: VehicleId) -> Option<&Vehicle> {
        self.vehicles.get(&id)
    }

    /// Frames that were accepted, and those that were not.
    pub fn counts(&self) -> (u64, Refused) {
        (self.accepted, self.refused)
    }

    /// The latest signing time in use, to be kept and never undercut.
    pub fn signing_time(&self, now: Duration) -> u64 {
        let latest = self.registrations.values().map(|r| r.signing_time).max();
        self.signing_now(now).max(latest.unwrap_or(0))
    }

    /// Signing times of all streams that were taken, to be kept with [`Fleet::signing_time`].
    pub fn stream_times(&self) -> Vec<StreamTime> {
        self.registrations.values().flat_map(|known| known.verifier.times()).collect()
    }

    fn signing_now(&self, now: Duration) -> u64 {
        self.options.signing_time_at_zero + (now.as_micros() / 10) as u64
    }

    /// Takes a pose of a vehicle; if it can be true, it is sent to the vehicle's estimator.
    ///
    /// # Errors
    ///
    /// [`PoseRefusal`]; nothing is sent.
    pub fn pose(&mut self, id: VehicleId, fix: PoseFix, now: Duration) -> Result<(), PoseRefusal> {
        let max_age = self.options.max_pose_age;
        let vehicle = self.vehicles.get_mut(&id).ok_or(PoseRefusal::NotFed)?;
        let (checked, happening) = vehicle.check_pose(fix, max_age, now);
        self.report(id, happening);
        self.send(id, [checked?]);
        Ok(())
    }

    /// Takes a command for a vehicle, in place of its present one.
    ///
    /// # Errors
    ///
    /// [`CommandRefusal`]; nothing changes.
    pub fn command(
        &mut self,
        id: VehicleId,
        command: &Command,
        now: Duration,
    ) -> Result<CommandId, CommandRefusal> {
        let command_id = self.new_command();
        let vehicle = self.vehicles.get_mut(&id).ok_or(CommandRefusal::UnknownVehicle)?;
        let happenings = vehicle.command(command_id, command, now)?;
        self.report(id, happenings);
        Ok(command_id)
    }

    /// Steers a vehicle in flight along a plan: the setpoint is flown to until the next one, which
    /// must come within half a second.
    ///
    /// # Errors
    ///
    /// [`CommandRefusal`]; nothing changes.
    pub fn steer(
        &mut self,
        id: VehicleId,
        setpoint: Setpoint,
        now: Duration,
    ) -> Result<(), CommandRefusal> {
        let vehicle = self.vehicles.get_mut(&id).ok_or(CommandRefusal::UnknownVehicle)?;
        let happenings = vehicle.steer(setpoint, now)?;
        self.report(id, happenings);
        Ok(())
    }

    /// Whether a vehicle would follow setpoints now.
    ///
    /// # Errors
    ///
    /// [`CommandRefusal`] says why it would not.
    pub fn may_steer(&self, id: VehicleId, now: Duration) -> Result<(), CommandRefusal> {
        let vehicle = self.vehicles.get(&id).ok_or(CommandRefusal::UnknownVehicle)?;
        vehicle.may_steer(now)
    }

    /// Whoever commands the vehicle promises to be there until `until`; then it holds. `None` ends
    /// the promise.
    pub fn lease(&mut self, id: VehicleId, until: Option<Duration>) {
        if let Some(vehicle) = self.vehicles.get_mut(&id) {
            vehicle.lease(until);
        }
    }

    /// Every vehicle in flight stops where it is; motors on the ground go off. Returns the commands
    /// it became.
    pub fn all_stop(&mut self, now: Duration) -> Vec<(VehicleId, CommandId)> {
        let ids: Vec<VehicleId> = self.vehicles.keys().copied().collect();
        let mut stopped = Vec::new();
        for id in ids {
            let command = self.new_command();
            let happenings =
                self.vehicles.get_mut(&id).and_then(|vehicle| vehicle.all_stop(command, now));
            if let Some(happenings) = happenings {
                self.report(id, happenings);
                stopped.push((id, command));
            }
        }
        stopped
    }

    /// Everything to be sent at `now`, in order.
    pub fn poll(&mut self, now: Duration) -> Vec<Datagram> {
        self.polled = now;
        self.find_shared_addresses(now);
        let ids: Vec<VehicleId> = self.vehicles.keys().copied().collect();
        for id in ids {
            let mut out = Vec::new();
            let happenings = match self.vehicles.get_mut(&id) {
                Some(vehicle) => vehicle.poll(now, &mut out),
                None => continue,
            };
            self.report(id, happenings);
            self.send(id, out);
        }
        self.take_datagrams()
    }

    /// What is to be sent at once: poses that were taken since the last call or poll.
    pub fn take_datagrams(&mut self) -> Vec<Datagram> {
        std::mem::take(&mut self.outbox)
    }

    /// When to poll again at the latest.
    pub fn next_wakeup(&self) -> Duration {
        self.polled + if self.vehicles.is_empty() { IDLE_PERIOD } else { PERIOD }
    }

    /// What happened since the last call.
    pub fn take_events(&mut self) -> Vec<Event> {
        std::mem::take(&mut self.events)
    }

    fn new_command(&mut self) -> CommandId {
        self.next_command += 1;
        CommandId(self.next_command)
    }

    fn report(&mut self, vehicle: VehicleId, happenings: impl IntoIterator<Item = Happening>) {
        let events = happenings.into_iter().map(|happening| Event { vehicle, happening });
        self.events.extend(events);
    }

    /// Each message goes to the address of its vehicle, signed with the vehicle's key.
    fn send(&mut self, id: VehicleId, messages: impl IntoIterator<Item = MavMessage>) {
        let signing_now = self.signing_now(self.polled);
        let Some(to) = self.vehicles.get(&id).map(|vehicle| vehicle.address) else { return };
        let registration = self.registrations.entry(id).or_default();
        let key = registration.key.as_ref().or(self.options.default_key.as_ref());
        let mut datagram: Option<(u8, Vec<u8>)> = None;
        for message in messages {
            registration.signing_time = signing_now.max(registration.signing_time + 1);
            let link_id = signing_link(&message);
            let signed = key.map(|key| (key, link_id, registration.signing_time));
            let bytes = write_frame(GROUND_STATION, registration.sequence, &message, signed);
            registration.sequence = registration.sequence.wrapping_add(1);
            match &mut datagram {
                Some((link, datagram))
                    if *link == link_id && datagram.len() + bytes.len() <= MAX_DATAGRAM =>
                {
                    datagram.extend(bytes);
                }
                full => {
                    let full = full.replace((link_id, bytes));
                    self.outbox.extend(full.map(|(_, bytes)| Datagram { to, bytes }));
                }
            }
        }
        self.outbox.extend(datagram.map(|(_, bytes)| Datagram { to, bytes }));
    }
}

/// Signing times must rise within a link id, and a network may change the order of datagrams. So
/// what is only good when it is new goes by itself, apart from heartbeats and commands; and what
/// is sent together goes in one datagram.
fn signing_link(message: &MavMessage) -> u8 {
    match message {
        MavMessage::VISION_POSITION_ESTIMATE(_) | MavMessage::ODOMETRY(_) => 1,
        MavMessage::SET_POSITION_TARGET_LOCAL_NED(_) => 2,
        _ => 0,
    }
}
