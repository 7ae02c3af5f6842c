//! Signing times over restarts: ours must never fall behind what was used before, and what drones
//! have signed before must not be taken again.

use std::{
    path::{Path, PathBuf},
    time::{Duration, SystemTime, UNIX_EPOCH},
};

use serde::{Deserialize, Serialize};
use volery_flight::{StreamTime, signing_time, wire::Sender};

/// Between writes.
pub(super) const KEEP_TIME: Duration = Duration::from_secs(10);

/// Signing times in a file.
#[derive(Debug)]
pub(super) struct SigningTimes {
    path: PathBuf,
}

/// What is kept.
#[derive(Debug, Default, PartialEq, Serialize, Deserialize)]
struct Kept {
    /// The latest of ours.
    own: u64,
    /// System id, component id and link id of streams, and the latest time taken of each.
    streams: Vec<(u8, u8, u8, u64)>,
}

impl SigningTimes {
    pub(super) fn new(data: &Path) -> Self {
        Self { path: data.join("signing-times.json") }
    }

    /// Our time: true time, or what was used before if that is later; and the times up to which
    /// nothing is taken of known streams. What was taken after the last write is older than now.
    pub(super) fn start(&self) -> std::io::Result<(u64, Vec<StreamTime>)> {
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or(Duration::ZERO);
        let now = signing_time(now);
        let kept = match std::fs::read(&self.path) {
            Ok(text) => serde_json::from_slice(&text)?,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Kept::default(),
            Err(error) => return Err(error),
        };
        let unwritten = (KEEP_TIME.as_micros() / 10) as u64;
        let stream = |(system_id, component_id, link_id, time): (u8, u8, u8, u64)| StreamTime {
            sender: Sender { system_id, component_id },
            link_id,
            time: time.max(now.min(time + unwritten)),
        };
        Ok((now.max(kept.own), kept.streams.into_iter().map(stream).collect()))
    }

    pub(super) fn keep(&self, own: u64, streams: &[StreamTime]) -> std::io::Result<()> {
        let stream = |stream: &StreamTime| {
            (stream.sender.system_id, stream.sender.component_id, stream.link_id, stream.time)
        };
        let kept = Kept { own, streams: streams.iter().map(stream).collect() };
        let new = self.path.with_extension("new");
        std::fs::write(&new, serde_json::to_vec(&kept)?)?;
        std::fs::rename(new, &self.path)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What was taken before a restart, also just before it, is not taken after it; what is signed
    /// by a true clock after it is. A clock that is behind loses at most the time between writes.
    #[test]
    fn nothing_is_taken_twice_over_a_restart() {
        let folder = std::env::temp_dir().join(format!("volery-signing-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let times = SigningTimes::new(&folder);
        let (now, none) = times.start().unwrap();
        assert!(none.is_empty());
        let sender = Sender { system_id: 7, component_id: 1 };
        let second = 100_000;
        let stream = |link_id, time| StreamTime { sender, link_id, time };
        let kept = [stream(0, now - second), stream(1, now - 40 * second)];
        times.keep(now + second, &kept).unwrap();
        let (own, streams) = times.start().unwrap();
        assert!(own >= now + second, "never behind what was used");
        assert!((now..=now + second).contains(&streams[0].time), "a true clock goes on at once");
        assert_eq!(streams[1].time, now - 30 * second);
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
