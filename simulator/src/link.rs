//! MAVLink 2 frames in and out of an autopilot, signed where there is a key.

use std::collections::BTreeMap;
use std::time::Duration;

use mavlink::dialects::ardupilotmega::MavMessage;
use mavlink::{MAV_STX, MAV_STX_V2, MAVLinkV2MessageRaw, MavHeader, Message};

/// The autopilot's component of a vehicle.
pub(crate) const AUTOPILOT: u8 = 1;
/// Bytes of a frame without its payload and signature.
const FRAME_BYTES: usize = 12;
/// Bytes of a signature.
const SIGNATURE_BYTES: usize = 13;
/// The one incompatibility flag that is understood.
const SIGNED: u8 = 1;
/// A stamp that a new sender may be behind, in units of 10 µs: a minute.
const MAX_BEHIND: u64 = 6_000_000;

/// Key of a link and the time that stamps count.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Signing {
    /// Shared with the ground station.
    pub key: [u8; 32],
    /// Units of 10 µs since 2015 when the simulation's clock was zero.
    pub epoch: u64,
}

/// A message with its sender.
#[derive(Debug, Clone, PartialEq)]
pub struct Received {
    /// Sender.
    pub system_id: u8,
    /// Sender.
    pub component_id: u8,
    /// What it says.
    pub message: MavMessage,
}

/// Why bytes were not taken for a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Refusal {
    /// Not a frame, or a cut one.
    Garbage,
    /// A frame of MAVLink 1.
    Version1,
    /// The checksum does not fit.
    Checksum,
    /// A signature is needed and there is none.
    Unsigned,
    /// The signature is not of the key.
    Signature,
    /// The stamp does not rise.
    Replay,
    /// The contents cannot be read.
    Contents,
}

/// One end of a MAVLink connection.
#[derive(Debug, Clone)]
pub struct Link {
    system_id: u8,
    component_id: u8,
    sequence: u8,
    signing: Option<Signing>,
    last_stamp: u64,
    /// Newest stamp by link id, system and component.
    heard: BTreeMap<(u8, u32, u8), u64>,
}

impl Link {
    /// The end of a component of a vehicle or station.
    pub fn new(system_id: u8, component_id: u8, signing: Option<Signing>) -> Self {
        Self {
            system_id,
            component_id,
            sequence: 0,
            signing,
            last_stamp: 0,
            heard: BTreeMap::new(),
        }
    }

    /// A frame with the next sequence number.
    pub fn encode(&mut self, message: &MavMessage, now: Duration) -> Vec<u8> {
        let header = MavHeader {
            system_id: u32::from(self.system_id),
            component_id: self.component_id,
            sequence: self.sequence,
        };
        self.sequence = self.sequence.wrapping_add(1);
        let mut raw = MAVLinkV2MessageRaw::new();
        let Some(signing) = self.signing else {
            raw.serialize_message(header, message);
            return raw.raw_bytes().to_vec();
        };
        raw.serialize_message_for_signing(header, message);
        let stamp = stamp(&signing, now).max(self.last_stamp + 1);
        self.last_stamp = stamp;
        *raw.signature_link_id_mut() = 0;
        raw.signature_timestamp_bytes_mut().copy_from_slice(&stamp.to_le_bytes()[..6]);
        let mut signature = [0; 6];
        raw.calculate_signature(&signing.key, &mut signature);
        raw.signature_value_mut().copy_from_slice(&signature);
        raw.raw_bytes().to_vec()
    }

    /// All messages of a datagram, and why parts of it are none.
    pub fn decode(&mut self, datagram: &[u8], now: Duration) -> Vec<Result<Received, Refusal>> {
        let mut found = Vec::new();
        let mut rest = datagram;
        while !rest.is_empty() {
            match frame_len(rest) {
                Ok(len) => {
                    found.push(self.read(&rest[..len], now));
                    rest = &rest[len..];
                }
                Err(refusal) => {
                    found.push(Err(refusal));
                    break;
                }
            }
        }
        found
    }

    fn read(&mut self, frame: &[u8], now: Duration) -> Result<Received, Refusal> {
        let mut raw = MAVLinkV2MessageRaw::new();
        raw.as_mut_slice()[..frame.len()].copy_from_slice(frame);
        if !raw.has_valid_crc::<MavMessage>() {
            return Err(Refusal::Checksum);
        }
        if let Some(signing) = self.signing {
            self.check_signature(&raw, &signing, now)?;
        }
        let message =
            MavMessage::parse(mavlink::MavlinkVersion::V2, raw.message_id(), raw.payload())
                .map_err(|_| Refusal::Contents)?;
        Ok(Received { system_id: raw.system_id() as u8, component_id: raw.component_id(), message })
    }

