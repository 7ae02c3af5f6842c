use std::f64::consts::{PI, TAU};

use approx::assert_relative_eq;
use volery_geometry::Rng;

use super::*;
use crate::group::{Formation, Geofence, assign};
use crate::motion::MotionLimits;

/// A hall of 16 m by 16 m with the height `ceiling`.
fn rules(ceiling: f64) -> Rules {
    let low = Point3::new(-8.0, -8.0, 0.0);
    let high = Point3::new(8.0, 8.0, ceiling);
    Rules {
        limits: MotionLimits::default(),
        separation: Separation::default(),
        geofence: Geofence::around(&low, &high, 0.5).unwrap(),
        air: None,
        others: Default::default(),
        start_tolerance: 0.3,
        metric_map: true,
    }
}

fn task(vehicle: u8, from: Point3<f64>, to: &[Point3<f64>]) -> Task {
    Task {
        vehicle: VehicleId(vehicle),
        start: Waypoint { position: from, yaw: 0.0 },
        goals: to.iter().map(|&position| Goal { position, yaw: None }).collect(),
    }
}

/// Ten on a circle, everybody to the place opposite: all ways cross in the middle and every pair
/// swaps.
fn crossing(height: f64) -> Vec<Task> {
    let place = |k: f64| {
        let (sin, cos) = (TAU * k / 10.0).sin_cos();
        Point3::new(5.0 * cos, 5.0 * sin, height)
    };
    (0..10u8).map(|k| task(k + 1, place(f64::from(k)), &[place(f64::from(k) + 5.0)])).collect()
}

/// The plan keeps all rules, all arrive, and nobody is nearer than distance and margin.
fn assert_flyable(plan: &FlightPlan, tasks: &[Task], rules: &Rules, how: &Deconfliction) {
    assert_eq!(plan.check(rules), []);
    assert_eq!(plan.ways.len(), tasks.len());
    for task in tasks {
        let way = &plan.ways[&task.vehicle];
        assert_eq!(way.start().position, task.start.position);
        let goal = task.goals.last().map_or(task.start.position, |goal| goal.position);
        assert_relative_eq!(way.end().position, goal, epsilon = 1e-9);
    }
    if let Some(closest) = plan.closest(&rules.separation) {
        assert!(closest >= rules.separation.distance + how.margin - 1e-5, "{closest}");
    }
}

/// Ten crossing vehicles are planned in a high hall by heights, in a low one by waits and bends.
#[test]
fn ten_crossing_vehicles_find_their_ways() {
    let how = Deconfliction::default();
    for ceiling in [6.0, 2.6] {
        let rules = rules(ceiling);
        let tasks = crossing(1.3);
        let plain = Deconfliction { margin: 0.0, ..how.clone() };
        let direct = |task: &Task| {
            let legs = legs(task.start, &task.goals[0], PathStyle::HorizontalVertical);
            (task.vehicle, timed(task.start, &legs, Duration::ZERO, &rules, &plain))
        };
        let naive =
            FlightPlan { ways: tasks.iter().map(direct).collect(), ..FlightPlan::default() };
        let met = naive.check(&rules).len();
        assert!(met >= 10, "plain ways meet in the middle: {met}");
        let plan = deconflict(&tasks, &rules, &how).unwrap();
        assert_flyable(&plan, &tasks, &rules, &how);
        assert!(plan.duration() < Duration::from_secs(80), "{:?}", plan.duration());
        assert_eq!(
            deconflict(&tasks, &rules, &how).unwrap(),
            plan,
            "the same tasks, the same plan"
        );
    }
}

/// Random starts and goals, some with several goals, some that stay.
#[test]
fn random_groups_find_their_ways() {
    let (rules, how) = (rules(4.0), Deconfliction::default());
    let mut rng = Rng::new(8);
    for _ in 0..6 {
        let scatter = |rng: &mut Rng| {
            let mut places: Vec<Point3<f64>> = Vec::new();
            while places.len() < 8 {
                let place =
                    Point3::new(rng.range(-7.0, 7.0), rng.range(-7.0, 7.0), rng.range(0.6, 3.4));
                if places.iter().all(|p| (p - place).xy().norm() > 2.0) {
                    places.push(place);
                }
            }
            places
        };
        let stages = [scatter(&mut rng), scatter(&mut rng), scatter(&mut rng)];
        let tasks: Vec<Task> = (0..8)
            .map(|k| task(k as u8 + 1, stages[0][k], &[stages[1][k], stages[2][k]]))
            .collect();
        let plan = deconflict(&tasks, &rules, &how).unwrap();
        assert_flyable(&plan, &tasks, &rules, &how);
    }
}

