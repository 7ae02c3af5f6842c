use std::time::Duration;

use volery_geometry::Rng;

use super::*;
use crate::motion::MotionLimits;

fn seen<'a>(position: [f64; 3], velocity: [f64; 3], intent: Intent<'a>) -> Neighbor<'a> {
    Neighbor { position: position.into(), velocity: velocity.into(), intent }
}

fn verdicts(first: Neighbor, second: Neighbor) -> [Verdict; 2] {
    let (low, high) = (VehicleId(3), VehicleId(8));
    let found = guard(&BTreeMap::from([(low, first), (high, second)]), &Guard::default());
    [low, high].map(|id| found.get(&id).copied().unwrap_or(Verdict::Continue))
}

const HOLD: Verdict = Verdict::Hold(Reason::TooClose);
const LAND: Verdict = Verdict::Land(Reason::TooClose);

#[test]
fn far_vehicles_go_on() {
    let calm = seen([0.0, 0.0, 1.0], [0.0; 3], Intent::Unknown);
    assert_eq!(
        verdicts(calm, seen([3.0, 0.0, 1.0], [-1.0, 0.0, 0.0], Intent::Unknown)),
        [Verdict::Continue, Verdict::Continue]
    );
}

/// First the one of lower rank holds, then both.
#[test]
fn the_higher_number_gives_way_then_both() {
    let a = seen([0.0, 0.0, 1.0], [0.5, 0.0, 0.0], Intent::Unknown);
    let b = seen([1.9, 0.0, 1.0], [-0.5, 0.0, 0.0], Intent::Unknown);
    assert_eq!(verdicts(a, b), [Verdict::Continue, HOLD]);
    let stopping = Neighbor { intent: Intent::Stop, ..b };
    assert_eq!(verdicts(a, stopping), [HOLD, HOLD], "it slides on by 0.25 m");
    let stopped = seen([2.3, 0.0, 1.0], [0.0; 3], Intent::Stop);
    assert_eq!(verdicts(a, stopped), [Verdict::Continue, Verdict::Continue]);
}

/// Who lands or is not ours does not give way.
#[test]
fn who_cannot_give_way_need_not() {
    let a = seen([0.0, 0.0, 1.0], [0.5, 0.0, 0.0], Intent::Unknown);
    let b = seen([2.3, 0.0, 1.0], [-0.5, 0.0, 0.0], Intent::Forced);
    assert_eq!(verdicts(a, b), [HOLD, Verdict::Continue]);
}

/// Two that are too near land one: the lower one if they are above each other.
#[test]
fn too_near_lands_one() {
    let a = seen([0.0, 0.0, 1.0], [0.0; 3], Intent::Stop);
    let beside = seen([0.4, 0.0, 1.0], [0.0; 3], Intent::Stop);
    assert_eq!(verdicts(a, beside)[1], LAND);
    let above = seen([0.1, 0.0, 1.8], [0.0; 3], Intent::Stop);
    assert_eq!(verdicts(a, above)[0], LAND);
    let below = seen([0.1, 0.0, 0.2], [0.0; 3], Intent::Stop);
    assert_eq!(verdicts(a, below)[1], LAND);
}

#[test]
fn those_who_part_are_not_stopped() {
    let a = seen([0.0, 0.0, 1.0], [-0.5, 0.0, 0.0], Intent::Unknown);
    let b = seen([0.9, 0.0, 1.0], [0.5, 0.0, 0.0], Intent::Unknown);
    assert_eq!(verdicts(a, b), [Verdict::Continue, Verdict::Continue]);
}

/// A vehicle on its way to a stop short of another is not held; one that strays from it is.
#[test]
fn the_way_is_believed_only_as_far_as_it_is_followed() {
    let limits = MotionLimits::default();
    let mut way = Trajectory::standing(Waypoint { position: Point3::origin(), yaw: 0.0 });
    let to = Waypoint { position: Point3::new(4.0, 0.0, 0.0), yaw: 0.0 };
    way.fly(LegKind::Straight, to, &limits);
    let standing = seen([5.2, 0.0, 0.0], [0.0; 3], Intent::Stop);
    let mut straying_was_held = false;
    for k in 0..60 {
        let clock = f64::from(k) * 0.1;
        let now = way.sample(Duration::from_secs_f64(clock));
        let intent = Intent::Follow(&way, clock);
        let on = Neighbor { position: now.position, velocity: now.velocity, intent };
        assert_eq!(verdicts(standing, on), [Verdict::Continue; 2], "after {clock} s");
        let fast = now.velocity + Vector3::new(0.5, 0.0, 0.0);
        let straying = Neighbor { velocity: fast, ..on };
        straying_was_held |= verdicts(standing, straying)[1] == HOLD;
    }
    assert!(straying_was_held);
}

/// Whatever the motion, a pair that will be too near within the horizon is not left alone.
#[test]
fn no_coming_nearness_is_overlooked() {
    let limits = Guard::default();
    let mut rng = Rng::new(11);
    for _ in 0..3_000 {
        let mut any = || Neighbor {
            position: Point3::from(rng.normal3() * 1.5),
            velocity: rng.normal3() * 0.7,
            intent: Intent::Unknown,
        };
        let (a, b) = (any(), any());
        let apart = |t: f64| {
            let apart = (b.position + b.velocity * t) - (a.position + a.velocity * t);
            limits.separation.measure(&apart)
        };
        let now = apart(0.0);
        let nearest = (0..=200).map(|k| apart(f64::from(k) * 0.01)).fold(f64::INFINITY, f64::min);
        let calm = verdicts(a, b) == [Verdict::Continue; 2];
        if nearest < 1.0 && nearest < now - 1e-6 {
            assert!(!calm, "{a:?} {b:?}");
        }
        if nearest > 1.01 {
            assert!(calm, "{a:?} {b:?}");
        }
    }
}

#[test]
fn a_place_that_is_no_number_is_too_close() {
    let a = seen([0.0, 0.0, 1.0], [0.0; 3], Intent::Unknown);
    let nowhere = seen([f64::NAN, 0.0, 1.0], [0.0; 3], Intent::Unknown);
    assert_eq!(verdicts(a, nowhere)[1], LAND);
}
