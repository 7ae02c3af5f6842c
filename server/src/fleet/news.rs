//! What is told to whoever listens: states as they are, commands and alerts as they happen.

use std::{collections::BTreeMap, sync::Arc, time::Duration};

use tokio::sync::{broadcast, watch};
use volery_api::{DroneAlert, DroneCommandStatus, DroneState};

/// Between two states of a drone.
const STATE_INTERVAL: Duration = Duration::from_millis(100);
/// The drones take turns, so that their states do not all go out at once: this part of the interval
/// times its id is a drone's turn. Multiples of the golden ratio spread any ids evenly.
const TURN: f64 = 0.618_033_988_749_895;
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

/// States as they come; a slow listener gets the newest.
#[derive(Debug)]
pub(crate) enum States {
    /// Of one drone.
    One(watch::Receiver<Option<Arc<DroneState>>>),
    /// Of all drones, after the one with the number.
    All(watch::Receiver<Newest>, u64),
}

/// The newest state of each drone, with numbers that grow.
type Newest = BTreeMap<u8, (u64, Arc<DroneState>)>;

impl States {
    /// Those that are new; `None` when there will be no more.
    pub(crate) async fn next(&mut self) -> Option<Vec<Arc<DroneState>>> {
        match self {
            Self::One(state) => {
                state.changed().await.ok()?;
                Some(state.borrow_and_update().iter().cloned().collect())
            }
            Self::All(newest, known) => {
                newest.changed().await.ok()?;
                let newest = newest.borrow_and_update();
                let fresh = newest.values().filter(|(number, _)| number > known);
                let fresh = fresh.map(|(_, state)| Arc::clone(state)).collect();
                *known = last(&newest);
                Some(fresh)
            }
        }
    }
}

fn last(newest: &Newest) -> u64 {
    newest.values().map(|&(number, _)| number).max().unwrap_or(0)
}

/// Passes it on.
#[derive(Debug)]
pub(super) struct News {
    states: BTreeMap<u8, watch::Sender<Option<Arc<DroneState>>>>,
    newest: watch::Sender<Newest>,
    /// Per drone, the interval in which its state was told.
    told_in: BTreeMap<u8, u64>,
    events: broadcast::Sender<DroneNews>,
}

impl News {
    pub(super) fn new() -> Self {
        Self {
            states: BTreeMap::new(),
            newest: watch::Sender::default(),
            told_in: BTreeMap::new(),
            events: broadcast::Sender::new(MAX_BEHIND),
        }
    }

    /// States of a drone, or of all, from now on.
    pub(super) fn watch(&mut self, drone: Option<u8>) -> States {
        match drone {
            Some(id) => States::One(self.states.entry(id).or_default().subscribe()),
            None => {
                let newest = self.newest.subscribe();
                let known = last(&newest.borrow());
                States::All(newest, known)
            }
        }
    }

    /// Events of all drones from now on.
    pub(super) fn listen(&self) -> broadcast::Receiver<DroneNews> {
        self.events.subscribe()
    }

    pub(super) fn tell(&self, news: DroneNews) {
        // Nobody may listen.
        let _ = self.events.send(news);
    }

    /// Tells the state of a drone if it is its turn and somebody listens.
    pub(super) fn tell_state(&mut self, now: Duration, id: u8, state: impl FnOnce() -> DroneState) {
        let turn = STATE_INTERVAL.mul_f64((f64::from(id) * TURN).fract());
        let interval = ((now + turn).as_micros() / STATE_INTERVAL.as_micros()) as u64;
        if self.told_in.insert(id, interval) == Some(interval) {
            return;
        }
        let own = self.states.get(&id).filter(|sender| sender.receiver_count() > 0);
        let has_listeners_to_all = self.newest.receiver_count() > 0;
        if own.is_none() && !has_listeners_to_all {
            return;
        }
        let state = Arc::new(state());
        if let Some(own) = own {
            own.send_replace(Some(Arc::clone(&state)));
        }
        if has_listeners_to_all {
            self.newest.send_modify(|newest| {
                newest.insert(id, (last(newest) + 1, state));
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use futures_util::FutureExt;
    use serde_json::json;

    use super::*;

    fn state(id: u8, t_ns: u64) -> DroneState {
        let link = json!({"state": "linked", "silence_ms": 0, "loss": 0});
        let state = json!({
            "id": id, "t_ns": t_ns, "autopilot": "px4", "endpoint": "", "link": link, "feed": "idle",
            "armed": false, "flying": false, "failsafe": false, "in_control": false,
        });
        serde_json::from_value(state).unwrap()
    }

    /// 50 drones for 10 s, polled every 10 ms: each is told 100 times, five at once but for two.
    #[test]
    fn the_drones_take_turns() {
        let mut news = News::new();
        let listeners: Vec<States> = (1..=50).map(|id| news.watch(Some(id))).collect();
        let mut told = [0; 51];
        for poll in 0..1000 {
            let before: u32 = told.iter().sum();
            for id in 1..=50 {
                let tell = || {
                    told[usize::from(id)] += 1;
                    state(id, poll)
                };
                news.tell_state(Duration::from_millis(10 * poll), id, tell);
            }
            let at_once = told.iter().sum::<u32>() - before;
            assert!(poll == 0 || at_once <= 7, "{at_once}");
        }
        assert!(told[1..].iter().all(|n| (100..=101).contains(n)), "{told:?}");
        drop(listeners);
    }

    #[test]
    fn a_slow_listener_gets_the_newest_and_nobody_the_old() {
        let mut news = News::new();
        let tell = |news: &mut News, id: u8, t_ns: u64| {
            news.tell_state(Duration::from_millis(100 * t_ns), id, || state(id, t_ns));
        };
        let heard = |states: &mut States| {
            let fresh = states.next().now_or_never().flatten().unwrap_or_default();
            fresh.iter().map(|state| (state.id, state.t_ns)).collect::<Vec<_>>()
        };
        let (mut one, mut all) = (news.watch(Some(7)), news.watch(None));
        assert_eq!((heard(&mut one), heard(&mut all)), (vec![], vec![]));
        for t in 1..=3 {
            tell(&mut news, 7, t);
        }
        tell(&mut news, 9, 4);
        assert_eq!(heard(&mut one), [(7, 3)]);
        assert_eq!(heard(&mut all), [(7, 3), (9, 4)]);
        let mut late = news.watch(None);
        tell(&mut news, 9, 5);
        assert_eq!(
            (heard(&mut one), heard(&mut all), heard(&mut late)),
            (vec![], vec![(9, 5)], vec![(9, 5)])
        );
    }

    #[test]
    fn nobody_is_told_what_nobody_asked_for() {
        let mut news = News::new();
        news.tell_state(Duration::ZERO, 1, || panic!("nobody listens"));
        let others = news.watch(Some(2));
        news.tell_state(Duration::from_secs(1), 1, || panic!("nobody listens"));
        drop((news.watch(None), others));
        news.tell_state(Duration::from_secs(2), 2, || panic!("nobody listens any more"));
    }
}
