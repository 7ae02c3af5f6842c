use approx::assert_relative_eq;
use nalgebra::Point3;

use super::*;
use crate::motion::{Goal, PathStyle, legs};

fn flight(goal: Point3<f64>, range: &ViewRange) -> (Waypoint, Trajectory) {
    let start = Waypoint { position: Point3::new(0.0, 0.0, 1.0), yaw: 0.0 };
    let way = legs(start, &Goal { position: goal, yaw: None }, PathStyle::HorizontalVertical);
    (start, with_views(start, &way, range, &MotionLimits::default()))
}

/// Places of the views, the start first.
fn stations(start: Waypoint, flight: &Trajectory) -> Vec<Point3<f64>> {
    let views = flight.segments().iter().filter(|s| s.kind == LegKind::View);
    std::iter::once(start.position).chain(views.map(|s| s.position)).collect()
}

/// P86: between neighbors on the way ahead no image grows by more than the range allows, and a
/// near goal has one view, its own.
#[test]
fn a_far_goal_is_reached_over_nearer_views() {
    let range = ViewRange::default();
    for length in [0.5, 1.0, 3.734, 8.0, 20.0] {
        let (start, flight) = flight(Point3::new(length, 0.0, 1.0), &range);
        let places = stations(start, &flight);
        let depth = |p: &Point3<f64>| length + range.scene_depth - p.x;
        for pair in places.windows(2) {
            let scale = depth(&pair[0]) / depth(&pair[1]);
            assert!(scale <= range.max_scale + 1e-9 && scale > 1.0, "{scale} at {length} m");
        }
        assert_relative_eq!(places.last().unwrap().x, length, epsilon = 1e-9);
        let needed = ((length + 3.0) / 3.0f64).ln() / 1.6f64.ln();
        assert_eq!(places.len() - 1, needed.ceil() as usize, "no more views than needed");
    }
}

/// P88: on the way up views stand at regular intervals and share half of their pictures. P87: the
/// frame at the corner comes between the level and the vertical leg.
#[test]
fn views_on_the_way_up_are_regular() {
    let range = ViewRange { scene_depth: 1.0, ..ViewRange::default() };
    let (start, flight) = flight(Point3::new(1.0, 0.0, 3.0), &range);
    let places = stations(start, &flight);
    let up: Vec<f64> = places.iter().filter(|p| p.x > 0.99).map(|p| p.z).collect();
    assert_relative_eq!(up[0], 1.0, epsilon = 1e-9);
    let step = up[1] - up[0];
    let shared = 1.0 - step / (2.0 * (range.vertical_fov * 0.5).tan());
    assert!(shared >= range.min_overlap, "{shared}");
    assert!(up.windows(2).all(|pair| (pair[1] - pair[0] - step).abs() < 1e-9));
    let kinds: Vec<_> = flight.legs().map(|(kind, ..)| kind).collect();
    let corner =
        kinds.windows(3).any(|k| k == [LegKind::Horizontal, LegKind::View, LegKind::Vertical]);
    assert!(corner, "{kinds:?}");
}

/// Views change where the vehicle stops, never where it goes.
#[test]
fn views_do_not_change_the_way() {
    let (start, flight) = flight(Point3::new(6.0, 2.0, 2.5), &ViewRange::default());
    let goal = Goal { position: Point3::new(6.0, 2.0, 2.5), yaw: None };
    let plain = legs(start, &goal, PathStyle::HorizontalVertical);
    assert_relative_eq!(flight.end().position, plain.last().unwrap().to.position, epsilon = 1e-9);
    assert_relative_eq!(flight.end().yaw, plain.last().unwrap().to.yaw, epsilon = 1e-9);
}
