//! Whole flights of simulated drones, in simulated time.

mod rig;

use std::time::Duration;

use nalgebra::Point3;
use rig::{Conditions, Rig};
use volery_flight::{Command, PoseRefusal};
use volery_simulator::{Flavor, LinkFaults};

const KEY: [u8; 32] = [7; 32];

/// Three drones to five places each and down again; the worst true error at a place, and how many
/// true poses were taken for jumps on the way.
fn fly_five_places(conditions: &Conditions) -> (f64, usize) {
    let mut rig = Rig::new(3, conditions);
    rig.take_off();
    let before = rig.refusals.len();
    let places =
        [[1.0, 0.0, 1.5], [2.0, 0.5, 1.2], [2.0, -0.5, 1.8], [0.5, 0.2, 1.0], [0.0, 0.0, 1.4]];
    let mut worst = 0.0_f64;
    for (turn, [x, y, z]) in places.into_iter().enumerate() {
        let goals: Vec<_> =
            (0..3).map(|index| Point3::new(x, y + 1.5 * f64::from(index), z)).collect();
        let yaw = 0.4 * turn as f64 - 0.8;
        let commands: Vec<_> =
            goals.iter().zip(1..).map(|(goal, id)| rig.go(id, *goal, yaw)).collect();
        rig.finish(&commands, 40.0);
        rig.run(2.0);
        for (goal, id) in goals.iter().zip(1..) {
            worst = worst.max(rig.error(id, goal));
        }
    }
    let is_jump = |(_, _, refusal): &&_| matches!(refusal, PoseRefusal::Jump(_));
    let jumps = rig.refusals[before..].iter().filter(is_jump).count();
    let commands: Vec<_> = (1..=3).map(|id| rig.command(id, Command::Land)).collect();
    rig.finish(&commands, 60.0);
    assert_eq!(rig.world.num_contacts(), 0);
    assert!(rig.world.drones.iter().all(|drone| !drone.is_armed() && !drone.is_flying()));
    (worst, jumps)
}

/// 15 cm true error with 2 cm noise, for both autopilots, signed and not.
#[test]
fn three_drones_fly_to_five_places() {
    for flavor in [Flavor::ArduPilot, Flavor::Px4] {
        for key in [None, Some(KEY)] {
            let conditions = Conditions { flavor, key, ..Conditions::default() };
            let (worst, jumps) = fly_five_places(&conditions);
            println!("{flavor:?}, signed: {}: worst {worst:.3} m", key.is_some());
            assert!(worst < 0.15, "{flavor:?} {worst}");
            assert_eq!(jumps, 0, "{flavor:?}");
        }
    }
}

/// A fifth of all datagrams lost, 150 ms each way: of some thousand true poses next to none is taken
/// for a jump.
#[test]
fn a_bad_link_costs_little() {
    let faults =
        LinkFaults { loss: 0.2, delay: Duration::from_millis(150), ..LinkFaults::default() };
    let mut all_jumps = 0;
    for flavor in [Flavor::ArduPilot, Flavor::Px4] {
        for key in [None, Some(KEY)] {
            for seed in 1..=5 {
                let faults = faults.clone();
                let conditions = Conditions { flavor, key, faults, seed, ..Conditions::default() };
                let (worst, jumps) = fly_five_places(&conditions);
                println!("{flavor:?} {seed}, bad link: worst {worst:.3} m, {jumps} refused");
                assert!(worst < 0.30, "{flavor:?} {seed} {worst}");
                all_jumps += jumps;
            }
        }
    }
    // Of about 30 000.
    assert!(all_jumps <= 10, "{all_jumps}");
}
