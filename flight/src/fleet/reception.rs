//! What comes in: frames, whose they are, and who is introduced.

use core::net::SocketAddr;
use std::time::Duration;

use mavlink::dialects::ardupilotmega::{MavMessage, MavType};

use super::Fleet;
use crate::{
    Autopilot, VehicleId,
    event::{Alert, Event, Happening},
    link::{LinkState, STALE_AFTER},
    message::AUTOPILOT_COMPONENT,
    signing::SignatureError,
    vehicle::Vehicle,
    wire::{Frame, WireError, read_frame},
};

/// Between two words about the clock of one vehicle.
const CLOCK_REMINDER: Duration = Duration::from_secs(60);

impl Fleet {
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
                SignatureError::Replayed | SignatureError::Old { .. } => &mut self.refused.replayed,
            };
            *counter += 1;
            if let SignatureError::Old { behind } = error {
                self.notice_clock(id, behind, now);
            }
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

    /// Somebody who has the key signs with a clock that is behind, or plays again what is old: said
    /// now and then, for a vehicle with such a clock is never heard.
    fn notice_clock(&mut self, id: VehicleId, behind: Duration, now: Duration) {
        let registration = self.registrations.entry(id).or_default();
        if registration.clock_told.is_none_or(|told| now >= told + CLOCK_REMINDER) {
            registration.clock_told = Some(now);
            self.report(id, [Happening::Alert(Alert::SigningClock(behind))]);
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
    pub(super) fn find_shared_addresses(&mut self, now: Duration) {
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
}
