//! The socket, the clock and the fleet.

use std::{
    collections::BTreeMap,
    net::{SocketAddr, UdpSocket},
    path::Path,
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    thread::JoinHandle,
    time::{Duration, Instant},
};

use tokio::sync::broadcast;
use volery_api::{Drone, DroneCommandStatus, DroneEvent, DroneState, PutDrone, VisionMessage};
use volery_flight::{Datagram, Fleet, FleetOptions, Key, VehicleId};

use super::{
    journal::Journal,
    leases::Leases,
    news::{DroneNews, News, States},
    recorder::{Recorder, Running},
    signing_time::{KEEP_TIME, SigningTimes},
    sockets::{self, Sockets},
    wire,
};
use crate::{clock, config::MavlinkSettings, flights::Flights};

/// Longest wait for a datagram: sending is late by this at most.
const RECEIVE_TIMEOUT: Duration = Duration::from_millis(5);

/// Why the drones' link cannot be opened.
#[derive(Debug, thiserror::Error)]
#[error("cannot open the drones' link at {0}: {1}")]
pub(crate) struct DroneLinkError(pub(crate) SocketAddr, pub(crate) std::io::Error);

/// All drones of the service.
#[derive(Debug)]
pub(crate) struct Drones {
    pub(super) shared: Arc<Shared>,
    thread: Mutex<Option<JoinHandle<()>>>,
}

#[derive(Debug)]
pub(super) struct Shared {
    socket: UdpSocket,
    address: SocketAddr,
    pub(super) start: Instant,
    closing: AtomicBool,
    state: Mutex<State>,
}

#[derive(Debug)]
pub(super) struct State {
    pub(super) fleet: Fleet,
    journal: Journal,
    pub(super) registered: BTreeMap<u8, PutDrone>,
    pub(super) flights: Flights,
    pub(super) leases: Leases,
    pub(super) recorder: Recorder,
    news: News,
}

impl Drones {
    /// Opens the socket and starts the thread.
    pub(crate) fn open(settings: &MavlinkSettings, data: &Path) -> Result<Self, DroneLinkError> {
        let failed = |error| DroneLinkError(settings.listen, error);
        let (socket, granted) = sockets::open(settings.listen).map_err(failed)?;
        let address = socket.local_addr().map_err(failed)?;
        tracing::info!(%address, granted_bytes = granted, "drones are heard on udp {address}");
        let times = SigningTimes::new(data);
        let (signing_time_at_zero, stream_times) = times.start().map_err(failed)?;
        let fleet = Fleet::new(FleetOptions {
            accept_unsigned: settings.accept_unsigned,
            default_key: settings.key.map(Key),
            signing_time_at_zero,
            stream_times,
            max_pose_age: settings.max_pose_age,
        });
        let shared = Arc::new(Shared {
            socket,
            address,
            start: Instant::now(),
            closing: AtomicBool::new(false),
            state: Mutex::new(State {
                fleet,
                journal: Journal::new(),
                registered: BTreeMap::new(),
                flights: Flights::new(),
                leases: Leases::default(),
                recorder: Recorder::new(data),
                news: News::new(),
            }),
        });
        let sockets = shared.socket.try_clone().and_then(Sockets::new).map_err(failed)?;
        let thread = std::thread::Builder::new().name("drones".to_owned()).spawn({
            let shared = Arc::clone(&shared);
            move || shared.run(sockets, &times)
        });
        Ok(Self { shared, thread: Mutex::new(Some(thread.map_err(failed)?)) })
    }

    /// Where drones are heard.
    pub(crate) fn address(&self) -> SocketAddr {
        self.shared.address
    }

    /// Ends the thread.
    pub(crate) fn close(&self) {
        self.shared.closing.store(true, Ordering::Relaxed);
        let thread = self.thread.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(thread) = thread {
            // A panic has been reported.
            let _ = thread.join();
        }
        self.shared.lock().recorder.stop_all().for_each(Running::finish);
    }

    /// Registers a drone, or replaces its settings, whose key must be one.
    pub(crate) fn register(&self, id: u8, drone: PutDrone) {
        self.shared.with(|state, _| {
            let vision = match drone.vision {
                VisionMessage::PositionEstimate => volery_flight::VisionMessage::PositionEstimate,
                VisionMessage::Odometry => volery_flight::VisionMessage::Odometry,
            };
            let key = drone.signing_key.as_deref().and_then(wire::key);
            state.fleet.set_key(VehicleId(id), key);
            state.fleet.set_vision_message(VehicleId(id), vision);
            state.registered.insert(id, drone);
        });
    }

    /// The settings of a registered drone, with its key.
    pub(crate) fn settings(&self, id: u8) -> Option<PutDrone> {
        self.shared.with(|state, _| state.registered.get(&id).cloned())
    }

    /// Takes the settings of a drone away. Returns whether it had any.
    pub(crate) fn unregister(&self, id: u8) -> bool {
        self.shared.with(|state, now| {
            state.fleet.set_key(VehicleId(id), None);
            let was_heard = state.fleet.forget(VehicleId(id), now);
            state.registered.remove(&id).is_some() || was_heard
        })
    }

    /// All drones that are registered or were heard.
    pub(crate) fn list(&self) -> Vec<Drone> {
        self.shared.read(|state, now| {
            let heard = state.fleet.vehicles().map(|vehicle| vehicle.id.0);
            let ids: std::collections::BTreeSet<u8> =
                state.registered.keys().copied().chain(heard).collect();
            ids.into_iter().map(|id| state.drone(id, now)).collect()
        })
    }

    /// One of them.
    pub(crate) fn get(&self, id: u8) -> Option<Drone> {
        self.shared.read(|state, now| {
            let drone = state.drone(id, now);
            (drone.name.is_some() || drone.state.is_some()).then_some(drone)
        })
    }

