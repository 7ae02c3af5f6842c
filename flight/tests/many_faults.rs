//! What the fleet does when something fails in flight, over many seeds.
//!
//! Each run is another drone with other noise that fails at another moment of a leg.

mod tower;

use std::time::Duration;

use nalgebra::Vector3;
use tower::*;
use volery_flight::watchdog::Reason;
use volery_flight::{Alert, CommandState, Happening, VehicleId};
use volery_geometry::Rng;
use volery_simulator::*;

/// Runs per fault.
const SEEDS: std::ops::Range<u64> = 0..50;

/// A drone on its way along x at a random moment.
fn in_flight(seed: u64) -> (Tower, Rng) {
    in_flight_over(&LinkFaults::default(), seed)
}

/// The same over a link that is not sound.
fn in_flight_over(link: &LinkFaults, seed: u64) -> (Tower, Rng) {
    let mut rng = Rng::fork(seed, 0xfa);
    let options = drone((seed % 2) as u8, seed, seed.is_multiple_of(3).then_some(KEY));
    let mut tower = Tower::new(vec![options], link, &PoseOptions::default());
    tower.take_off(1.2);
    let id = VehicleId(tower.drone().options().system_id);
    let target = Vector3::new(6.0, tower.drone().body().position.y, 1.5);
    tower.fleet.command(id, &go(target, 0.0), tower.now).unwrap();
    tower.run(rng.range(1.0, 4.5));
    (tower, rng)
}

fn first(tower: &Tower, mut is: impl FnMut(&Alert) -> bool) -> Option<Duration> {
    tower.happened.iter().find_map(|(time, _, happening)| match happening {
        Happening::Alert(alert) if is(alert) => Some(*time),
        _ => None,
    })
}

/// Seconds from `then` to the first hold and the first landing for a reason.
fn reaction(tower: &Tower, then: Duration, reason: Reason) -> [Option<f64>; 2] {
    let since = |time: Duration| time.as_secs_f64() - then.as_secs_f64();
    [
        first(tower, |alert| *alert == Alert::Holds(reason)).map(since),
        first(tower, |alert| *alert == Alert::Lands(reason)).map(since),
    ]
}

fn lands_softly(tower: &mut Tower) {
    assert!(tower.run_until(30.0, |t| !t.drone().is_armed()), "{:?}", tower.events);
    assert!(!tower.drone().has_crashed() && tower.world.num_contacts() == 0, "{:?}", tower.events);
}

/// What takes away all usable poses: a hold within 0.6 s of the last good frame, then a landing
/// within 2 s, no false pose passed on.
fn poses_fail(make: impl Fn(&mut Rng) -> PoseFault) {
    for seed in SEEDS {
        let (mut tower, mut rng) = in_flight(seed);
        let (then, fault) = (tower.now, make(&mut rng));
        tower.eyes[0].source.fail(then..Duration::MAX, fault);
        tower.run(2.5);
        let [hold, land] = reaction(&tower, then, Reason::PoseStale);
        // The last good frame may be one interval older than the fault.
        assert!(hold.is_some_and(|t| t < 0.6), "seed {seed} {fault:?}: {hold:?}");
        assert!(land.is_some_and(|t| t < 2.0), "seed {seed} {fault:?}: {land:?}");
        assert_eq!(tower.eyes[0].num_false, 0, "seed {seed} {fault:?}");
        lands_softly(&mut tower);
    }
}

#[test]
fn poses_stop() {
    poses_fail(|_| PoseFault::Stop);
}

#[test]
fn the_place_is_mistaken_for_another() {
    poses_fail(|rng| {
        let distance = 0.2 * 100f64.powf(rng.uniform());
        let around = rng.range(0.0, std::f64::consts::TAU);
        PoseFault::Jump(Vector3::new(around.cos(), around.sin(), 0.0) * distance)
    });
}