/// Who meets nobody flies the plain way at once.
#[test]
fn nobody_is_sent_round_without_need() {
    let (rules, how) = (rules(4.0), Deconfliction::default());
    let tasks = [
        task(1, Point3::new(-5.0, -3.0, 1.0), &[Point3::new(5.0, -3.0, 2.0)]),
        task(2, Point3::new(-5.0, 3.0, 1.0), &[Point3::new(5.0, 3.0, 2.0)]),
    ];
    let plan = deconflict(&tasks, &rules, &how).unwrap();
    for task in &tasks {
        let legs = legs(task.start, &task.goals[0], PathStyle::HorizontalVertical);
        let plain = Trajectory::along(task.start, &legs, &rules.limits);
        assert!(plan.ways[&task.vehicle].duration() <= plain.duration());
    }
}

/// One who stays is flown around, and so is an obstacle that nobody plans.
#[test]
fn the_standing_are_flown_around() {
    let rules = rules(2.6);
    let crossing = task(1, Point3::new(-4.0, 0.0, 1.3), &[Point3::new(4.0, 0.0, 1.3)]);
    let standing = task(2, Point3::new(0.2, 0.0, 1.3), &[]);
    let how = Deconfliction::default();
    let tasks = [crossing.clone(), standing.clone()];
    assert_flyable(&deconflict(&tasks, &rules, &how).unwrap(), &tasks, &rules, &how);

    let obstacles = vec![standing.start.position];
    let how = Deconfliction { obstacles, ..how };
    let alone = deconflict(&[crossing], &rules, &how).unwrap();
    let obstacle = Trajectory::standing(standing.start);
    let truly = Separation { vertical_weight: 1.0, ..rules.separation };
    let nearest = closest_approach(&alone.ways[&VehicleId(1)], &obstacle, &truly);
    assert!(nearest.distance >= 1.25 - 1e-5, "{nearest:?}");
}

/// Goals that are too near to each other cannot be planned: refused with the pair and the time.
#[test]
fn goals_too_near_are_refused_with_the_pair() {
    let rules = rules(4.0);
    let tasks = [
        task(3, Point3::new(-4.0, -3.0, 1.0), &[Point3::new(0.0, 0.0, 1.0)]),
        task(7, Point3::new(-4.0, 3.0, 1.0), &[Point3::new(0.0, 0.8, 1.0)]),
    ];
    let refused = deconflict(&tasks, &rules, &Deconfliction::default()).unwrap_err();
    let [Violation::TooClose { first, second, at, distance, .. }] = refused.violations[..] else {
        panic!("{refused:?}")
    };
    assert_eq!((first, second), (VehicleId(3), VehicleId(7)));
    assert!(distance <= 0.8 + 1e-9 && at > Duration::ZERO);
    let outside = [task(1, Point3::new(0.0, 0.0, 1.0), &[Point3::new(0.0, 0.0, 3.8)])];
    let refused = deconflict(&outside, &rules, &Deconfliction::default()).unwrap_err();
    assert!(matches!(refused.violations[..], [Violation::OutOfFence { .. }]), "{refused:?}");
}

/// Straight ways stay straight: they are only delayed.
#[test]
fn straight_ways_are_delayed() {
    let rules = rules(4.0);
    let how = Deconfliction { style: PathStyle::Straight, ..Deconfliction::default() };
    let tasks = [
        task(1, Point3::new(-4.0, 0.0, 1.0), &[Point3::new(4.0, 0.0, 2.0)]),
        task(2, Point3::new(0.0, -4.0, 1.0), &[Point3::new(0.0, 4.0, 2.0)]),
    ];
    let plan = deconflict(&tasks, &rules, &how).unwrap();
    assert_flyable(&plan, &tasks, &rules, &how);
    let kinds = plan.ways.values().flat_map(|way| way.legs().map(|(kind, ..)| kind));
    assert!(kinds.into_iter().all(|k| matches!(k, LegKind::Straight | LegKind::Wait)));
}

/// From a grid into a circle with the cheapest assignment: nobody waits long.
#[test]
fn formations_change() {
    let (rules, how) = (rules(3.0), Deconfliction::default());
    let center = Point3::new(0.0, 0.0, 1.4);
    let grid = Formation::Grid.goals(9, &center, 0.0, 2.0);
    let circle = Formation::Circle.goals(9, &center, PI / 7.0, 3.0);
    let cost: Vec<Vec<f64>> = grid
        .iter()
        .map(|g| circle.iter().map(|c| (g.position - c.position).norm_squared()).collect())
        .collect();
    let columns = assign(&cost).unwrap();
    let tasks: Vec<Task> = grid
        .iter()
        .zip(columns)
        .enumerate()
        .map(|(k, (from, to))| task(k as u8, from.position, &[circle[to].position]))
        .collect();
    let plan = deconflict(&tasks, &rules, &how).unwrap();
    assert_flyable(&plan, &tasks, &rules, &how);
    assert!(plan.duration() < Duration::from_secs(30), "{:?}", plan.duration());
}
