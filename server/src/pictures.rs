//! The newest picture of each drone's camera, for people.

use std::{
    collections::BTreeMap,
    sync::{Mutex, MutexGuard, PoisonError},
    time::Instant,
};

use bytes::Bytes;

/// A picture as it came.
#[derive(Debug, Clone)]
pub(crate) struct Picture {
    pub(crate) bytes: Bytes,
    pub(crate) media_type: &'static str,
    /// As far as one knows: not later than it arrived.
    pub(crate) taken: Instant,
}

/// One picture per drone.
#[derive(Debug, Default)]
pub(crate) struct Pictures(Mutex<BTreeMap<u8, Picture>>);

impl Pictures {
    /// Keeps a picture that a browser can show; raw pixels are not kept.
    pub(crate) fn put(&self, drone: u8, bytes: &Bytes, taken: Instant) {
        if let Some(media_type) = media_type(bytes) {
            self.lock().insert(drone, Picture { bytes: bytes.clone(), media_type, taken });
        }
    }

    pub(crate) fn get(&self, drone: u8) -> Option<Picture> {
        self.lock().get(&drone).cloned()
    }

    fn lock(&self) -> MutexGuard<'_, BTreeMap<u8, Picture>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn media_type(bytes: &[u8]) -> Option<&'static str> {
    if bytes.starts_with(b"\xff\xd8\xff") {
        Some("image/jpeg")
    } else {
        bytes.starts_with(b"\x89PNG\r\n\x1a\n").then_some("image/png")
    }
}