/// Over a link that loses a fifth and takes 150 ms, what a drone says of itself is old, and it gets its
/// poses late. Places 0.35 m off are told from that; who gets no poses any more lands.
#[test]
fn over_a_bad_link_the_place_is_mistaken_for_another() {
    let link = LinkFaults { loss: 0.2, delay: 150 * MS, ..LinkFaults::default() };
    for seed in SEEDS {
        let (mut tower, mut rng) = in_flight_over(&link, seed);
        let distance = 0.35 * (20.0_f64 / 0.35).powf(rng.uniform());
        let around = rng.range(0.0, std::f64::consts::TAU);
        let step = Vector3::new(around.cos(), around.sin(), 0.0) * distance;
        tower.eyes[0].source.fail(tower.now..Duration::MAX, PoseFault::Jump(step));
        tower.run(4.0);
        assert_eq!(tower.eyes[0].num_false, 0, "seed {seed}: {distance} m");
        assert!(tower.run_until(30.0, |t| !t.drone().is_armed()), "seed {seed}: {distance} m");
        assert_eq!(tower.eyes[0].num_false, 0, "seed {seed}: {distance} m");
    }
}

/// Poses creep away as slowly as a filter cannot tell, then their source finds back, and says so:
/// the drone is told, holds meanwhile, moves by no more than they were wrong, and can be flown on.
#[test]
fn a_source_that_strayed_finds_back() {
    for seed in SEEDS {
        let (mut tower, mut rng) = in_flight(seed);
        let around = rng.range(0.0, std::f64::consts::TAU);
        let creep = Vector3::new(around.cos(), around.sin(), 0.0) * 0.05;
        let seconds = rng.range(4.0, 10.0);
        let end = tower.now + Duration::from_secs_f64(seconds);
        tower.eyes[0].source.fail(tower.now..end, PoseFault::Drift(creep));
        tower.run(seconds);
        let (before, sent) = (tower.drone().body().position, tower.eyes[0].num_sent);
        let speed = tower.drone().body().velocity.norm();
        tower.eyes[0].gives_up = end;
        tower.run(2.0);
        let wrong = tower.eyes[0].num_false;
        assert!(tower.eyes[0].num_sent > sent + 20, "seed {seed}: {:?}", tower.eyes[0].refusals);
        assert!(first(&tower, |alert| *alert == Alert::Holds(Reason::Relocating)).is_some());
        tower.run(3.0);
        assert_eq!(tower.eyes[0].num_false, wrong, "seed {seed}");
        let held = tower.drone().body().position;
        // While it was still under way it came to rest, too.
        let rest = speed * speed / 2.0;
        let moved = (held - before).norm();
        assert!(moved < 0.05 * seconds + rest + 0.1, "seed {seed}: {moved} m from {before}");
        let id = VehicleId(tower.drone().options().system_id);
        let goal = Vector3::new(4.0, held.y, 1.5);
        let command = tower.fleet.command(id, &go(goal, 0.0), tower.now).unwrap();
        let arrived =
            tower.run_until(30.0, |tower| tower.state_of(command) == Some(&CommandState::Done));
        assert!(arrived, "seed {seed}: {:?}", tower.state_of(command));
        let place = tower.drone().body().position;
        assert!((place.coords - goal).norm() < 0.2, "seed {seed}: {place}");
    }
}

#[test]
fn the_yaw_flips() {
    poses_fail(|_| PoseFault::Turn(std::f64::consts::PI));
}

/// Single false poses, one in twenty, off by 0.2 m to 20 m: the drone flies on, and at most one
/// pose of a thousand that it gets is false.
#[test]
fn single_false_poses_do_not_pass() {
    let (mut sent, mut wrong) = (0, 0);
    for seed in SEEDS {
        let (mut tower, mut rng) = in_flight(seed);
        for frame in 0..200 {
            if !rng.chance(0.05) {
                continue;
            }
            let distance = 0.2 * 100f64.powf(rng.uniform());
            let step = rng.normal3().normalize() * distance;
            let from = tower.now + 50 * MS * frame;
            tower.eyes[0].source.fail(from..from + 50 * MS, PoseFault::Jump(step));
        }
        tower.run(10.0);
        sent += tower.eyes[0].num_sent;
        wrong += tower.eyes[0].num_false;
        assert!(tower.drone().is_flying() && tower.drone().failsafe().is_none(), "seed {seed}");
        let place = tower.drone().body().position;
        assert!((place.x - 6.0).abs() < 0.2, "seed {seed}: {place}");
    }
    println!("{wrong} of {sent} poses were false");
    assert!(f64::from(wrong) <= 0.001 * f64::from(sent), "{wrong} of {sent}");
}

