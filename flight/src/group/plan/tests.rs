use std::f64::consts::PI;

use nalgebra::Vector3;

use super::*;
use crate::motion::{Goal, LegKind, PathStyle, Waypoint, legs};

fn rules() -> Rules {
    let fence =
        Geofence::around(&Point3::new(-6.0, -6.0, 0.0), &Point3::new(6.0, 6.0, 3.0), 0.3).unwrap();
    Rules {
        limits: MotionLimits::default(),
        separation: Separation::default(),
        geofence: fence,
        air: None,
        others: Default::default(),
        start_tolerance: 0.3,
        metric_map: true,
    }
}

fn way(from: [f64; 3], to: [f64; 3]) -> Trajectory {
    let start = Waypoint { position: from.into(), yaw: 0.0 };
    let goal = Goal { position: to.into(), yaw: None };
    Trajectory::along(start, &legs(start, &goal, PathStyle::Straight), &rules().limits)
}

fn plan(ways: impl IntoIterator<Item = Trajectory>) -> FlightPlan {
    FlightPlan { ways: (1..).map(VehicleId).zip(ways).collect(), stages: Vec::new() }
}

fn codes(plan: &FlightPlan, rules: &Rules) -> Vec<&'static str> {
    plan.check(rules).iter().map(Violation::code).collect()
}

#[test]
fn a_plan_that_keeps_all_rules_passes() {
    let good = plan([way([0.0, 0.0, 1.0], [4.0, 0.0, 1.0]), way([0.0, 2.0, 1.0], [4.0, 2.0, 2.0])]);
    assert_eq!(good.check(&rules()), []);
    assert!((good.closest(&rules().separation).unwrap() - 2.0).abs() < 1e-6);
}

/// The refusal names the pair and the time.
#[test]
fn a_plan_with_a_crossing_names_pair_and_time() {
    let crossing = plan([
        way([0.0, 5.0, 1.0], [4.0, 5.0, 1.0]),
        way([-4.0, 0.0, 1.0], [4.0, 0.0, 1.0]),
        way([0.0, -4.0, 1.0], [0.0, 4.0, 1.0]),
    ]);
    let found = crossing.check(&rules());
    let [Violation::TooClose { first, second, at, distance, required }] = found[..] else {
        panic!("{found:?}")
    };
    assert_eq!((first, second), (VehicleId(2), VehicleId(3)));
    assert!((at.as_secs_f64() - 5.0).abs() < 1e-3 && distance < 1e-3 && required == 1.0);
}

/// The breach is where and when the margin is first touched.
#[test]
fn a_way_out_of_the_fence_names_place_and_time() {
    let found = plan([way([0.0, 0.0, 1.0], [9.0, 0.0, 1.0])]).check(&rules());
    let [Violation::OutOfFence { breach: Breach::Outside, at, place, .. }] = found[..] else {
        panic!("{found:?}")
    };
    assert!((place.x - 5.7).abs() < 1e-3, "{place}");
    // 1 m in 2 s of speeding up, the rest at 1 m/s.
    assert!((at.as_secs_f64() - (2.0 + 4.7)).abs() < 1e-3, "{at:?}");
    let high = plan([way([0.0, 0.0, 1.0], [0.0, 0.0, 2.9])]);
    assert_eq!(codes(&high, &rules()), ["out_of_fence"]);
    let standing_outside = plan([way([7.0, 0.0, 1.0], [7.0, 0.0, 1.0])]);
    assert_eq!(codes(&standing_outside, &rules()), ["out_of_fence"]);
}

