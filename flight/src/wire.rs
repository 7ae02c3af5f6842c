//! MAVLink 2 frames: messages to bytes and back.
//!
//! MAVLink 1 is never read: it cannot be signed, so it would be a way around the signature.

use mavlink::{MavlinkVersion, Message, calculate_crc, dialects::ardupilotmega::MavMessage};

use crate::signing::{Key, SIGNATURE_BYTES, Signature};

/// First byte of a frame of version 2.
const MAGIC: u8 = 0xFD;
/// First byte of a frame of version 1.
const MAGIC_V1: u8 = 0xFE;
const HEADER_BYTES: usize = 10;
const CRC_BYTES: usize = 2;
const MAX_PAYLOAD: usize = 255;
/// Incompatibility flag of a signed frame; a frame with any other flag cannot be understood.
const SIGNED: u8 = 1;

/// Who sent a frame: one stream of sequence numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Sender {
    /// Of the vehicle or ground station.
    pub system_id: u8,
    /// Of the part of it.
    pub component_id: u8,
}

/// A frame that was read: its checksum is right, its signature is not yet checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame<'a> {
    /// Who sent it.
    pub sender: Sender,
    /// Counts the frames of the sender.
    pub sequence: u8,
    /// What it says; `None` when the dialect does not know the message or a value in it.
    pub message: Option<MavMessage>,
    /// Its signature, if it has one.
    pub signature: Option<Signature>,
    /// From the magic byte up to the checksum, as signed.
    pub signed_bytes: &'a [u8],
}

/// Why bytes are not a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum WireError {
    /// The frame is of MAVLink 1.
    #[error("frame of MAVLink 1")]
    Version1,
    /// Neither version begins like this, or the frame ends too early.
    #[error("not a MAVLink frame")]
    Garbage,
    /// Flags that this reader does not know.
    #[error("unknown incompatibility flags {0:#04x}")]
    UnknownFlags(u8),
    /// The checksum does not fit.
    #[error("wrong checksum")]
    Checksum,
    /// The dialect has no such message, so its checksum cannot be verified.
    #[error("unknown message {0}")]
    UnknownMessage(u32),
}

/// Reads the frame at the start of `bytes`.
///
/// * Returns the frame, or why it is none, and the bytes that follow it; nothing follows when its
///   length is not known.
pub fn read_frame(bytes: &[u8]) -> (Result<Frame<'_>, WireError>, &[u8]) {
    match frame_length(bytes) {
        Ok(length) => {
            let (frame, rest) = bytes.split_at(length);
            (parse_frame(frame), rest)
        }
        Err(error) => (Err(error), &[]),
    }
}

/// Bytes of the frame at the start of `bytes`, which has as many.
fn frame_length(bytes: &[u8]) -> Result<usize, WireError> {
    match bytes.first() {
        Some(&MAGIC) => {}
        Some(&MAGIC_V1) => return Err(WireError::Version1),
        _ => return Err(WireError::Garbage),
    }
    let &[_, payload_bytes, flags, ..] = bytes else { return Err(WireError::Garbage) };
    if flags & !SIGNED != 0 {
        return Err(WireError::UnknownFlags(flags));
    }
    let signature_bytes = if flags == SIGNED { SIGNATURE_BYTES } else { 0 };
    let length = HEADER_BYTES + usize::from(payload_bytes) + CRC_BYTES + signature_bytes;
    if length > bytes.len() { Err(WireError::Garbage) } else { Ok(length) }
}

/// A frame from exactly its bytes.
fn parse_frame(frame: &[u8]) -> Result<Frame<'_>, WireError> {
    let crc_at = HEADER_BYTES + usize::from(frame[1]);
    let signature_at = crc_at + CRC_BYTES;
    let id = u32::from_le_bytes([frame[7], frame[8], frame[9], 0]);
    if MavMessage::default_message_from_id(id).is_none() {
        return Err(WireError::UnknownMessage(id));
    }
    let crc = u16::from_le_bytes([frame[crc_at], frame[crc_at + 1]]);
    if crc != calculate_crc(&frame[1..crc_at], MavMessage::extra_crc(id)) {
        return Err(WireError::Checksum);
    }
    let payload = &frame[HEADER_BYTES..crc_at];
    Ok(Frame {
        sender: Sender { system_id: frame[5], component_id: frame[6] },
        sequence: frame[4],
        message: MavMessage::parse(MavlinkVersion::V2, id, payload).ok(),
        signature: Signature::read(&frame[signature_at..]),
        signed_bytes: &frame[..signature_at],
    })
}

/// A message as a frame, signed if there is a key.
///
/// * `sequence`: number of the frame in the stream of `sender`.
/// * `signed`: key, link id and signing time; times of one stream must rise.
pub fn write_frame(
    sender: Sender,
    sequence: u8,
    message: &MavMessage,
    signed: Option<(&Key, u8, u64)>,
) -> Vec<u8> {
    let mut payload = [0_u8; MAX_PAYLOAD];
    let payload_bytes = message.ser(MavlinkVersion::V2, &mut payload);
    let id = message.message_id();
    let [id0, id1, id2, _] = id.to_le_bytes();
    let flags = if signed.is_some() { SIGNED } else { 0 };
    let mut frame = Vec::with_capacity(HEADER_BYTES + payload_bytes + CRC_BYTES + SIGNATURE_BYTES);
    frame.extend([MAGIC, payload_bytes as u8, flags, 0, sequence]);
    frame.extend([sender.system_id, sender.component_id, id0, id1, id2]);
    frame.extend(&payload[..payload_bytes]);
    let crc = calculate_crc(&frame[1..], MavMessage::extra_crc(id));
    frame.extend(crc.to_le_bytes());
    if let Some((key, link_id, time)) = signed {
        let signature = Signature::sign(key, &frame, link_id, time);
        frame.extend(signature.bytes());
    }
    frame
}