    fn check_signature(
        &mut self,
        raw: &MAVLinkV2MessageRaw,
        signing: &Signing,
        now: Duration,
    ) -> Result<(), Refusal> {
        if raw.incompatibility_flags() & SIGNED == 0 {
            return Err(Refusal::Unsigned);
        }
        let mut signature = [0; 6];
        raw.calculate_signature(&signing.key, &mut signature);
        if signature != raw.signature_value() {
            return Err(Refusal::Signature);
        }
        let stream = (raw.signature_link_id(), raw.system_id(), raw.component_id());
        let theirs = raw.signature_timestamp();
        let is_new = match self.heard.get(&stream) {
            Some(last) => theirs > *last,
            None => theirs + MAX_BEHIND >= stamp(signing, now),
        };
        if !is_new {
            return Err(Refusal::Replay);
        }
        self.heard.insert(stream, theirs);
        Ok(())
    }
}

fn stamp(signing: &Signing, now: Duration) -> u64 {
    signing.epoch + (now.as_micros() / 10) as u64
}

/// Length of the frame that `bytes` begin with.
fn frame_len(bytes: &[u8]) -> Result<usize, Refusal> {
    match bytes {
        [MAV_STX, ..] => Err(Refusal::Version1),
        [MAV_STX_V2, payload, flags, ..] if flags & !SIGNED == 0 => {
            let signature = if flags & SIGNED == 0 { 0 } else { SIGNATURE_BYTES };
            let len = FRAME_BYTES + usize::from(*payload) + signature;
            (len <= bytes.len()).then_some(len).ok_or(Refusal::Garbage)
        }
        _ => Err(Refusal::Garbage),
    }
}

#[cfg(test)]
mod tests {
    use mavlink::dialects::ardupilotmega::HEARTBEAT_DATA;

    use super::*;

    const KEY: Signing = Signing { key: [7; 32], epoch: 1_000_000_000 };

    fn heartbeat() -> MavMessage {
        MavMessage::HEARTBEAT(HEARTBEAT_DATA::default())
    }

    #[test]
    fn frames_come_back_and_broken_ones_do_not() {
        let mut link = Link::new(9, 1, None);
        let frame = link.encode(&heartbeat(), Duration::ZERO);
        let two = [frame.clone(), link.encode(&heartbeat(), Duration::ZERO)].concat();
        let read: Vec<_> = link.decode(&two, Duration::ZERO).into_iter().flatten().collect();
        assert_eq!(read.len(), 2);
        assert_eq!((read[0].system_id, &read[0].message), (9, &heartbeat()));
        for place in 1..frame.len() {
            let mut broken = frame.clone();
            broken[place] ^= 0x55;
            assert!(link.decode(&broken, Duration::ZERO).iter().all(Result::is_err), "{place}");
            assert!(link.decode(&frame[..place], Duration::ZERO).iter().all(Result::is_err));
        }
        assert_eq!(link.decode(&[0xfe, 0, 0], Duration::ZERO), [Err(Refusal::Version1)]);
    }

    #[test]
    fn only_fresh_frames_of_the_key_pass() {
        let minute = Duration::from_secs(60);
        let mut ours = Link::new(1, 1, Some(KEY));
        let mut theirs = Link::new(255, 1, Some(KEY));
        let mut other = Link::new(255, 1, Some(Signing { key: [8; 32], ..KEY }));
        let mut unsigned = Link::new(255, 1, None);
        let first = theirs.encode(&heartbeat(), minute);
        let second = theirs.encode(&heartbeat(), minute);
        assert!(ours.decode(&second, minute)[0].is_ok());
        assert_eq!(ours.decode(&second, minute), [Err(Refusal::Replay)]);
        assert_eq!(ours.decode(&first, minute), [Err(Refusal::Replay)]);
        let foreign = other.encode(&heartbeat(), minute);
        assert_eq!(ours.decode(&foreign, minute), [Err(Refusal::Signature)]);
        let bare = unsigned.encode(&heartbeat(), minute);
        assert_eq!(ours.decode(&bare, minute), [Err(Refusal::Unsigned)]);
        // An end that has heard nobody takes what is at most a minute old.
        let mut fresh = Link::new(2, 1, Some(KEY));
        assert!(fresh.decode(&first, minute * 2).iter().all(Result::is_ok));
        let mut later = Link::new(3, 1, Some(KEY));
        assert_eq!(
            later.decode(&first, minute * 2 + Duration::from_secs(1)),
            [Err(Refusal::Replay)]
        );
    }
}
