use approx::assert_relative_eq;
use volery_geometry::Rng;

use super::*;
use crate::motion::{Goal, PathStyle, legs};

fn random_flight(rng: &mut Rng) -> Trajectory {
    let limits = MotionLimits::default();
    let start = Waypoint { position: Point3::from(rng.normal3() * 4.0), yaw: rng.normal() };
    let mut flight = Trajectory::standing(start);
    for _ in 0..3 {
        let yaw = rng.chance(0.5).then(|| rng.normal() * 3.0);
        let goal = Goal { position: Point3::from(rng.normal3() * 4.0), yaw };
        let style =
            if rng.chance(0.5) { PathStyle::Straight } else { PathStyle::HorizontalVertical };
        flight.append(&Trajectory::along(flight.end(), &legs(flight.end(), &goal, style), &limits));
        flight.stay(LegKind::Wait, Duration::from_secs_f64(rng.uniform()));
    }
    flight
}

/// Nothing jumps: position, velocity and yaw are continuous, velocity is the derivative of
/// position, and no limit is passed at any time.
#[test]
fn the_motion_is_smooth_and_within_its_limits() {
    let limits = MotionLimits::default();
    let mut rng = Rng::new(3);
    for _ in 0..30 {
        let flight = random_flight(&mut rng);
        let step = 1e-3;
        let count = (flight.duration().as_secs_f64() / step) as usize + 2;
        let at = |k: usize| flight.sample(Duration::from_secs_f64(k as f64 * step));
        for k in (0..count).step_by(7) {
            let (before, now) = (at(k), at(k + 1));
            let mean = 0.5 * (before.velocity + now.velocity);
            let moved = now.position - before.position;
            assert_relative_eq!(moved / step, mean, epsilon = 1e-3);
            let turned = wrapped(now.yaw - before.yaw);
            assert!(turned.abs() <= limits.yaw_rate * step + 1e-9);
            assert!(now.velocity.xy().norm() <= limits.speed + 1e-9);
            assert!(now.velocity.z.abs() <= limits.climb_speed + 1e-9);
            let change = now.velocity - before.velocity;
            assert!(change.norm() <= limits.acceleration * step + 1e-9, "{change}");
        }
    }
}

/// A leg long enough for full speed takes L/v + v/a, a short one 2 √(L/a).
#[test]
fn the_time_of_a_leg_is_the_textbook_one() {
    let limits = MotionLimits::default();
    let time = |length: f64| {
        let mut way = Trajectory::standing(Waypoint { position: Point3::origin(), yaw: 0.0 });
        let to = Waypoint { position: Point3::new(length, 0.0, 0.0), yaw: 0.0 };
        way.fly(LegKind::Straight, to, &limits);
        way.duration().as_secs_f64()
    };
    assert_relative_eq!(time(10.0), 10.0 / 1.0 + 1.0 / 0.5, epsilon = 1e-9);
    assert_relative_eq!(time(0.5), 2.0 * (0.5f64 / 0.5).sqrt(), epsilon = 1e-9);
}

#[test]
fn before_and_after_the_flight_the_vehicle_rests() {
    let flight = random_flight(&mut Rng::new(4));
    assert_eq!(flight.sample(Duration::ZERO).position, flight.start().position);
    let late = flight.sample(flight.duration() + Duration::from_secs(60));
    assert_eq!(late.velocity, Vector3::zeros());
    assert_eq!(late.position, flight.end().position);
    assert_eq!(flight.leg_at(flight.duration()), None);
}

/// The legs of a trajectory are those it was made of, without gaps.
#[test]
fn legs_tile_the_flight() {
    let limits = MotionLimits::default();
    let start = Waypoint { position: Point3::new(0.0, 0.0, 1.0), yaw: 2.0 };
    let goal = Goal { position: Point3::new(3.0, 1.0, 2.0), yaw: Some(1.0) };
    let flight =
        Trajectory::along(start, &legs(start, &goal, PathStyle::HorizontalVertical), &limits);
    let tiles: Vec<_> = flight.legs().collect();
    let kinds: Vec<_> = tiles.iter().map(|(kind, ..)| *kind).collect();
    use LegKind::{Horizontal, Turn, Vertical};
    assert_eq!(kinds, [Turn, Horizontal, Turn, Vertical]);
    assert_eq!(tiles[0].1, 0.0);
    for pair in tiles.windows(2) {
        assert_relative_eq!(pair[0].2, pair[1].1, epsilon = 1e-9);
        let middle = Duration::from_secs_f64(0.5 * (pair[1].1 + pair[1].2));
        assert_eq!(flight.leg_at(middle).unwrap().1, pair[1].0);
    }
    assert_relative_eq!(tiles[3].2, flight.duration().as_secs_f64(), epsilon = 1e-9);
}

/// The yaw goes the short way round, also over the seam.
#[test]
fn turns_go_the_short_way() {
    let mut way = Trajectory::standing(Waypoint { position: Point3::origin(), yaw: 3.0 });
    let to = Waypoint { position: Point3::origin(), yaw: -3.0 };
    way.fly(LegKind::Turn, to, &MotionLimits::default());
    let turned: f64 = way.end().yaw - 3.0;
    assert_relative_eq!(turned, std::f64::consts::TAU - 6.0, epsilon = 1e-9);
}
