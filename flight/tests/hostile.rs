//! Strangers on the socket of the fleet.

mod tower;

use std::net::SocketAddr;

use mavlink::dialects::ardupilotmega::{
    HEARTBEAT_DATA, LOCAL_POSITION_NED_DATA, MavAutopilot, MavMessage, MavType,
};
use tower::*;
use volery_geometry::Rng;
use volery_simulator::*;

/// Hostile datagrams in all.
const NUM: u64 = 100_000;
/// Seconds of flight in which they come.
const SECONDS: u64 = 20;

/// Wrong key, replay, a cloned number, MAVLink 1, bad checksums and garbage among the datagrams of
/// two honest drones in flight: none is accepted, and the drones lose nothing.
#[test]
fn strangers_are_not_heard() {
    let drones = (0..2).map(|index| drone(index, 1, Some(KEY))).collect();
    let mut tower = Tower::new(drones, &LinkFaults::default(), &PoseOptions::default());
    tower.take_off(1.2);
    let mut rng = Rng::new(9);
    let mut thief = Link::new(1, 1, Some(Signing { key: [6; 32], ..KEY }));
    let mut copy = Link::new(1, 1, None);
    let overheard = tower.overheard.clone();
    let (accepted, refused) = tower.fleet.counts();
    let delivered = tower.num_delivered;
    let elsewhere: SocketAddr = ([127, 0, 0, 1], 9).into();
    let steps = SECONDS * 100;
    for _ in 0..steps {
        for _ in 0..NUM / steps {
            let at = if rng.chance(0.5) { address(1) } else { elsewhere };
            let message = lie(&mut rng);
            let datagram = match rng.index(6) {
                0 => thief.encode(&message, tower.now),
                1 => overheard[rng.index(overheard.len())].clone(),
                2 => copy.encode(&message, tower.now),
                3 => version_1(&mut rng),
                4 => {
                    let mut frame = overheard[rng.index(overheard.len())].clone();
                    let place = rng.index(frame.len() - 13);
                    frame[place] ^= 1 << rng.index(8);
                    frame
                }
                _ => (0..1 + rng.index(280)).map(|_| rng.bits() as u8).collect(),
            };
            tower.fleet.receive(&datagram, at, tower.now);
        }
        tower.step();
    }
    let (now_accepted, now_refused) = tower.fleet.counts();
    let honest = tower.num_delivered - delivered;
    println!("{honest} honest, {} refused: {now_refused:?}", now_refused.total() - refused.total());
    assert_eq!(now_accepted - accepted, honest, "honest frames are taken, no others");
    assert!(now_refused.total() - refused.total() >= NUM);
    assert_eq!(tower.fleet.vehicles().count(), 2, "nobody was let in");
    for drone in &tower.world.drones {
        let place = drone.body().position;
        assert!(drone.is_flying() && (place.z - 1.2).abs() < 0.15, "{place}");
        assert_eq!(drone.failsafe(), None);
    }
}

/// What an attacker would like the fleet to believe.
fn lie(rng: &mut Rng) -> MavMessage {
    if rng.chance(0.5) {
        MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA {
            x: 100.0 * rng.normal() as f32,
            ..LOCAL_POSITION_NED_DATA::DEFAULT
        })
    } else {
        MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            mavtype: MavType::MAV_TYPE_QUADROTOR,
            autopilot: MavAutopilot::MAV_AUTOPILOT_PX4,
            ..HEARTBEAT_DATA::DEFAULT
        })
    }
}

/// A good frame of MAVLink 1: it cannot be signed.
fn version_1(rng: &mut Rng) -> Vec<u8> {
    let mut raw = mavlink::MAVLinkV1MessageRaw::new();
    let header = mavlink::MavHeader { system_id: 1, component_id: 1, sequence: rng.bits() as u8 };
    raw.serialize_message(header, &lie(rng));
    raw.raw_bytes().to_vec()
}
