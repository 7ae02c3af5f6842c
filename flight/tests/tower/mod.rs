//! The fleet of the ground station and simulated drones on one clock, without sockets.
#![allow(unreachable_pub, dead_code)]

use std::collections::VecDeque;
use std::net::SocketAddr;
use std::time::Duration;

use nalgebra::{Isometry3, Point3, Vector3};
use volery_flight::{
    Command, CommandId, CommandState, Fleet, FleetOptions, Happening, Key, LinkState, PoseFix,
    PoseRefusal, Setpoint, VehicleId,
};
use volery_simulator::*;

pub const MS: Duration = Duration::from_millis(1);
pub const KEY: Signing = Signing { key: [5; 32], epoch: 1 << 40 };
/// Step of the run.
const STEP: Duration = Duration::from_millis(10);
/// A pose further than this from the truth of its moment is false.
pub const FALSE_POSE: (f64, f64) = (0.15, 0.1);

/// Poses of one drone on their way to the fleet.
pub struct Eyes {
    pub source: PoseSource,
    /// From when on the source has given up where it was.
    pub gives_up: Duration,
    truths: VecDeque<(Duration, Isometry3<f64>)>,
    /// Poses that the fleet sent on, and false ones among them.
    pub num_sent: u32,
    pub num_false: u32,
    pub refusals: Vec<(Duration, PoseRefusal)>,
}

/// All of it.
pub struct Tower {
    pub fleet: Fleet,
    pub world: World,
    pub eyes: Vec<Eyes>,
    pub up: Vec<Channel>,
    pub down: Vec<Channel>,
    pub now: Duration,
    /// Killed: it hears and says nothing any more.
    pub is_dead: bool,
    /// What the fleet said.
    pub happened: Vec<(Duration, u8, Happening)>,
    /// What really happened.
    pub events: Vec<(Duration, u8, Event)>,
    /// Datagrams of the drones that reached the fleet.
    pub num_delivered: u64,
    /// The first of them of the first drone.
    pub overheard: Vec<Vec<u8>>,
}

pub fn address(system_id: u8) -> SocketAddr {
    ([127, 0, 0, 1], 20_000 + u16::from(system_id)).into()
}

impl Tower {
    pub fn new(drones: Vec<DroneOptions>, faults: &LinkFaults, poses: &PoseOptions) -> Self {
        let room = [Point3::new(-8.0, -8.0, 0.0), Point3::new(8.0, 8.0, 4.0)];
        let options = FleetOptions {
            accept_unsigned: true,
            signing_time_at_zero: KEY.epoch,
            ..FleetOptions::default()
        };
        let mut fleet = Fleet::new(options);
        for drone in &drones {
            if let Some(signing) = drone.signing {
                fleet.set_key(VehicleId(drone.system_id), Some(Key(signing.key)));
            }
        }
        let seed =
            |drone: &DroneOptions, way| drone.seed * 1000 + u64::from(drone.system_id) * 2 + way;
        let channel =
            |way| move |drone: &DroneOptions| Channel::new(faults.clone(), seed(drone, way));
        let (up, down) =
            (drones.iter().map(channel(0)).collect(), drones.iter().map(channel(1)).collect());
        let eyes = drones
            .iter()
            .map(|drone| Eyes {
                source: PoseSource::new(poses.clone(), seed(drone, 0)),
                gives_up: Duration::MAX,
                truths: VecDeque::new(),
                num_sent: 0,
                num_false: 0,
                refusals: Vec::new(),
            })
            .collect();
        Self {
            fleet,
            world: World::new(
                Space::Hollow(room),
                drones.into_iter().map(Drone::new).collect(),
                0.8,
            ),
            eyes,
            up,
            down,
            now: Duration::ZERO,
            is_dead: false,
            happened: Vec::new(),
            events: Vec::new(),
            num_delivered: 0,
            overheard: Vec::new(),
        }
    }

    pub fn step(&mut self) {
        self.now += STEP;
        let now = self.now;
        for index in 0..self.world.drones.len() {
            let id = self.world.drones[index].options().system_id;
            for datagram in self.world.drones[index].poll() {
                self.up[index].send(datagram, now);
            }
            for datagram in self.up[index].receive(now) {
                self.num_delivered += 1;
                if index == 0 && self.overheard.len() < 100 {
                    self.overheard.push(datagram.clone());
                }
                if !self.is_dead {
                    self.fleet.receive(&datagram, address(id), now);
                }
            }
            if !self.is_dead {
                self.look(index, id);
            }
        }
        let sent = if self.is_dead { Vec::new() } else { self.fleet.poll(now) };
        for datagram in sent {
            let index = self
                .world
                .drones
                .iter()
                .position(|drone| address(drone.options().system_id) == datagram.to)
                .expect("the fleet answers to addresses that it knows");
            self.down[index].send(datagram.bytes, now);
        }
        for (drone, channel) in self.world.drones.iter_mut().zip(&mut self.down) {
            for datagram in channel.receive(now) {
                drone.receive(&datagram, now);
            }
        }
        self.world.step_to(now);
        self.events.extend(self.world.events());
        let events = self.fleet.take_events();
        self.happened.extend(events.into_iter().map(|e| (now, e.vehicle.0, e.happening)));
    }

