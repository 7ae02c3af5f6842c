//! Signatures of MAVLink 2.
//!
//! Source: the MAVLink developer guide, "Message Signing". A signature is 13 bytes: link id,
//! 48-bit time, and the first 48 bits of SHA-256 over key, frame, link id and time. Times of one
//! stream (system, component, link) rise, so that nothing can be played twice.
//!
//! A network may change the order of datagrams. A reader that only takes rising times then loses
//! what was overtaken, so this one remembers the times of the last second and takes each once.

use std::{
    collections::{BTreeSet, HashMap},
    time::Duration,
};

use sha2::{Digest, Sha256};

use crate::wire::{Frame, Sender};

/// Bytes of a signature.
pub const SIGNATURE_BYTES: usize = 13;
/// Units of signing time per second.
const TICKS_PER_S: u64 = 100_000;
/// How far a stream that was not heard before may be behind.
const MAX_BEHIND: u64 = 60 * TICKS_PER_S;
/// How late a frame may come after one that was signed later.
const MAX_LATE: u64 = TICKS_PER_S;
/// Times remembered per stream.
const MAX_TAKEN: usize = 512;
/// Seconds from the Unix epoch to the epoch of signing times, the start of 2015.
const EPOCH_UNIX_S: u64 = 1_420_070_400;

/// A secret shared with one vehicle.
#[derive(Clone, PartialEq, Eq)]
pub struct Key(pub [u8; 32]);

impl std::fmt::Debug for Key {
    /// Never shows the secret.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Key(..)")
    }
}

/// The signing time of a time since the Unix epoch; zero before 2015.
pub fn signing_time(since_unix_epoch: Duration) -> u64 {
    let since_2015 = since_unix_epoch.saturating_sub(Duration::from_secs(EPOCH_UNIX_S));
    (since_2015.as_micros() / 10) as u64
}

/// The end of a signed frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Signature {
    /// Which link of the sender.
    pub link_id: u8,
    /// In units of 10 µs since the start of 2015; 48 bits.
    pub time: u64,
    /// First bytes of the hash.
    pub hash: [u8; 6],
}

impl Signature {
    /// From the bytes after a checksum; `None` when there are none.
    pub(crate) fn read(bytes: &[u8]) -> Option<Self> {
        let bytes: &[u8; SIGNATURE_BYTES] = bytes.try_into().ok()?;
        let [link_id, t0, t1, t2, t3, t4, t5, hash @ ..] = *bytes;
        Some(Self { link_id, time: u64::from_le_bytes([t0, t1, t2, t3, t4, t5, 0, 0]), hash })
    }

    /// Of a frame up to its checksum.
    pub(crate) fn sign(key: &Key, frame: &[u8], link_id: u8, time: u64) -> Self {
        let [t0, t1, t2, t3, t4, t5, ..] = time.to_le_bytes();
        let digest = Sha256::new()
            .chain_update(key.0)
            .chain_update(frame)
            .chain_update([link_id, t0, t1, t2, t3, t4, t5])
            .finalize();
        let mut hash = [0; 6];
        hash.copy_from_slice(&digest[..6]);
        Self { link_id, time, hash }
    }

    /// On the wire.
    pub(crate) fn bytes(&self) -> [u8; SIGNATURE_BYTES] {
        let [t0, t1, t2, t3, t4, t5, ..] = self.time.to_le_bytes();
        let [h0, h1, h2, h3, h4, h5] = self.hash;
        [self.link_id, t0, t1, t2, t3, t4, t5, h0, h1, h2, h3, h4, h5]
    }
}

/// Why a frame is not from who it says.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum SignatureError {
    /// There is none where one is needed.
    #[error("not signed")]
    Missing,
    /// Signed with another key, or changed on the way.
    #[error("wrong signature")]
    Wrong,
    /// Its stream has brought this time before, or much later ones.
    #[error("signing time was used before")]
    Replayed,
    /// A stream not heard before that is more than a minute behind.
    #[error("signing time is {:.0} s behind", .behind.as_secs_f64())]
    Old {
        /// How far.
        behind: Duration,
    },
}

/// The times of one stream that were taken lately.
#[derive(Debug, Clone)]
struct Taken {
    /// Nothing up to here is taken any more.
    floor: u64,
    times: BTreeSet<u64>,
}

impl Taken {
    fn take(&mut self, time: u64) -> Result<(), SignatureError> {
        let is_late = self.times.last().is_some_and(|&latest| time + MAX_LATE < latest);
        if is_late || time <= self.floor || !self.times.insert(time) {
            return Err(SignatureError::Replayed);
        }
        while let (Some(&oldest), Some(&latest)) = (self.times.first(), self.times.last()) {
            if latest - oldest <= MAX_LATE && self.times.len() <= MAX_TAKEN {
                break;
            }
            self.floor = oldest;
            self.times.pop_first();
        }
        Ok(())
    }
}

/// The latest time taken of a stream: what is kept over a restart, so that nothing taken before can
/// be played again after it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StreamTime {
    /// Who signs.
    pub sender: Sender,
    /// On which link of theirs.
    pub link_id: u8,
    /// In units of 10 µs since the start of 2015.
    pub time: u64,
}

/// Times of the streams of one key.
#[derive(Debug, Clone, Default)]
pub struct Verifier {
    streams: HashMap<(Sender, u8), Taken>,
}

impl Verifier {
    /// The latest time of each stream.
    pub fn times(&self) -> impl Iterator<Item = StreamTime> + '_ {
        self.streams.iter().map(|(&(sender, link_id), taken)| {
            let time = taken.times.last().copied().unwrap_or(taken.floor);
            StreamTime { sender, link_id, time }
        })
    }

    /// Takes nothing of a stream any more up to its time.
    pub fn remember(&mut self, StreamTime { sender, link_id, time }: StreamTime) {
        let taken = Taken { floor: time, times: BTreeSet::new() };
        self.streams.insert((sender, link_id), taken);
    }

    /// Whether `frame` was signed with `key` and was never taken before.
    ///
    /// * `now`: the reader's signing time.
    ///
    /// # Errors
    ///
    /// [`SignatureError`]; the state is then unchanged.
    pub fn verify(&mut self, key: &Key, frame: &Frame<'_>, now: u64) -> Result<(), SignatureError> {
        let Signature { link_id, time, hash } = frame.signature.ok_or(SignatureError::Missing)?;
        let expected = Signature::sign(key, frame.signed_bytes, link_id, time);
        // Without early exit: the time taken says nothing about the bytes that fit.
        if expected.hash.iter().zip(&hash).fold(0, |all, (a, b)| all | (a ^ b)) != 0 {
            return Err(SignatureError::Wrong);
        }
        match self.streams.get_mut(&(frame.sender, link_id)) {
            Some(taken) => taken.take(time),
            None if time + MAX_BEHIND < now => {
                Err(SignatureError::Old { behind: Duration::from_micros((now - time) * 10) })
            }
            None => {
                let taken = Taken { floor: time, times: BTreeSet::new() };
                self.streams.insert((frame.sender, link_id), taken);
                Ok(())
            }
        }
    }
}

#[cfg(test)]
mod tests;
