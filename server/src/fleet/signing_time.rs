//! The signing time over restarts: it must never fall behind what was used before.

use std::{
    path::{Path, PathBuf},
    time::{Duration, SystemTime, UNIX_EPOCH},
};

use volery_flight::signing_time;

/// The latest signing time in use, in a file.
#[derive(Debug)]
pub(super) struct SigningTime {
    path: PathBuf,
}

impl SigningTime {
    pub(super) fn new(data: &Path) -> Self {
        Self { path: data.join("signing-time") }
    }

    /// True time, or what was used before if that is later.
    pub(super) fn start(&self) -> std::io::Result<u64> {
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or(Duration::ZERO);
        let kept = match std::fs::read_to_string(&self.path) {
            Ok(text) => text.trim().parse().unwrap_or(0),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => 0,
            Err(error) => return Err(error),
        };
        Ok(signing_time(now).max(kept))
    }

    pub(super) fn keep(&self, time: u64) -> std::io::Result<()> {
        let new = self.path.with_extension("new");
        std::fs::write(&new, time.to_string())?;
        std::fs::rename(new, &self.path)
    }
}