#[test]
fn the_camera_freezes() {
    poses_fail(|_| PoseFault::Freeze);
}

/// Both ways of the link are cut: the fleet sees it, the drone lands by itself.
#[test]
fn the_link_is_lost() {
    for seed in SEEDS {
        let (mut tower, _) = in_flight(seed);
        let then = tower.now;
        tower.up[0].cut(then..Duration::MAX);
        tower.down[0].cut(then..Duration::MAX);
        tower.run(6.0);
        // Poses cannot be sent any more either: which of the two lands it does not matter.
        let [hold, land] = reaction(&tower, then, Reason::LinkLost);
        let land = land.or(reaction(&tower, then, Reason::PoseStale)[1]);
        assert!(hold.is_some_and(|t| t < 1.3), "seed {seed}: {hold:?}");
        assert!(land.is_some_and(|t| t < 5.3), "seed {seed}: {:?}", tower.happened);
        assert_eq!(tower.drone().mode(), Mode::Land, "seed {seed}");
        lands_softly(&mut tower);
    }
}

/// The ground station is killed: every drone comes down by itself, near where it was, by the failsafe
/// of its family: ArduPilot when the station has been silent for 2 s, PX4 after 1 s without setpoints.
#[test]
fn the_ground_station_dies() {
    let (mut furthest, mut slowest): (f64, f64) = (0.0, 0.0);
    for seed in SEEDS {
        let (mut tower, _) = in_flight(seed);
        let (then, before) = (tower.now, tower.drone().body().position);
        tower.is_dead = true;
        assert!(tower.run_until(10.0, |tower| tower.drone().mode() == Mode::Land), "seed {seed}");
        let time = (tower.now - then).as_secs_f64();
        let limit = match tower.drone().options().flavor {
            Flavor::ArduPilot => 2.3,
            Flavor::Px4 => 1.5,
        };
        assert!(time < limit, "seed {seed}: {time} s");
        slowest = slowest.max(time);
        lands_softly(&mut tower);
        let place = tower.drone().body().position;
        furthest = furthest.max((place - before).xy().norm());
    }
    println!("landing after {slowest:.2} s at the latest, down within {furthest:.2} m");
}

#[test]
fn the_client_goes_away() {
    for seed in SEEDS {
        let (mut tower, _) = in_flight(seed);
        let then = tower.now;
        let id = VehicleId(tower.drone().options().system_id);
        tower.fleet.lease(id, Some(then));
        tower.run(3.0);
        let [hold, _] = reaction(&tower, then, Reason::LeaseOver);
        assert!(hold.is_some_and(|t| t < 0.1), "seed {seed}: {hold:?}");
        assert!(tower.drone().body().velocity.norm() < 0.15 && tower.drone().is_flying());
        tower.run(28.0);
        let [_, land] = reaction(&tower, then, Reason::LeaseOver);
        assert!(land.is_some_and(|t| (29.9..30.2).contains(&t)), "seed {seed}: {land:?}");
        lands_softly(&mut tower);
    }
}

#[test]
fn the_battery_is_low() {
    for seed in SEEDS {
        let (mut tower, _) = in_flight(seed);
        let then = tower.now;
        tower.world.drones[0].set_battery(18.0);
        tower.run(3.0);
        let [_, land] = reaction(&tower, then, Reason::BatteryLow);
        // Its battery is told every two seconds at most.
        assert!(land.is_some_and(|t| t < 2.3), "seed {seed}: {land:?}");
        lands_softly(&mut tower);
    }
}
