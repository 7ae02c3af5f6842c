//! What strangers on the socket achieve: nothing.

mod rig;

use rig::{Conditions, Rig, epoch};
use volery_flight::{Command, VehicleId};
use volery_geometry::Rng;
use volery_simulator::{Flavor, Link, Signing};

const KEY: [u8; 32] = [7; 32];

fn heartbeat() -> mavlink::dialects::ardupilotmega::MavMessage {
    use mavlink::dialects::ardupilotmega::{HEARTBEAT_DATA, MavAutopilot, MavMessage, MavType};
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        mavtype: MavType::MAV_TYPE_QUADROTOR,
        autopilot: MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
        ..Default::default()
    })
}

/// Wrong keys, no keys, replays, clones, cut and changed frames, version 1 and noise, from the
/// vehicle's own address and from others: none is accepted, and the flight goes on.
#[test]
fn nothing_hostile_is_accepted() {
    let conditions = Conditions { key: Some(KEY), ..Conditions::default() };
    let mut rig = Rig::new(1, &conditions);
    rig.take_off();
    let mut rng = Rng::new(11);
    let mut wrong = Link::new(1, 1, Some(Signing { key: [8; 32], epoch: epoch() }));
    let mut unsigned = Link::new(1, 1, None);
    let mut clone = Link::new(9, 1, Some(Signing { key: [9; 32], epoch: epoch() }));
    // A recording of a signed heartbeat that the fleet has heard.
    let mut twin = Link::new(2, 1, Some(Signing { key: KEY, epoch: epoch() }));
    let recorded = twin.encode(&heartbeat(), rig.now);
    let own = Rig::address(0);
    rig.fleet.receive(&recorded, Rig::address(7), rig.now);
    assert_eq!(rig.fleet.vehicles().count(), 2, "its key is right");
    let (accepted, _) = rig.fleet.counts();
    let before = rig.fleet.vehicle(VehicleId(1)).cloned().map(|v| v.telemetry);
    let mut sent = 0;
    for round in 0..2500_u64 {
        let genuine = unsigned.encode(&heartbeat(), rig.now);
        let mut changed = wrong.encode(&heartbeat(), rig.now);
        let at = rng.index(changed.len());
        changed[at] ^= 1 << rng.index(8);
        let noise: Vec<u8> = (0..rng.index(300)).map(|_| rng.bits() as u8).collect();
        let mut version_1 = genuine.clone();
        version_1[0] = 0xFE;
        let cut = recorded[..rng.index(recorded.len())].to_vec();
        let packets = [
            wrong.encode(&heartbeat(), rig.now),
            clone.encode(&heartbeat(), rig.now),
            recorded.clone(),
            genuine,
            changed,
            noise,
            version_1,
            cut,
        ];
        for packet in packets {
            let from = if round % 2 == 0 { own } else { Rig::address(7) };
            rig.fleet.receive(&packet, from, rig.now);
            sent += 1;
        }
    }
    let (now_accepted, refused) = rig.fleet.counts();
    assert_eq!(now_accepted, accepted, "of {sent}: {refused:?}");
    assert_eq!(rig.fleet.vehicles().count(), 2);
    assert_eq!(rig.fleet.vehicle(VehicleId(1)).cloned().map(|v| v.telemetry), before);
    let command = rig.command(1, Command::Land);
    rig.finish(&[command], 60.0);
}

/// A vehicle answers from another address only after its own has been silent.
#[test]
fn an_address_is_not_taken_over() {
    let mut rig = Rig::new(1, &Conditions { flavor: Flavor::Px4, ..Conditions::default() });
    assert!(rig.run_until(30.0, Rig::is_ready));
    let mut thief = Link::new(1, 1, None);
    for _ in 0..200 {
        let packet = thief.encode(&heartbeat(), rig.now);
        rig.fleet.receive(&packet, Rig::address(5), rig.now);
        rig.step();
    }
    assert_eq!(rig.fleet.vehicle(VehicleId(1)).unwrap().address, Rig::address(0));
    let up = Command::TakeOff { height: 1.0 };
    assert!(rig.fleet.command(VehicleId(1), &up, rig.now).is_err(), "two claim to be it");
}

/// Poses and commands of a vehicle reach that vehicle and no other.
#[test]
fn datagrams_carry_the_number_of_their_address() {
    let mut rig = Rig::new(3, &Conditions::default());
    rig.take_off();
    for _ in 0..500 {
        rig.step();
        for datagram in rig.fleet.poll(rig.now) {
            let id = (datagram.to.port() - 20_000) as u8 + 1;
            let mut rest = &datagram.bytes[..];
            while !rest.is_empty() {
                let (frame, following) = volery_flight::wire::read_frame(rest);
                rest = following;
                use mavlink::Message;
                let message = frame.unwrap().message.unwrap();
                if let Some(target) = message.target_system_id() {
                    assert_eq!(target, id, "{message:?}");
                }
            }
        }
    }
}
