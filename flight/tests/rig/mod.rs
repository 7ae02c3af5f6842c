//! A fleet and simulated drones in simulated time.

#![allow(dead_code)] // no test uses all of it

use std::{net::SocketAddr, time::Duration};

use nalgebra::Point3;
use volery_flight::{
    Command, CommandId, CommandState, Event, FeedState, Fleet, FleetOptions, Happening, Key,
    PoseFix, PoseRefusal, Setpoint, VehicleId, signing_time,
};
use volery_simulator::{
    Channel, Drone, DroneOptions, Event as Seen, Flavor, LinkFaults, PoseOptions, PoseSource,
    Signing, Space, TICK, World,
};

/// Signing time of the start: late in 2026.
pub(crate) fn epoch() -> u64 {
    signing_time(Duration::from_secs(1_795_000_000))
}

/// What a flight is like.
#[derive(Debug, Clone)]
pub(crate) struct Conditions {
    pub(crate) flavor: Flavor,
    pub(crate) key: Option<[u8; 32]>,
    pub(crate) faults: LinkFaults,
    pub(crate) poses: PoseOptions,
    pub(crate) seed: u64,
}

impl Default for Conditions {
    fn default() -> Self {
        Self {
            flavor: Flavor::ArduPilot,
            key: None,
            faults: LinkFaults::default(),
            poses: PoseOptions { delay: Duration::from_millis(30), ..PoseOptions::default() },
            seed: 1,
        }
    }
}

/// A fleet, its drones, and all that lies between.
pub(crate) struct Rig {
    pub(crate) fleet: Fleet,
    pub(crate) world: World,
    pub(crate) sources: Vec<PoseSource>,
    pub(crate) events: Vec<(Duration, Event)>,
    pub(crate) refusals: Vec<(Duration, VehicleId, PoseRefusal)>,
    pub(crate) now: Duration,
    /// Poses older than allowed, found on the way to a drone.
    pub(crate) feeding: bool,
    up: Vec<Channel>,
    down: Vec<Channel>,
}

impl Rig {
    /// `count` drones side by side, numbered from 1.
    pub(crate) fn new(count: u8, conditions: &Conditions) -> Self {
        let start = |index: u8| Point3::new(0.0, 1.5 * f64::from(index), 0.0);
        Self::at((0..count).map(start).collect(), conditions)
    }

    /// A drone at each of the places, numbered from 1.
    pub(crate) fn at(starts: Vec<Point3<f64>>, conditions: &Conditions) -> Self {
        let count = starts.len();
        let drones = (1..).zip(starts).map(|(id, start)| {
            let signing = conditions.key.map(|key| Signing { key, epoch: epoch() });
            let seed = conditions.seed * 100 + u64::from(id);
            Drone::new(DroneOptions {
                signing,
                seed,
                yaw: 0.3,
                ..DroneOptions::new(id, conditions.flavor, start)
            })
        });
        let channel = |seed: u64| Channel::new(conditions.faults.clone(), seed);
        let seeds =
            |offset: u64| (0..count as u64).map(move |i| conditions.seed * 1000 + offset + i);
        Self {
            fleet: Fleet::new(FleetOptions {
                accept_unsigned: conditions.key.is_none(),
                default_key: conditions.key.map(Key),
                signing_time_at_zero: epoch(),
                ..FleetOptions::default()
            }),
            world: World::new(Space::Open, drones.collect(), 0.6),
            sources: seeds(0).map(|seed| PoseSource::new(conditions.poses.clone(), seed)).collect(),
            events: Vec::new(),
            refusals: Vec::new(),
            now: Duration::ZERO,
            feeding: true,
            up: seeds(100).map(channel).collect(),
            down: seeds(200).map(channel).collect(),
        }
    }

    /// Where the datagrams of a drone come from.
    pub(crate) fn address(index: usize) -> SocketAddr {
        SocketAddr::from(([127, 0, 0, 1], 20_000 + index as u16))
    }

