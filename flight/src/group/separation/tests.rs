use approx::assert_relative_eq;
use nalgebra::Point3;
use volery_geometry::Rng;

use super::*;
use crate::motion::{Goal, LegKind, MotionLimits, PathStyle, Waypoint, legs};

fn place(x: f64, y: f64, z: f64) -> Waypoint {
    Waypoint { position: Point3::new(x, y, z), yaw: 0.0 }
}

fn random_way(rng: &mut Rng) -> Trajectory {
    let limits = MotionLimits::default();
    let mut way =
        Trajectory::standing(Waypoint { position: Point3::from(rng.normal3() * 3.0), yaw: 0.0 });
    for _ in 0..2 {
        way.stay(LegKind::Wait, Duration::from_secs_f64(rng.uniform() * 3.0));
        let goal = Goal { position: Point3::from(rng.normal3() * 3.0), yaw: None };
        let style =
            if rng.chance(0.5) { PathStyle::Straight } else { PathStyle::HorizontalVertical };
        way.append(&Trajectory::along(way.end(), &legs(way.end(), &goal, style), &limits));
    }
    way
}

/// No sample is nearer than the closest approach, and at its time the distance is the reported one.
#[test]
fn the_closest_approach_is_below_all_samples_and_is_reached() {
    let separation = Separation::default();
    let mut rng = Rng::new(6);
    for _ in 0..100 {
        let (a, b) = (random_way(&mut rng), random_way(&mut rng));
        let nearest = closest_approach(&a, &b, &separation);
        let at = |t: Duration| separation.measure(&(b.sample(t).position - a.sample(t).position));
        assert_relative_eq!(at(nearest.at), nearest.distance, epsilon = 1e-6);
        let end = a.seconds().max(b.seconds()) + 1.0;
        let sampled = (0..2_000)
            .map(|k| at(Duration::from_secs_f64(end * f64::from(k) / 2_000.0)))
            .fold(f64::INFINITY, f64::min);
        assert!(nearest.distance <= sampled + 1e-9, "{} > {sampled}", nearest.distance);
        // 20 ms apart at a relative speed below 2.3 m/s, the samples cannot be far above.
        assert!(sampled - nearest.distance < 0.03);
        let swapped = closest_approach(&b, &a, &separation);
        assert_relative_eq!(swapped.distance, nearest.distance, epsilon = 1e-9);
    }
}

/// Two that cross at full speed between two samples of 20 Hz are seen to touch.
#[test]
fn crossing_ways_touch_at_the_crossing() {
    let limits = MotionLimits::default();
    let way = |from: Waypoint, to: Waypoint| {
        let mut way = Trajectory::standing(from);
        way.fly(LegKind::Straight, to, &limits);
        way
    };
    let a = way(place(-4.0, 0.0, 1.0), place(4.0, 0.0, 1.0));
    let b = way(place(0.0, -4.0, 1.0), place(0.0, 4.0, 1.0));
    let nearest = closest_approach(&a, &b, &Separation::default());
    assert!(nearest.distance < 1e-6, "{}", nearest.distance);
    assert_relative_eq!(nearest.at.as_secs_f64(), 5.0, epsilon = 1e-6);
}

/// Heights count by their weight, so a vehicle straight below is nearer than one beside.
#[test]
fn heights_count_by_their_weight() {
    let separation = Separation { distance: 1.0, vertical_weight: 0.5 };
    let a = Trajectory::standing(place(0.0, 0.0, 1.0));
    let below = Trajectory::standing(place(0.0, 0.0, -0.5));
    let beside = Trajectory::standing(place(1.5, 0.0, 1.0));
    assert_relative_eq!(closest_approach(&a, &below, &separation).distance, 0.75);
    assert_relative_eq!(closest_approach(&a, &beside, &separation).distance, 1.5);
}

/// Those who have arrived are still in the way of those who have not.
#[test]
fn the_arrived_stay_in_the_way() {
    let limits = MotionLimits::default();
    let standing = Trajectory::standing(place(5.0, 0.3, 1.0));
    let mut passing = Trajectory::standing(place(0.0, 0.0, 1.0));
    passing.stay(LegKind::Wait, Duration::from_secs(30));
    passing.fly(LegKind::Straight, place(10.0, 0.0, 1.0), &limits);
    let nearest = closest_approach(&standing, &passing, &Separation::default());
    assert_relative_eq!(nearest.distance, 0.3, epsilon = 1e-6);
    assert!(nearest.at > Duration::from_secs(30));
}

/// A piece whose distance has two minima inside: both are looked at.
#[test]
fn a_quartic_has_two_valleys() {
    // ‖q‖² = (t² - 4 t + 3)² + (0.028 - 0.01 t)²: valleys near 1 and 3.
    let q = [Vector3::new(3.0, 0.028, 0.0), Vector3::new(-4.0, -0.01, 0.0), Vector3::x()];
    let (squared, at) = smallest_squared(&q, 5.0);
    let brute = (0..=500_000)
        .map(|k| f64::from(k) * 1e-5)
        .map(|t| (q[0] + (q[1] + q[2] * t) * t).norm_squared())
        .fold(f64::INFINITY, f64::min);
    assert!((squared - brute).abs() < 1e-9, "{squared} against {brute}");
    assert!(at > 2.0, "the valley beyond the hill is the deeper one");
}
