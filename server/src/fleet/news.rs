//! What is told to whoever listens: states as they are, commands and alerts as they happen.

use std::{sync::Arc, time::Duration};

use tokio::sync::{broadcast, watch};
use volery_api::{DroneAlert, DroneCommandStatus, DroneState};

/// Between two states of a drone.
const STATE_INTERVAL: Duration = Duration::from_millis(100);
/// Events that a slow listener may be behind.
const MAX_BEHIND: usize = 1024;

/// Something that happened to a drone.
#[derive(Debug, Clone)]
pub(crate) enum DroneNews {
    /// A command of ours went on.
    Command(DroneCommandStatus),
    /// Somebody should look.
    Alert(DroneAlert),
}

/// Passes it on.
#[derive(Debug)]
pub(super) struct News {
    states: watch::Sender<Arc<[DroneState]>>,
    events: broadcast::Sender<DroneNews>,
    next_states: Duration,
}

impl News {
    pub(super) fn new() -> Self {
        Self {
            states: watch::Sender::new(Arc::new([])),
            events: broadcast::Sender::new(MAX_BEHIND),
            next_states: Duration::ZERO,
        }
    }

    /// States of all drones from now on; of several, the newest.
    pub(super) fn watch(&self) -> watch::Receiver<Arc<[DroneState]>> {
        self.states.subscribe()
    }

    /// Events of all drones from now on.
    pub(super) fn listen(&self) -> broadcast::Receiver<DroneNews> {
        self.events.subscribe()
    }

    pub(super) fn tell(&self, news: DroneNews) {
        // Nobody may listen.
        let _ = self.events.send(news);
    }

    /// Tells the states if it is time and somebody listens.
    pub(super) fn tell_states<I>(&mut self, now: Duration, states: impl FnOnce() -> I)
    where
        I: Iterator<Item = DroneState>,
    {
        if now >= self.next_states && self.states.receiver_count() > 0 {
            self.next_states = now + STATE_INTERVAL;
            self.states.send_replace(states().collect());
        }
    }
}