    /// How far a command is.
    pub(crate) fn command_status(&self, id: u64) -> Option<DroneCommandStatus> {
        self.shared.read(|state, _| state.journal.command(id))
    }

    /// What a drone says of itself.
    pub(crate) fn state(&self, id: u8) -> Option<DroneState> {
        self.shared.read(|state, now| {
            let vehicle = state.fleet.vehicle(VehicleId(id))?;
            Some(wire::drone_state(vehicle, now, clock::now_ns()))
        })
    }

    /// Reads flights.
    pub(crate) fn read_flights<T>(&self, look: impl FnOnce(&Flights, &Fleet, Duration) -> T) -> T {
        self.shared.read(|state, now| look(&state.flights, &state.fleet, now))
    }

    /// Changes flights.
    pub(crate) fn flights<T>(
        &self,
        change: impl FnOnce(&mut Flights, &mut Fleet, Duration) -> T,
    ) -> T {
        self.shared.with(|state, now| change(&mut state.flights, &mut state.fleet, now))
    }

    /// States of a drone, or of all, ten times a second.
    pub(crate) fn watch(&self, drone: Option<u8>) -> States {
        self.shared.lock().news.watch(drone)
    }

    /// Commands and alerts of all drones from now on.
    pub(crate) fn listen(&self) -> broadcast::Receiver<DroneNews> {
        self.shared.read(|state, _| state.news.listen())
    }

    /// Events of a drone after the one numbered `after`, as far as they are kept.
    pub(crate) fn events(&self, id: u8, after: u64) -> Vec<DroneEvent> {
        self.shared.read(|state, _| state.journal.events(id, after))
    }
}

impl State {
    /// What an address sent or gets, if a drone of it is recorded.
    fn record(&self, address: SocketAddr, datagram: &[u8]) {
        if !self.recorder.is_idle() {
            for vehicle in self.fleet.vehicles().filter(|vehicle| vehicle.address == address) {
                self.recorder.record(vehicle.id.0, datagram);
            }
        }
    }

    fn drone(&self, id: u8, now: Duration) -> Drone {
        let registered = self.registered.get(&id);
        let vehicle = self.fleet.vehicle(VehicleId(id));
        Drone {
            id,
            name: registered.map(|drone| drone.name.clone()),
            has_own_key: registered.is_some_and(|drone| drone.signing_key.is_some()),
            vision: registered.map(|drone| drone.vision).unwrap_or_default(),
            body_from_camera: registered.map(|drone| drone.body_from_camera).unwrap_or_default(),
            state: vehicle.map(|vehicle| wire::drone_state(vehicle, now, clock::now_ns())),
        }
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Looks, and changes nothing.
    pub(super) fn read<T>(&self, look: impl FnOnce(&State, Duration) -> T) -> T {
        let state = self.lock();
        look(&state, self.start.elapsed())
    }

    /// Passes something on to one drone: it is sent at once, and nothing else is.
    pub(super) fn relay<T>(&self, pass: impl FnOnce(&mut State, Duration) -> T) -> T {
        let mut state = self.lock();
        let result = pass(&mut state, self.start.elapsed());
        let datagrams = state.fleet.take_datagrams();
        self.transmit(&state, datagrams);
        result
    }

    /// Changes the fleet, and sends what follows from it before anybody else gets it.
    pub(super) fn with<T>(&self, change: impl FnOnce(&mut State, Duration) -> T) -> T {
        let mut state = self.lock();
        let now = self.start.elapsed();
        let result = change(&mut state, now);
        self.send(&mut state, now);
        result
    }

    fn transmit(&self, state: &State, datagrams: Vec<Datagram>) {
        for datagram in datagrams {
            state.record(datagram.to, &datagram.bytes);
            // A drone that cannot be reached is noticed by its silence.
            if let Err(error) = self.socket.send_to(&datagram.bytes, datagram.to) {
                tracing::debug!(%error, to = %datagram.to, "datagram not sent");
            }
        }
    }

    fn send(&self, state: &mut State, now: Duration) {
        state.flights.poll(&mut state.fleet, now, clock::now_ns());
        let datagrams = state.fleet.poll(now);
        self.transmit(state, datagrams);
        let t_ns = clock::now_ns();
        for event in state.fleet.take_events() {
            state.journal.write(&event, t_ns, &state.news);
        }
        for vehicle in state.fleet.vehicles() {
            let tell = || wire::drone_state(vehicle, now, t_ns);
            state.news.tell_state(now, vehicle.id.0, tell);
        }
    }

    /// Receives, and sends when it is time, until it is told to end.
    fn run(&self, mut sockets: Sockets, signing_times: &SigningTimes) {
        let mut next_keep = Duration::ZERO;
        while !self.closing.load(Ordering::Relaxed) {
            sockets.wait(RECEIVE_TIMEOUT);
            let mut state = self.lock();
            sockets.receive(|datagram, from| {
                state.fleet.receive(datagram, from, self.start.elapsed());
                state.record(from, datagram);
            });
            let now = self.start.elapsed();
            if now >= state.fleet.next_wakeup() {
                self.send(&mut state, now);
                let drones = state.fleet.vehicles().map(|vehicle| vehicle.address).collect();
                sockets.follow(&drones);
            }
            if now >= next_keep {
                next_keep = now + KEEP_TIME;
                let (own, streams) = (state.fleet.signing_time(now), state.fleet.stream_times());
                drop(state);
                if let Err(error) = signing_times.keep(own, &streams) {
                    tracing::warn!(%error, "cannot keep the signing times");
                }
            }
        }
    }
}