/// Each limit is checked by itself.
#[test]
fn each_limit_counts() {
    let start = Waypoint { position: Point3::new(0.0, 0.0, 1.0), yaw: 0.0 };
    let diagonal = Waypoint { position: Point3::new(4.0, 1.0, 2.0), yaw: PI };
    let mut fast = Trajectory::standing(start);
    fast.fly(LegKind::Straight, diagonal, &MotionLimits::default());
    let turned = Waypoint { yaw: 0.5, ..diagonal };
    fast.fly(LegKind::Turn, turned, &MotionLimits::default());
    let sunk = Waypoint { position: diagonal.position - Vector3::z(), ..turned };
    fast.fly(LegKind::Vertical, sunk, &MotionLimits::default());
    let fast = plan([fast]);
    assert_eq!(fast.check(&rules()), []);
    let lower = |change: fn(&mut MotionLimits)| {
        let mut rules = rules();
        change(&mut rules.limits);
        let found = fast.check(&rules);
        let whats: Vec<_> = found
            .iter()
            .map(|v| match v {
                Violation::TooFast { what, value, limit, .. } if value > limit => *what,
                other => panic!("{other:?}"),
            })
            .collect();
        whats
    };
    assert_eq!(lower(|limits| limits.speed *= 0.5), ["speed"]);
    assert_eq!(lower(|limits| limits.climb_speed *= 0.5), ["climb_speed"]);
    assert_eq!(lower(|limits| limits.acceleration *= 0.5), ["acceleration"]);
    assert_eq!(lower(|limits| limits.yaw_rate *= 0.5), ["yaw_rate"]);
}

/// Ways that are no motion at all are refused before they are compared.
#[test]
fn impossible_ways_are_refused() {
    let at = |x: f64| Point3::new(x, 0.0, 1.0);
    let rest = |start: f64, x: f64| Segment::rest(LegKind::Wait, start, 1.0, at(x), 0.0);
    let end = |x| Waypoint { position: at(x), yaw: 0.0 };
    let teleport = Trajectory::from_segments(vec![rest(0.0, 0.0), rest(1.0, 2.0)], end(2.0));
    assert_eq!(codes(&plan([teleport]), &rules()), ["jump"]);
    let late = Trajectory::from_segments(vec![rest(0.5, 0.0)], end(0.0));
    assert_eq!(codes(&plan([late]), &rules()), ["jump"]);
    let nan = Trajectory::from_segments(vec![rest(0.0, f64::NAN)], end(0.0));
    assert_eq!(codes(&plan([nan, way([0.0; 3], [1.0; 3])]), &rules())[0], "not_finite");
    assert_eq!(codes(&FlightPlan::default(), &rules()), ["no_vehicles"]);
}

#[test]
fn a_map_without_scale_flies_nobody() {
    let good = plan([way([0.0, 0.0, 1.0], [1.0, 0.0, 1.0])]);
    assert_eq!(codes(&good, &Rules { metric_map: false, ..rules() }), ["map_not_metric"]);
    let mut senseless = rules();
    senseless.limits.speed = f64::NAN;
    assert_eq!(codes(&good, &senseless), ["bad_rules"]);
    let mut touching = rules();
    touching.separation.distance = 0.0;
    assert_eq!(codes(&good, &touching), ["bad_rules"]);
}

#[test]
fn everybody_must_stand_at_the_start() {
    let two = plan([way([0.0, 0.0, 1.0], [1.0, 0.0, 1.0]), way([0.0, 3.0, 1.0], [1.0, 3.0, 1.0])]);
    let at = |y: f64| {
        BTreeMap::from([
            (VehicleId(1), Point3::new(0.0, 0.29, 1.0)),
            (VehicleId(2), Point3::new(0.0, y, 1.0)),
        ])
    };
    assert_eq!(two.check_starts(&at(3.0), &rules()), []);
    let found = two.check_starts(&at(3.5), &rules());
    assert!(matches!(found[..], [Violation::NotAtStart { vehicle: VehicleId(2), .. }]));
    assert_eq!(two.check_starts(&at(f64::NAN), &rules())[0].code(), "not_at_start");
    let mut one = at(3.0);
    one.remove(&VehicleId(1));
    assert_eq!(two.check_starts(&one, &rules())[0].code(), "place_unknown");
}
