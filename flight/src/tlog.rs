//! Telemetry logs (`.tlog`), as ground stations keep them: frames with the time at which each was
//! sent or received.

use std::time::Duration;

use crate::wire::read_frame;

/// Bytes of a time.
const STAMP_BYTES: usize = 8;

/// One frame of a log.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Record<'a> {
    /// Since the Unix epoch, to the microsecond.
    pub time: Duration,
    /// The frame as it was on the wire.
    pub frame: &'a [u8],
}

/// Appends all frames of a `datagram` to a log.
pub fn write_records(datagram: &[u8], time: Duration, log: &mut Vec<u8>) {
    let mut rest = datagram;
    while !rest.is_empty() {
        let (frame, following) = read_frame(rest);
        if frame.is_ok() {
            log.extend((time.as_micros() as u64).to_be_bytes());
            log.extend(&rest[..rest.len() - following.len()]);
        }
        rest = following;
    }
}

/// The frames of a log in order, up to the first that is not whole.
pub fn read_records(log: &[u8]) -> impl Iterator<Item = Record<'_>> {
    let mut rest = log;
    std::iter::from_fn(move || {
        let (stamp, frames) = rest.split_first_chunk::<STAMP_BYTES>()?;
        let (frame, following) = read_frame(frames);
        frame.ok()?;
        rest = following;
        let time = Duration::from_micros(u64::from_be_bytes(*stamp));
        Some(Record { time, frame: &frames[..frames.len() - following.len()] })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        Key,
        message::heartbeat,
        wire::{Sender, write_frame},
    };

    const DRONE: Sender = Sender { system_id: 3, component_id: 1 };

    /// What was written is read, signed or not; several frames of one datagram have one time each;
    /// what is no frame is left out.
    #[test]
    fn frames_come_back_with_their_times() {
        let plain = write_frame(DRONE, 1, &heartbeat(), None);
        let signed = write_frame(DRONE, 2, &heartbeat(), Some((&Key([1; 32]), 0, 7)));
        let both = [plain.clone(), signed.clone()].concat();
        let [first, second] =
            [1_800_000_000_000_001, 1_800_000_000_020_000].map(Duration::from_micros);
        let mut log = Vec::new();
        write_records(&both, first, &mut log);
        write_records(b"garbage", second, &mut log);
        write_records(&signed, second, &mut log);
        let expected = [(first, &plain), (first, &signed), (second, &signed)];
        let records: Vec<_> = read_records(&log).collect();
        assert_eq!(records, expected.map(|(time, frame)| Record { time, frame }));
    }

    /// A service that was killed leaves half a record.
    #[test]
    fn a_log_may_end_anywhere() {
        let mut log = Vec::new();
        for second in 0..3 {
            let frame = write_frame(DRONE, second, &heartbeat(), None);
            write_records(&frame, Duration::from_secs(second.into()), &mut log);
        }
        let record = log.len() / 3;
        for length in 0..=log.len() {
            assert_eq!(read_records(&log[..length]).count(), length / record, "{length} bytes");
        }
    }
}
