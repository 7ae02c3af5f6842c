//! Children that remember: whoever has a seat asks the same child every time.

use std::{
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
    },
    time::Duration,
};

use serde::{Serialize, de::DeserializeOwned};
use tokio::sync::{Mutex, OwnedMutexGuard};
use volery_api::worker::{WorkerReply, WorkerRequest};

use super::{child::Child, pool::PoolError};
use crate::config::Config;

/// Children with seats, started when first asked.
#[derive(Debug)]
pub(crate) struct Seats {
    config: Arc<Config>,
    word: &'static str,
    bytes: u64,
    children: Vec<Arc<Place>>,
}

#[derive(Debug, Default)]
struct Place {
    life: Arc<Mutex<Life>>,
    num_seats: AtomicUsize,
}

#[derive(Debug, Default)]
struct Life {
    child: Option<Child>,
    /// Children before this one have forgotten all.
    number: u64,
}

/// A place at one child.
#[derive(Debug)]
pub(crate) struct Seat {
    place: Arc<Place>,
    config: Arc<Config>,
    word: &'static str,
    bytes: u64,
}

/// The right to ask the child now.
#[derive(Debug)]
pub(crate) struct Turn {
    life: OwnedMutexGuard<Life>,
}

impl Seats {
    /// `size` children of `<program> <word>`, each with `bytes` of address space.
    pub(crate) fn new(config: &Config, word: &'static str, size: usize, bytes: u64) -> Self {
        let children = (0..size.max(1)).map(|_| Arc::default()).collect();
        Self { config: Arc::new(config.clone()), word, bytes, children }
    }

    /// A seat where fewest are taken.
    pub(crate) fn take(&self) -> Seat {
        let taken = |place: &&Arc<Place>| place.num_seats.load(Ordering::Relaxed);
        let place = self.children.iter().min_by_key(taken).expect("there is at least one child");
        place.num_seats.fetch_add(1, Ordering::Relaxed);
        Seat {
            place: Arc::clone(place),
            config: Arc::clone(&self.config),
            word: self.word,
            bytes: self.bytes,
        }
    }
}

impl Drop for Seat {
    fn drop(&mut self) {
        self.place.num_seats.fetch_sub(1, Ordering::Relaxed);
    }
}

impl Seat {
    /// Waits for its turn: in the order of arrival, so that none is passed over.
    pub(crate) async fn turn(&self) -> Result<Turn, PoolError> {
        let mut life = Arc::clone(&self.place.life).lock_owned().await;
        if life.child.is_none() {
            let child = Child::start(&self.config, self.word, self.bytes);
            life.child = Some(child.map_err(PoolError::NoStart)?);
            life.number += 1;
        }
        Ok(Turn { life })
    }
}

impl Turn {
    /// Which child this is: another number remembers nothing of what was asked before.
    pub(crate) fn life(&self) -> u64 {
        self.life.number
    }

    /// Asks the child. One that dies, talks nonsense or takes too long is replaced at the next
    /// turn; one whose asker goes away is not.
    pub(crate) async fn ask<T>(
        mut self,
        request: &WorkerRequest,
        payload: bytes::Bytes,
        timeout: Duration,
    ) -> Result<T, PoolError>
    where
        T: Serialize + DeserializeOwned + Send + 'static,
    {
        let header = serde_json::to_vec(request).map_err(|_| PoolError::Died)?;
        let asked = tokio::spawn(async move {
            let mut child = self.life.child.take().ok_or(PoolError::Died)?;
            let (answer, _) = tokio::time::timeout(timeout, child.ask(&header, &payload))
                .await
                .map_err(|_| PoolError::TimedOut(timeout))?
                .map_err(|_| PoolError::Died)?;
            let reply = WorkerReply::parse(&answer).map_err(|_| PoolError::Died)?;
            self.life.child = Some(child);
            reply.0.map_err(PoolError::Refused)
        });
        asked.await.map_err(|_| PoolError::Died)?
    }
}
