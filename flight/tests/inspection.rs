//! The inspection of parameters against simulated autopilots.

use std::{net::SocketAddr, time::Duration};

use nalgebra::Point3;
use volery_flight::{
    Autopilot, Key, VehicleId,
    parameters::{Inspector, Wanted, rules},
    signing_time,
};
use volery_simulator::{Drone, DroneOptions, Flavor, Signing, TICK};

const FLAVORS: [(Flavor, Autopilot); 2] =
    [(Flavor::ArduPilot, Autopilot::ArduPilot), (Flavor::Px4, Autopilot::Px4)];

fn address(port: u16) -> SocketAddr {
    ([127, 0, 0, 1], port).into()
}

fn options(flavor: Flavor) -> DroneOptions {
    DroneOptions::new(7, flavor, Point3::origin())
}

/// What is found wrong with a drone: names, in order, and whether it is only advice.
fn inspect(options: DroneOptions, inspector: &mut Inspector) -> Vec<(&'static str, bool)> {
    let mut drone = Drone::new(options);
    let mut now = Duration::ZERO;
    while inspector.vehicles().is_empty() || !inspector.is_done() {
        now += TICK;
        assert!(now < Duration::from_secs(30), "no end of questions");
        drone.step(now);
        for datagram in drone.poll() {
            inspector.receive(&datagram, address(1), now);
        }
        for datagram in inspector.poll(now) {
            assert_eq!(datagram.to, address(1));
            drone.receive(&datagram.bytes, now);
        }
    }
    let findings = inspector.vehicles()[&VehicleId(7)].inspection.findings();
    findings.iter().map(|finding| (finding.rule.names[0], finding.rule.is_advice)).collect()
}

/// A drone set up for flight by camera lacks nothing but advice; each parameter that is wrong is
/// named, and no other.
#[test]
fn each_wrong_parameter_is_named() {
    for (flavor, autopilot) in FLAVORS {
        let sound = inspect(options(flavor), &mut Inspector::new(None, 0));
        assert!(sound.iter().all(|(_, is_advice)| *is_advice), "{sound:?}");
        for rule in rules(autopilot) {
            let wrong = match rule.wanted {
                Wanted::OneOf(values) => values[0] + 1.0,
                Wanted::Between(_, high) => high + 1.0,
            };
            let name = rule.names[0];
            let parameters = vec![(name.to_owned(), wrong)];
            let found = inspect(
                DroneOptions { parameters, ..options(flavor) },
                &mut Inspector::new(None, 0),
            );
            assert!(found.contains(&(name, rule.is_advice)), "{name}: {found:?}");
            assert!(found.iter().all(|f| f.0 == name || sound.contains(f)), "{name}: {found:?}");
        }
    }
}

/// A signed drone answers who has its key, and nobody else.
#[test]
fn signed_drones_answer_their_key() {
    let epoch = signing_time(Duration::from_secs(1_795_000_000));
    for (key, is_heard) in [(Some([5; 32]), true), (Some([6; 32]), false), (None, false)] {
        let signing = Some(Signing { key: [5; 32], epoch });
        let parameters = vec![("COMPASS_ENABLE".to_owned(), 1.0)];
        let drone = DroneOptions { signing, parameters, ..options(Flavor::ArduPilot) };
        let mut inspector = Inspector::new(key.map(Key), epoch);
        inspect(drone, &mut inspector);
        let findings = inspector.vehicles()[&VehicleId(7)].inspection.findings();
        let compass = findings.iter().find(|f| f.rule.names[0] == "COMPASS_ENABLE").unwrap();
        assert_eq!(compass.value, is_heard.then_some(1.0));
    }
}

/// The signing clock of a drone is told, also of one that is so far behind that it is not heard.
#[test]
fn signing_clocks_are_compared() {
    let epoch = signing_time(Duration::from_secs(1_795_000_000));
    for ahead in [0.0, 20.0, 3600.0, -20.0, -3600.0] {
        let theirs = epoch.saturating_add_signed((ahead * 1e5) as i64);
        let signing = Some(Signing { key: [5; 32], epoch: theirs });
        let drone = DroneOptions { signing, ..options(Flavor::Px4) };
        let mut inspector = Inspector::new(Some(Key([5; 32])), epoch);
        inspect(drone, &mut inspector);
        let found = inspector.vehicles()[&VehicleId(7)].clock_ahead.unwrap();
        assert!((found - ahead).abs() < 0.1, "{ahead} s: {found} s");
    }
}

/// Two vehicles of one number are told by their addresses.
#[test]
fn one_number_at_two_addresses_is_seen() {
    let mut inspector = Inspector::new(None, 0);
    let mut drones = [1, 2].map(|_| Drone::new(options(Flavor::Px4)));
    for tick in 1..=100 {
        let now = TICK * tick;
        for (drone, port) in drones.iter_mut().zip([1, 2]) {
            drone.step(now);
            for datagram in drone.poll() {
                inspector.receive(&datagram, address(port), now);
            }
        }
    }
    let both = [address(1), address(2)].into();
    assert_eq!(inspector.vehicles()[&VehicleId(7)].addresses, both);
}
