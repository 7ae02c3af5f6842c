//! The ground station's fleet flies simulated drones: two readings of MAVLink against each other.

mod tower;

use nalgebra::Vector3;
use tower::*;
use volery_flight::Command;
use volery_simulator::*;

/// Targets of drone `index`.
fn targets(index: usize) -> [Vector3<f64>; 5] {
    let y = 1.5 * index as f64;
    [[3.0, y, 1.5], [3.0, y + 0.5, 1.0], [-1.0, y + 0.5, 2.0], [-1.0, y, 1.2], [0.0, y, 1.2]]
        .map(Vector3::from)
}

/// Found, fed, armed, flown through five targets each and landed: three drones of both families,
/// with and without key. At each target the true place is within `limit`.
fn fly(signing: Option<Signing>, faults: &LinkFaults, delay_ms: f64, limit: f64) {
    let delay = [("VISO_DELAY_MS", 0), ("EKF2_EV_DELAY", 1)];
    let drones = (0..3).map(|index| {
        let mut options = drone(index, 1, signing);
        let (name, _) = delay[usize::from(index % 2)];
        options.parameters.push((name.to_owned(), delay_ms));
        options
    });
    let mut tower = Tower::new(drones.collect(), faults, &PoseOptions::default());
    tower.take_off(1.2);
    for leg in 0..5 {
        tower.all(40.0, |index| go(targets(index)[leg], 0.5 * leg as f64));
        tower.run(3.0);
        for (index, drone) in tower.world.drones.iter().enumerate() {
            let off = (drone.body().position.coords - targets(index)[leg]).norm();
            assert!(off < limit, "drone {index} leg {leg}: {off:.3} m");
            let turned = drone.body().yaw - 0.5 * leg as f64;
            assert!(turned.abs() < 0.1, "drone {index} leg {leg}: {turned:.3} rad");
        }
    }
    tower.all(40.0, |_| Command::Land);
    assert_eq!(tower.world.num_contacts(), 0, "{:?}", tower.events);
    assert!(tower.world.closest().unwrap().distance > 1.0);
    assert!(tower.eyes.iter().all(|eyes| eyes.num_false == 0 && eyes.num_sent > 500));
}

#[test]
fn a_fleet_flies_drones_without_key() {
    fly(None, &LinkFaults::default(), 50.0, 0.15);
}

#[test]
fn a_fleet_flies_drones_with_keys() {
    fly(Some(KEY), &LinkFaults::default(), 50.0, 0.15);
}

/// 20 % loss and 150 ms each way.
#[test]
fn a_fleet_flies_over_a_bad_link() {
    let faults = LinkFaults { loss: 0.2, delay: 150 * MS, duplication: 0.02, cuts: vec![] };
    fly(None, &faults, 200.0, 0.30);
    fly(Some(KEY), &LinkFaults { duplication: 0.0, ..faults }, 200.0, 0.30);
}