    fn look(&mut self, index: usize, id: u8) {
        let (now, truth) = (self.now, self.world.drones[index].world_from_body());
        let eyes = &mut self.eyes[index];
        eyes.truths.push_back((now, truth));
        if eyes.truths.len() > 200 {
            eyes.truths.pop_front();
        }
        for sample in eyes.source.poll(&truth, now) {
            let fix = PoseFix {
                map_from_body: sample.world_from_body,
                captured: sample.captured,
                position_sd: 0.02,
                angle_sd: 0.01,
                resets: u32::from(sample.captured >= eyes.gives_up),
            };
            match self.fleet.pose(VehicleId(id), fix, now) {
                Ok(()) => {
                    eyes.num_sent += 1;
                    let truth = eyes.truths.iter().find(|(time, _)| *time == sample.captured);
                    let (_, truth) = truth.expect("poses are younger than two seconds");
                    let off = truth.inverse() * sample.world_from_body;
                    let is_false = off.translation.vector.norm() > FALSE_POSE.0
                        || off.rotation.angle() > FALSE_POSE.1;
                    eyes.num_false += u32::from(is_false);
                }
                Err(refusal) => eyes.refusals.push((now, refusal)),
            }
        }
    }

    pub fn run_until(&mut self, seconds: f64, mut until: impl FnMut(&Self) -> bool) -> bool {
        let end = self.now + Duration::from_secs_f64(seconds);
        while self.now < end {
            self.step();
            if until(self) {
                return true;
            }
        }
        false
    }

    pub fn run(&mut self, seconds: f64) {
        self.run_until(seconds, |_| false);
    }

    /// State of a command as far as it was told.
    pub fn state_of(&self, command: CommandId) -> Option<&CommandState> {
        self.happened.iter().rev().find_map(|(.., happening)| match happening {
            Happening::Command { id, state } if *id == command => Some(state),
            _ => None,
        })
    }

    /// Gives all drones a command and waits until all have done it.
    pub fn all(&mut self, seconds: f64, command: impl Fn(usize) -> Command) {
        let mut ids = Vec::new();
        for index in 0..self.world.drones.len() {
            let id = VehicleId(self.world.drones[index].options().system_id);
            let given = self.fleet.command(id, &command(index), self.now);
            ids.push(given.unwrap_or_else(|e| panic!("{id:?} {:?}: {e}", command(index))));
        }
        let done =
            |tower: &Self| ids.iter().all(|id| tower.state_of(*id) == Some(&CommandState::Done));
        let all_done = self.run_until(seconds, done);
        let states: Vec<_> = ids.iter().map(|id| self.state_of(*id)).collect();
        assert!(all_done, "{:?} at {:?}: {states:?} {:?}", command(0), self.now, self.events);
    }

    /// Until all drones are linked and their estimators follow.
    pub fn get_ready(&mut self) {
        let ready = |tower: &Self| {
            tower.fleet.vehicles().count() == tower.world.drones.len()
                && tower.fleet.vehicles().all(|vehicle| {
                    vehicle.link().state(tower.now) == LinkState::Linked
                        && vehicle.feed_state().name() == "ready"
                })
        };
        assert!(self.run_until(30.0, ready), "{:?}", self.happened);
    }

    pub fn take_off(&mut self, height: f64) {
        self.get_ready();
        self.all(30.0, |_| Command::TakeOff { height });
    }

    pub fn drone(&self) -> &Drone {
        &self.world.drones[0]
    }
}

/// Straight to a place.
pub fn go(position: Vector3<f64>, yaw: f64) -> Command {
    let setpoint = Setpoint::at(position.into(), yaw);
    Command::Go { setpoint, tolerance: 0.15, timeout: Duration::from_secs(30) }
}

/// A drone of each family by turns, in a row.
pub fn drone(index: u8, seed: u64, signing: Option<Signing>) -> DroneOptions {
    let flavor = if index.is_multiple_of(2) { Flavor::ArduPilot } else { Flavor::Px4 };
    let start = Point3::new(0.0, 1.5 * f64::from(index), 0.0);
    DroneOptions { seed, signing, ..DroneOptions::new(index + 1, flavor, start) }
}
