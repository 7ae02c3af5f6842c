//! Looks at all vehicles that are heard.

use core::net::SocketAddr;
use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use mavlink::dialects::ardupilotmega::MavMessage;

use super::inspection::Inspection;
use crate::fleet::GROUND_STATION;
use crate::message::{self, AUTOPILOT_COMPONENT};
use crate::options::Datagram;
use crate::signing::{Key, SignatureError, Verifier};
use crate::wire::{read_frame, write_frame};
use crate::{Autopilot, VehicleId};

/// Units of signing time per second.
const SIGNING_UNITS: f64 = 1e5;

/// One vehicle that was heard.
#[derive(Debug, Clone)]
pub struct Inspected {
    /// Its addresses; more than one is two vehicles of one number.
    pub addresses: BTreeSet<SocketAddr>,
    /// What it said of its parameters.
    pub inspection: Inspection,
    /// How far its signing clock is ahead of ours, seconds; `None` when it does not sign with the
    /// key.
    pub clock_ahead: Option<f64>,
    verifier: Verifier,
}

/// Hears heartbeats, and asks who sends them for its parameters.
#[derive(Debug, Clone)]
pub struct Inspector {
    key: Option<Key>,
    signing_time_at_zero: u64,
    last_signed: u64,
    sequence: u8,
    next_heartbeat: Duration,
    vehicles: BTreeMap<VehicleId, Inspected>,
}

impl Inspector {
    /// With the key that the vehicles sign with, if they do.
    pub fn new(key: Option<Key>, signing_time_at_zero: u64) -> Self {
        Self {
            key,
            signing_time_at_zero,
            last_signed: 0,
            sequence: 0,
            next_heartbeat: Duration::ZERO,
            vehicles: BTreeMap::new(),
        }
    }

    /// Takes a datagram.
    pub fn receive(&mut self, bytes: &[u8], from: SocketAddr, now: Duration) {
        let signing_time = self.signing_time(now);
        let mut rest = bytes;
        while !rest.is_empty() {
            let (frame, after) = read_frame(rest);
            rest = after;
            let Ok(frame) = frame else { continue };
            let id = VehicleId(frame.sender.system_id);
            if frame.sender.component_id != AUTOPILOT_COMPONENT {
                continue;
            }
            let Some(message) = &frame.message else { continue };
            let Some(vehicle) = self.vehicles.get_mut(&id) else {
                if let MavMessage::HEARTBEAT(heartbeat) = message
                    && let Some(autopilot) = Autopilot::from_heartbeat(heartbeat.autopilot)
                {
                    let inspected = Inspected {
                        addresses: [from].into(),
                        inspection: Inspection::new(id, autopilot),
                        clock_ahead: None,
                        verifier: Verifier::default(),
                    };
                    self.vehicles.insert(id, inspected);
                }
                continue;
            };
            if let Some(key) = &self.key {
                let verified = vehicle.verifier.verify(key, &frame, signing_time);
                if let (Ok(()) | Err(SignatureError::Old { .. }), Some(signature)) =
                    (verified, frame.signature)
                {
                    let ahead = signature.time as f64 - signing_time as f64;
                    vehicle.clock_ahead = Some(ahead / SIGNING_UNITS);
                }
                if verified.is_err() {
                    continue;
                }
            }
            vehicle.addresses.insert(from);
            vehicle.inspection.receive(message);
        }
    }

    /// What to send at `now`.
    pub fn poll(&mut self, now: Duration) -> Vec<Datagram> {
        let is_beat_due = now >= self.next_heartbeat;
        if is_beat_due {
            self.next_heartbeat = now + Duration::from_secs(1);
        }
        let mut messages = Vec::new();
        for vehicle in self.vehicles.values_mut() {
            let beat = is_beat_due.then(message::heartbeat);
            let out: Vec<_> = beat.into_iter().chain(vehicle.inspection.poll(now)).collect();
            messages.extend(vehicle.addresses.first().map(|to| (*to, out)));
        }
        let mut datagrams = Vec::new();
        for (to, out) in messages {
            for message in out {
                datagrams.push(Datagram { to, bytes: self.frame(&message, now) });
            }
        }
        datagrams
    }

    /// Those who were heard.
    pub fn vehicles(&self) -> &BTreeMap<VehicleId, Inspected> {
        &self.vehicles
    }

    /// Whether all who were heard have answered, or were asked often enough.
    pub fn is_done(&self) -> bool {
        self.vehicles.values().all(|vehicle| vehicle.inspection.is_done())
    }

    fn frame(&mut self, message: &MavMessage, now: Duration) -> Vec<u8> {
        self.sequence = self.sequence.wrapping_add(1);
        self.last_signed = self.signing_time(now).max(self.last_signed + 1);
        let signed = self.key.as_ref().map(|key| (key, 0, self.last_signed));
        write_frame(GROUND_STATION, self.sequence, message, signed)
    }

    fn signing_time(&self, now: Duration) -> u64 {
        self.signing_time_at_zero + (now.as_secs_f64() * SIGNING_UNITS) as u64
    }
}
