use std::f64::consts::PI;

use approx::assert_relative_eq;
use nalgebra::Vector3;
use volery_geometry::Rng;
use volery_geometry::frames::unity_from_map;

use super::*;
use crate::motion::{MotionLimits, Trajectory};

/// Map coordinates of a place given in Unity's left-handed ones: the inverse of `unity_from_map`,
/// a permutation with one sign, is its transpose.
fn map_from_unity(x: f64, y: f64, z: f64, yaw_deg: f64) -> Waypoint {
    let columns = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| unity_from_map(&axis));
    let unity = Vector3::new(x, y, z);
    // Unity turns clockwise about its vertical axis, from its forward axis z, which is our x.
    let yaw = -yaw_deg.to_radians();
    Waypoint { position: Point3::from(Vector3::from_fn(|i, _| columns[i].dot(&unity))), yaw }
}

/// The paper's flight (P80-P84): turn by 93.12 deg, 3.734 m level, 1.150 m down.
#[test]
fn the_flight_of_the_paper() {
    let start = map_from_unity(-0.66, 1.149, 6.425, -90.8);
    let above = map_from_unity(-0.405, 1.026, 2.7, -187.0);
    let below = map_from_unity(-0.405, -0.124, 2.7, -187.0);
    assert_relative_eq!(start.position, Point3::new(6.425, 0.66, 1.149), epsilon = 1e-12);

    // acos has no sign; the paper went from -90.8 to -187 deg, clockwise backwards: to the left.
    let theta = turn_towards(&start, &above.position).unwrap();
    assert!((theta.to_degrees() - 93.12).abs() < 0.005, "{}", theta.to_degrees());

    // The paper's level leg also sinks by 0.123 m; ours is level and sinks at its end.
    let goal = Goal { position: above.position, yaw: Some(above.yaw) };
    let first = legs(start, &goal, PathStyle::HorizontalVertical);
    let kinds: Vec<LegKind> = first.iter().map(|leg| leg.kind).collect();
    use LegKind::{Horizontal, Turn, Vertical};
    assert_eq!(kinds, [Turn, Horizontal, Turn, Vertical]);
    let level = first[1].to.position - start.position;
    assert_eq!(level.z, 0.0);
    assert!((level.norm() - 3.734).abs() < 5e-4, "{}", level.norm());
    assert!((first[3].to.position.z - start.position.z + 0.123).abs() < 1e-9);
    // From the bearing of the leg, 183.92 deg, to the commanded 187 deg.
    assert!(((first[2].to.yaw - first[1].to.yaw).to_degrees() - 3.08).abs() < 0.01);

    let goal = Goal { position: below.position, yaw: Some(below.yaw) };
    let second = legs(first[3].to, &goal, PathStyle::HorizontalVertical);
    assert_eq!(second.len(), 1, "{second:?}");
    assert_eq!(second[0].kind, Vertical);
    let down = second[0].to.position - first[3].to.position;
    assert_relative_eq!(down, Vector3::new(0.0, 0.0, -1.150), epsilon = 1e-9);
    assert_relative_eq!(wrapped(second[0].to.yaw - below.yaw), 0.0, epsilon = 1e-9);
}

/// P82: the magnitude is the paper's acos, the sign tells left from right, and turning by the
/// angle makes the vehicle face the goal.
#[test]
fn the_turn_faces_the_goal() {
    let mut rng = Rng::new(1);
    for _ in 0..500 {
        let start =
            Waypoint { position: Point3::from(rng.normal3()), yaw: rng.range(-3.0 * PI, 3.0 * PI) };
        let goal = Point3::from(rng.normal3() * 4.0);
        let theta = turn_towards(&start, &goal).unwrap();
        let m = (goal - start.position).xy();
        let f = Vector2::new(start.yaw.cos(), start.yaw.sin());
        assert_relative_eq!(theta.abs(), (f.dot(&m) / m.norm()).acos(), epsilon = 1e-6);
        let faced = start.yaw + theta;
        let ahead = Vector2::new(faced.cos(), faced.sin());
        assert_relative_eq!(ahead, m.normalize(), epsilon = 1e-9);
        assert_eq!(theta > 0.0, f.perp(&m) > 0.0, "left is positive");
    }
}

#[test]
fn straight_up_needs_no_turn() {
    let start = Waypoint { position: Point3::new(1.0, 2.0, 1.0), yaw: 0.3 };
    let above = Goal { position: Point3::new(1.0, 2.0, 2.0), yaw: None };
    assert_eq!(turn_towards(&start, &above.position), None);
    let way = legs(start, &above, PathStyle::HorizontalVertical);
    assert_eq!(way.len(), 1);
    assert_eq!(
        way[0],
        Leg { kind: LegKind::Vertical, to: Waypoint { position: above.position, yaw: 0.3 } }
    );
    let here = Goal { position: start.position, yaw: None };
    assert!(legs(start, &here, PathStyle::HorizontalVertical).is_empty());
    assert!(legs(start, &here, PathStyle::Straight).is_empty());
}

/// Every style ends at the goal, and level legs are level and face where they go (P83).
#[test]
fn every_style_arrives() {
    let mut rng = Rng::new(2);
    for _ in 0..200 {
        let start = Waypoint { position: Point3::from(rng.normal3() * 3.0), yaw: rng.normal() };
        let yaw = rng.chance(0.5).then(|| rng.normal());
        let goal = Goal { position: Point3::from(rng.normal3() * 3.0), yaw };
        for style in [PathStyle::HorizontalVertical, PathStyle::Straight] {
            let way = legs(start, &goal, style);
            let end = Trajectory::along(start, &way, &MotionLimits::default()).end();
            assert_relative_eq!(end.position, goal.position, epsilon = 1e-9);
            if let Some(yaw) = goal.yaw {
                assert_relative_eq!(wrapped(end.yaw - yaw), 0.0, epsilon = 1e-9);
            }
            let mut here = start;
            for leg in way {
                let moved = leg.to.position - here.position;
                match leg.kind {
                    LegKind::Horizontal => {
                        assert_eq!(moved.z, 0.0);
                        let faced = Vector2::new(leg.to.yaw.cos(), leg.to.yaw.sin());
                        assert_relative_eq!(moved.xy().normalize(), faced, epsilon = 1e-9);
                    }
                    LegKind::Vertical => assert_eq!(moved.xy().norm(), 0.0),
                    LegKind::Turn => assert_eq!(moved.norm(), 0.0),
                    _ => {}
                }
                here = leg.to;
            }
        }
    }
}
