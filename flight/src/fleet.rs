//! Many vehicles on one socket.

use core::net::SocketAddr;
use std::{collections::BTreeMap, time::Duration};

use mavlink::dialects::ardupilotmega::{MavMessage, MavType};

use crate::{
    Autopilot, Setpoint, VehicleId,
    event::{Alert, Event, Happening},
    feed::{PoseFix, PoseRefusal},
    link::{LinkState, STALE_AFTER},
    message::{AUTOPILOT_COMPONENT, VisionMessage},
    options::{Datagram, FleetOptions},
    refusal::{CommandRefusal, Refused},
    signing::{Key, SignatureError, Verifier},
    task::{Command, CommandId},
    vehicle::Vehicle,
    wire::{Frame, Sender, WireError, read_frame, write_frame},
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
        Self { options, ..Self::default() }
    }

    /// The vehicle's own key; from now on nothing else of it is accepted.
    pub fn set_key(&mut self, id: VehicleId, key: Option<Key>) {
        let registration = self.registrations.entry(id).or_default();
        registration.key = key;
        registration.verifier = Verifier::default();
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

    fn signing_now(&self, now: Duration) -> u64 {
        self.options.signing_time_at_zero + (now.as_micros() / 10) as u64
    }

    /// Takes a datagram that came `from` somewhere.
    pub fn receive(&mut self, datagram: &[u8], from: SocketAddr, now: Duration) {
        let mut rest = datagram;
        while !rest.is_empty() {
            let (frame, following) = read_frame(rest);
            rest = following;
            let counter = match frame {
                Ok(frame) => {
                    self.receive_frame(&frame, from, now);
                    continue;
                }
                Err(WireError::Version1) => &mut self.refused.version_1,
                Err(WireError::Garbage | WireError::UnknownFlags(_)) => &mut self.refused.garbage,
                Err(WireError::Checksum) => &mut self.refused.checksum,
                Err(WireError::UnknownMessage(_)) => &mut self.refused.unknown_message,
            };
            *counter += 1;
        }
    }

    fn receive_frame(&mut self, frame: &Frame<'_>, from: SocketAddr, now: Duration) {
        // Only autopilots are vehicles; cameras and ground stations on the link are not.
        if frame.sender.component_id != AUTOPILOT_COMPONENT {
            self.refused.stranger += 1;
            return;
        }
        let id = VehicleId(frame.sender.system_id);
        let moved = match self.vehicles.get(&id) {
            None => false,
            Some(vehicle) if vehicle.address == from => false,
            Some(vehicle) => {
                // Before the signature is looked at: a copy must not use up the original's time.
                if vehicle.link().silence(now) < STALE_AFTER {
                    self.refused.foreign_address += 1;
                    let alert = self
                        .vehicles
                        .get_mut(&id)
                        .and_then(|vehicle| vehicle.notice_impostor(from, now));
                    self.report(id, alert);
                    return;
                }
                true
            }
        };
        if let Err(error) = self.authenticate(id, frame, now) {
            let counter = match error {
                SignatureError::Missing => &mut self.refused.unsigned,
                SignatureError::Wrong => &mut self.refused.wrong_signature,
                SignatureError::Replayed | SignatureError::Old => &mut self.refused.replayed,
            };
            *counter += 1;
            return;
        }
        let Some(message) = &frame.message else {
            self.refused.unknown_message += 1;
            return;
        };
        if (moved || !self.vehicles.contains_key(&id)) && !self.introduce(id, message, from, now) {
            self.refused.stranger += 1;
            return;
        }
        self.accepted += 1;
        if let Some(vehicle) = self.vehicles.get_mut(&id) {
            let (answer, happenings) = vehicle.take(frame.sequence, message, now);
            self.send(id, answer);
            self.report(id, happenings);
        }
    }

    /// Whether the frame is from who it says, as far as that is asked.
    fn authenticate(
        &mut self,
        id: VehicleId,
        frame: &Frame<'_>,
        now: Duration,
    ) -> Result<(), SignatureError> {
        let signing_now = self.signing_now(now);
        let own = self.registrations.get(&id).and_then(|r| r.key.clone());
        match own.or_else(|| self.options.default_key.clone()) {
            Some(key) => {
                let registration = self.registrations.entry(id).or_default();
                registration.verifier.verify(&key, frame, signing_now)
            }
            None if self.options.accept_unsigned => Ok(()),
            None => Err(SignatureError::Missing),
        }
    }

    /// A vehicle is introduced, at a new address, too, by a heartbeat of its autopilot.
    fn introduce(
        &mut self,
        id: VehicleId,
        message: &MavMessage,
        from: SocketAddr,
        now: Duration,
    ) -> bool {
        let MavMessage::HEARTBEAT(heartbeat) = message else { return false };
        let Some(autopilot) = Autopilot::from_heartbeat(heartbeat.autopilot) else { return false };
        if heartbeat.mavtype == MavType::MAV_TYPE_GCS || id.0 == 0 {
            return false;
        }
        match self.vehicles.get_mut(&id) {
            Some(vehicle) if vehicle.autopilot == autopilot => {
                vehicle.address = from;
                self.report(id, [Happening::Moved(from)]);
            }
            _ => {
                let mut vehicle = Vehicle::new(id, autopilot, from, now);
                vehicle.vision = self.registrations.entry(id).or_default().vision;
                self.vehicles.insert(id, vehicle);
                self.report(id, [Happening::Link(LinkState::Seen)]);
            }
        }
        self.find_shared_addresses(now);
        true
    }

    /// A pose has no addressee but the address: two vehicles of one address get none.
    fn find_shared_addresses(&mut self, now: Duration) {
        let alive: Vec<(VehicleId, SocketAddr)> = self
            .vehicles
            .values()
            .filter(|vehicle| vehicle.link().state(now) != LinkState::Lost)
            .map(|vehicle| (vehicle.id, vehicle.address))
            .collect();
        for vehicle in self.vehicles.values_mut() {
            let shares =
                alive.iter().any(|&(id, address)| id != vehicle.id && address == vehicle.address);
            if shares && !vehicle.shares_address {
                let happening = Happening::Alert(Alert::SharedAddress);
                self.events.push(Event { vehicle: vehicle.id, happening });
            }
            vehicle.shares_address = shares;
        }
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