    /// One tick of everything.
    pub(crate) fn step(&mut self) {
        self.now += TICK;
        let now = self.now;
        for (index, channel) in self.down.iter_mut().enumerate() {
            for datagram in channel.receive(now) {
                self.world.drones[index].receive(&datagram, now);
            }
        }
        self.world.step_to(now);
        for index in 0..self.world.drones.len() {
            for datagram in self.world.drones[index].poll() {
                self.up[index].send(datagram, now);
            }
            for datagram in self.up[index].receive(now) {
                self.fleet.receive(&datagram, Self::address(index), now);
            }
            let truth = self.world.drones[index].world_from_body();
            let id = VehicleId(index as u8 + 1);
            for sample in self.sources[index].poll(&truth, now) {
                let fix = PoseFix {
                    map_from_body: sample.world_from_body,
                    captured: sample.captured,
                    position_sd: 0.02,
                    angle_sd: 0.01,
                    resets: 0,
                };
                if !self.feeding {
                    continue;
                }
                if let Err(refusal) = self.fleet.pose(id, fix, now) {
                    self.refusals.push((now, id, refusal));
                }
            }
        }
        for datagram in self.fleet.poll(now) {
            let index = usize::from(datagram.to.port() - 20_000);
            // Nobody is at the addresses of strangers.
            if let Some(channel) = self.down.get_mut(index) {
                channel.send(datagram.bytes, now);
            }
        }
        self.events.extend(self.fleet.take_events().into_iter().map(|event| (now, event)));
    }

    /// Runs for `seconds`.
    pub(crate) fn run(&mut self, seconds: f64) {
        let end = self.now + Duration::from_secs_f64(seconds);
        while self.now < end {
            self.step();
        }
    }

    /// Runs until `done` or for `seconds`; whether it was done.
    pub(crate) fn run_until(&mut self, seconds: f64, mut done: impl FnMut(&Self) -> bool) -> bool {
        let end = self.now + Duration::from_secs_f64(seconds);
        while self.now < end && !done(self) {
            self.step();
        }
        done(self)
    }

    /// Every estimator follows.
    pub(crate) fn is_ready(&self) -> bool {
        self.fleet.vehicles().count() == self.world.drones.len()
            && self.fleet.vehicles().all(|vehicle| vehicle.feed_state() == FeedState::Ready)
    }

    /// Gives a command to a vehicle that takes it.
    pub(crate) fn command(&mut self, id: u8, command: Command) -> CommandId {
        let given = self.fleet.command(VehicleId(id), &command, self.now);
        given.unwrap_or_else(|refusal| panic!("{id}: {refusal:?} {:#?}", self.tail()))
    }

    /// The end of a command, if it has come.
    pub(crate) fn outcome(&self, id: CommandId) -> Option<&CommandState> {
        self.events.iter().find_map(|(_, event)| match &event.happening {
            Happening::Command { id: of, state } if *of == id && state.is_final() => Some(state),
            _ => None,
        })
    }

    /// Runs until the commands are over, which must be good.
    pub(crate) fn finish(&mut self, commands: &[CommandId], seconds: f64) {
        let over =
            self.run_until(seconds, |rig| commands.iter().all(|&id| rig.outcome(id).is_some()));
        let seen = self.world.events();
        let told = |event: &Seen| !matches!(event, Seen::Command { .. });
        let seen: Vec<_> = seen.iter().filter(|(_, _, event)| told(event)).rev().take(9).collect();
        let refused: Vec<_> = self.refusals.iter().rev().take(9).collect();
        for &id in commands {
            let outcome = self.outcome(id);
            let tail = self.tail();
            let done = Some(&CommandState::Done);
            assert_eq!(outcome, done, "{over} {tail:#?} {refused:?} {seen:?}");
        }
    }

    /// The latest events, to explain a failure.
    pub(crate) fn tail(&self) -> Vec<String> {
        let told = |happening: &Happening| {
            !matches!(happening, Happening::Landed(_) | Happening::Armed(_))
        };
        let events = self.events.iter().filter(|(_, event)| told(&event.happening));
        let events = events.rev().take(25).collect::<Vec<_>>().into_iter().rev();
        events.map(|(time, event)| format!("{:.2} {event:?}", time.as_secs_f64())).collect()
    }

    /// Ready, armed, up at 1.5 m.
    pub(crate) fn take_off(&mut self) {
        assert!(self.run_until(30.0, Self::is_ready), "never ready: {:#?}", self.tail());
        let count = self.world.drones.len() as u8;
        let commands: Vec<_> =
            (1..=count).map(|id| self.command(id, Command::TakeOff { height: 1.5 })).collect();
        self.finish(&commands, 60.0);
    }

    /// True distance of a drone from a place.
    pub(crate) fn error(&self, id: u8, place: &Point3<f64>) -> f64 {
        (self.world.drones[usize::from(id) - 1].body().position - place).norm()
    }

    /// To a place, as a user would.
    pub(crate) fn go(&mut self, id: u8, place: Point3<f64>, yaw: f64) -> CommandId {
        self.command(
            id,
            Command::Go {
                setpoint: Setpoint::at(place, yaw),
                tolerance: 0.15,
                timeout: Duration::from_secs(30),
            },
        )
    }
}
