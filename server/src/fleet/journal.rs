//! What happened to drones lately, and how far commands are.

use std::collections::{BTreeMap, VecDeque};

use volery_api::{DroneAlert, DroneCommandStatus, DroneEvent};
use volery_flight::{Event, Happening, LinkState};

use super::{
    news::{DroneNews, News},
    wire,
};

/// Events kept.
const MAX_EVENTS: usize = 4096;
/// Commands kept.
const MAX_COMMANDS: usize = 4096;

/// What happened lately.
#[derive(Debug)]
pub(super) struct Journal {
    events: VecDeque<DroneEvent>,
    commands: BTreeMap<u64, DroneCommandStatus>,
    last_seq: u64,
}

impl Journal {
    pub(super) fn new() -> Self {
        Self { events: VecDeque::new(), commands: BTreeMap::new(), last_seq: 0 }
    }

    pub(super) fn write(&mut self, event: &Event, t_ns: u64, news: &News) {
        let drone = event.vehicle.0;
        if let Happening::Command { id, state } = &event.happening {
            let status = wire::command_status(*id, event.vehicle, state);
            if self.commands.len() >= MAX_COMMANDS {
                self.commands.pop_first();
            }
            self.commands.insert(id.0, status.clone());
            news.tell(DroneNews::Command(status));
        }
        self.last_seq += 1;
        let (kind, value, detail) = wire::happening(&event.happening);
        let alert = match &event.happening {
            Happening::Alert(_) => Some((value.clone(), detail.clone())),
            Happening::Link(LinkState::Lost) => Some(("link_lost".to_owned(), None)),
            _ => None,
        };
        if let Some((code, detail)) = alert {
            news.tell(DroneNews::Alert(DroneAlert { drone, flight_id: None, t_ns, code, detail }));
        }
        let event =
            DroneEvent { seq: self.last_seq, drone, t_ns, kind: kind.to_owned(), value, detail };
        tracing::info!(
            drone,
            kind,
            value = %event.value,
            detail = event.detail.as_deref(),
            "drone {drone}: {kind} {}",
            event.value
        );
        if self.events.len() == MAX_EVENTS {
            self.events.pop_front();
        }
        self.events.push_back(event);
    }

    pub(super) fn events(&self, drone: u8, after: u64) -> Vec<DroneEvent> {
        let of_drone = |event: &&DroneEvent| event.drone == drone && event.seq > after;
        self.events.iter().filter(of_drone).cloned().collect()
    }

    pub(super) fn command(&self, id: u64) -> Option<DroneCommandStatus> {
        self.commands.get(&id).cloned()
    }
}
