//! Drones in real time on real sockets.

mod feed;
mod frames;
mod mjpeg;
mod report;

use std::future::Future;
use std::net::{IpAddr, SocketAddr};
use std::time::{Duration, Instant};

use tokio::net::UdpSocket;
use tokio::time::MissedTickBehavior;

use crate::fault::FaultKind;
use crate::{Channel, Drone, DroneOptions, Fault, LinkFaults, Space, TICK, World};
pub use feed::{Feed, FrameSink};
pub use frames::StreamTarget;
pub use report::{Line, Placed, State, Summary};

/// Largest datagram of MAVLink with room to spare.
const MAX_DATAGRAM: usize = 2048;

/// A run.
#[derive(Debug, Clone)]
pub struct Simulation {
    /// Where drones send to.
    pub server: SocketAddr,
    /// Their own address.
    pub bind: IpAddr,
    /// The drones, faults not yet built in.
    pub drones: Vec<DroneOptions>,
    /// What they can run into.
    pub space: Space,
    /// Distance under which pairs are reported, meters.
    pub separation: f64,
    /// What goes wrong.
    pub faults: Vec<Fault>,
    /// Their cameras.
    pub feed: Option<Feed>,
    /// Time between two state lines of a drone.
    pub report_interval: Duration,
}

/// Why a run could not begin or go on.
#[derive(Debug, thiserror::Error)]
pub enum SimulationError {
    /// A socket cannot be opened.
    #[error("cannot listen on {bind}: {source}")]
    Bind {
        /// Where.
        bind: SocketAddr,
        /// Why.
        source: std::io::Error,
    },
    /// There are no drones or more than one with a number.
    #[error("drones need numbers of their own from 1 to 254")]
    SystemIds,
    /// Nobody can draw what the cameras see.
    #[error("no threads for the cameras: {0}")]
    Threads(rayon::ThreadPoolBuildError),
}

/// The two ways of a drone's link.
struct Radio {
    socket: UdpSocket,
    inward: Channel,
    outward: Channel,
}

/// Flies until `stop` is done; every state and event goes to `each`.
///
/// # Errors
///
/// [`SimulationError`] if it cannot begin.
pub async fn simulate(
    simulation: Simulation,
    stop: impl Future<Output = ()>,
    mut each: impl FnMut(&Line),
) -> Result<Summary, SimulationError> {
    check_ids(&simulation.drones)?;
    let (mut drones, mut radios) = (Vec::new(), Vec::new());
    for options in &simulation.drones {
        let (options, link) = with_faults(options, &simulation.faults);
        let bind = SocketAddr::new(simulation.bind, 0);
        let socket =
            UdpSocket::bind(bind).await.map_err(|source| SimulationError::Bind { bind, source })?;
        let seed = options.seed.wrapping_mul(2);
        radios.push(Radio {
            socket,
            inward: Channel::new(link.clone(), seed),
            outward: Channel::new(link, seed + 1),
        });
        drones.push(Drone::new(options));
    }
    let mut world = World::new(simulation.space, drones, simulation.separation);
    let start = Instant::now();
    let mut cameras = match simulation.feed {
        Some(feed) => Some(feed::Cameras::start(feed, &world, &simulation.faults, start).await?),
        None => None,
    };
    if let Some(cameras) = &cameras {
        cameras.addresses().for_each(|line| each(&line));
    }
    let mut clock = tokio::time::interval(TICK / 2);
    clock.set_missed_tick_behavior(MissedTickBehavior::Skip);
    let mut next_report = Duration::ZERO;
    let mut batteries: Vec<&Fault> =
        simulation.faults.iter().filter(|f| matches!(f.kind, FaultKind::Battery(_))).collect();
    tokio::pin!(stop);
    loop {
        tokio::select! {
            () = &mut stop => break,
            _ = clock.tick() => {}
        }
        let now = start.elapsed();
        batteries.retain(|fault| !drain(fault, &mut world, now));
        for (drone, radio) in world.drones.iter_mut().zip(&mut radios) {
            radio.receive(drone, now);
        }
        world.step_to(now);
        for (drone, radio) in world.drones.iter_mut().zip(&mut radios) {
            radio.send(drone, simulation.server, now);
        }
        if let Some(cameras) = &mut cameras {
            cameras.look(&world, now);
            cameras.lines().iter().for_each(&mut each);
        }
        for (time, system_id, event) in world.events() {
            each(&Line::event(time, system_id, event));
        }
        if now >= next_report {
            next_report = (next_report + simulation.report_interval).max(now);
            world.drones.iter().for_each(|drone| each(&Line::state(world.now(), drone)));
        }
    }
    Ok(Summary::new(&world))
}

/// Sets the charge when its time has come; whether it has.
fn drain(fault: &Fault, world: &mut World, now: Duration) -> bool {
    let FaultKind::Battery(percent) = fault.kind else { return true };
    if now < fault.when.start {
        return false;
    }
    for drone in &mut world.drones {
        if fault.is_of(drone.options().system_id) {
            drone.set_battery(percent);
        }
    }
    true
}

impl Radio {
    fn receive(&mut self, drone: &mut Drone, now: Duration) {
        let mut buffer = [0; MAX_DATAGRAM];
        // Anybody who knows the port may send, as to a real drone.
        while let Ok((len, _)) = self.socket.try_recv_from(&mut buffer) {
            self.inward.send(buffer[..len].to_vec(), now);
        }
        for datagram in self.inward.receive(now) {
            drone.receive(&datagram, now);
        }
    }

    fn send(&mut self, drone: &mut Drone, server: SocketAddr, now: Duration) {
        for datagram in drone.poll() {
            self.outward.send(datagram, now);
        }
        for datagram in self.outward.receive(now) {
            // A server that does not listen yet, or a full buffer: lost, as on the air.
            let _ = self.socket.try_send_to(&datagram, server);
        }
    }
}

fn with_faults(options: &DroneOptions, faults: &[Fault]) -> (DroneOptions, LinkFaults) {
    let (mut options, mut link) = (options.clone(), LinkFaults::default());
    for fault in faults {
        fault.build_into(&mut options, &mut link);
    }
    (options, link)
}

fn check_ids(drones: &[DroneOptions]) -> Result<(), SimulationError> {
    let ids: std::collections::BTreeSet<u8> = drones.iter().map(|d| d.system_id).collect();
    let is_good = ids.len() == drones.len() && !ids.is_empty() && !ids.contains(&0);
    (is_good && !ids.contains(&255)).then_some(()).ok_or(SimulationError::SystemIds)
}
