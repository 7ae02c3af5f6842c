use nalgebra::UnitQuaternion;
use volery_geometry::Rng;

use super::*;
use crate::telemetry::{Landed, Motion};

const MAX_AGE: Duration = Duration::from_millis(100);
const WAY: Duration = Duration::ZERO;

fn at(seconds: f64) -> Duration {
    Duration::from_secs_f64(seconds)
}

fn fix(x: f64, captured: f64) -> PoseFix {
    PoseFix {
        map_from_body: Isometry3::translation(x, 0.0, 1.0),
        captured: at(captured),
        position_sd: 0.02,
        angle_sd: 0.01,
        resets: 0,
    }
}

/// A vehicle in flight at `x` that moves with `speed`.
fn flying(x: f64, speed: f64, now: f64) -> Telemetry {
    Telemetry {
        armed: true,
        landed: Landed::Air,
        position_known: Some(true),
        motion: Some(Motion {
            position: Point3::new(x, 0.0, 1.0),
            velocity: Vector3::x() * speed,
            at: at(now),
        }),
        yaw: Some((0.0, at(now))),
        ..Telemetry::default()
    }
}

/// A gate that has seen a vehicle fly along x at 1 m/s up to 10 s.
fn gate_in_flight() -> PoseGate {
    let mut gate = PoseGate::default();
    for step in 0..=20_u32 {
        let time = 9.0 + 0.05 * f64::from(step);
        gate.check(fix(time - 9.0, time), &flying(time - 9.0, 1.0, time), MAX_AGE, WAY, at(time))
            .unwrap();
    }
    gate
}

#[test]
fn what_is_not_finite_or_not_now_never_passes() {
    let telemetry = Telemetry::default();
    for bad in [f64::NAN, f64::INFINITY, -f64::INFINITY, 1e9] {
        for axis in 0..3 {
            let mut fix = fix(0.0, 1.0);
            fix.map_from_body.translation.vector[axis] = bad;
            let refusal = PoseGate::default().check(fix, &telemetry, MAX_AGE, WAY, at(1.0));
            assert_eq!(refusal, Err(PoseRefusal::NotFinite));
        }
        let turned = UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(bad, 0.0, 0.0, 0.0));
        let mut fix = fix(0.0, 1.0);
        fix.map_from_body.rotation = turned;
        let refusal = PoseGate::default().check(fix, &telemetry, MAX_AGE, WAY, at(1.0));
        assert_eq!(refusal, Err(PoseRefusal::NotFinite));
    }
    let mut gate = PoseGate::default();
    let stale = gate.check(fix(0.0, 1.0), &telemetry, MAX_AGE, WAY, at(1.2));
    assert_eq!(stale, Err(PoseRefusal::Stale(Duration::from_millis(200))));
    let early = gate.check(fix(0.0, 1.1), &telemetry, MAX_AGE, WAY, at(1.0));
    assert_eq!(early, Err(PoseRefusal::Future(Duration::from_millis(100))));
}

#[test]
fn no_pose_passes_twice() {
    let mut gate = gate_in_flight();
    let telemetry = flying(1.0, 1.0, 10.0);
    for captured in [10.0, 9.95, 10.01] {
        let again = gate.check(fix(1.0, captured), &telemetry, MAX_AGE, WAY, at(10.02));
        assert_eq!(again, Err(PoseRefusal::NotNewer));
    }
}

/// A flight at 1 m/s is no jump, and 0.2 m beside it is one, in every direction, however often it
/// comes again.
#[test]
fn a_jump_in_flight_never_passes() {
    let mut rng = Rng::new(5);
    for _ in 0..200 {
        let mut gate = gate_in_flight();
        let step = rng.normal3().normalize() * 0.2 * 100f64.powf(rng.uniform());
        for frame in 1..100_u32 {
            let time = 10.0 + 0.05 * f64::from(frame);
            let mut wrong = fix(time - 9.0, time);
            wrong.map_from_body.translation.vector += step;
            let telemetry = flying(time - 9.0, 1.0, time);
            let refusal = gate.check(wrong, &telemetry, MAX_AGE, WAY, at(time));
            assert!(matches!(refusal, Err(PoseRefusal::Jump(_))), "{step:?} at {time}");
        }
    }
}

/// What is nearer than the noise allows is not told from noise, and a place that is announced as
/// new is believed when three poses agree, with another reset counter; not if it is far away.
#[test]
fn a_new_place_in_flight_must_be_announced() {
    for (announced, step, passes) in
        [(true, 0.3, true), (true, 0.65, true), (false, 0.3, false), (true, 0.9, false)]
    {
        let mut gate = gate_in_flight();
        let mut passed = Vec::new();
        for frame in 1..=20_u32 {
            let time = 10.0 + 0.05 * f64::from(frame);
            let mut elsewhere = fix(time - 9.0, time);
            elsewhere.map_from_body.translation.vector.y += step;
            elsewhere.resets = u32::from(announced);
            let telemetry = flying(time - 9.0, 1.0, time);
            passed.extend(gate.check(elsewhere, &telemetry, MAX_AGE, WAY, at(time)).ok());
            assert_eq!(gate.is_relocating(at(time)), announced, "frame {frame}");
            if !passed.is_empty() {
                assert!(!gate.is_relocating(at(time + 1.0)));
                break;
            }
        }
        assert_eq!(passed, if passes { vec![1] } else { vec![] }, "{announced} {step}");
    }
}

/// After a second without poses the estimator has strayed by some centimeters.
#[test]
fn after_an_outage_a_pose_nearby_passes() {
    for (stray, passes) in [(0.08, true), (0.3, false)] {
        let mut gate = gate_in_flight();
        let mut late = fix(2.0, 11.0);
        late.map_from_body.translation.vector.y += stray;
        let checked = gate.check(late, &flying(2.0, 1.0, 11.0), MAX_AGE, WAY, at(11.0));
        assert_eq!(checked.is_ok(), passes, "{stray}: {checked:?}");
    }
}

/// Before it gets poses, an estimator is anywhere; where it was then counts for nothing in flight.
#[test]
fn an_estimator_that_came_over_on_the_ground_is_believed() {
    let mut gate = PoseGate::default();
    let mut rng = Rng::new(6);
    for step in 0..=200_u32 {
        let time = 1.0 + 0.05 * f64::from(step);
        let off = 4.0 * (1.0 - f64::from(step) / 80.0).max(0.0);
        let landed = if step < 100 { Landed::Ground } else { Landed::Air };
        let known = Some(off == 0.0);
        let telemetry = Telemetry { landed, position_known: known, ..flying(off, 0.0, time) };
        let checked =
            gate.check(fix(0.01 * rng.normal(), time), &telemetry, MAX_AGE, WAY, at(time));
        assert_eq!(checked, Ok(0), "step {step}");
    }
}

#[test]
fn one_wrong_pose_does_not_end_the_flight() {
    let mut gate = gate_in_flight();
    let telemetry = flying(1.05, 1.0, 10.05);
    assert!(gate.check(fix(5.0, 10.05), &telemetry, MAX_AGE, WAY, at(10.05)).is_err());
    let telemetry = flying(1.10, 1.0, 10.10);
    assert_eq!(gate.check(fix(1.1, 10.10), &telemetry, MAX_AGE, WAY, at(10.10)), Ok(0));
}

#[test]
fn a_turned_or_toppled_pose_does_not_pass() {
    let mut gate = gate_in_flight();
    let telemetry = flying(1.05, 1.0, 10.05);
    let mut turned = fix(1.05, 10.05);
    turned.map_from_body.rotation = UnitQuaternion::from_euler_angles(0.0, 0.0, 3.1);
    let refusal = gate.check(turned, &telemetry, MAX_AGE, WAY, at(10.05));
    assert!(matches!(refusal, Err(PoseRefusal::Turn(_))));
    turned.map_from_body.rotation = UnitQuaternion::from_euler_angles(1.5, 0.0, 0.0);
    let refusal = gate.check(turned, &telemetry, MAX_AGE, WAY, at(10.05));
    assert!(matches!(refusal, Err(PoseRefusal::Tilted(_))));
}

/// A vehicle that is carried elsewhere is believed after three poses that agree, with another
/// reset counter; three that do not agree are not believed.
#[test]
fn on_the_ground_a_new_place_needs_three_witnesses() {
    let telemetry = Telemetry::default();
    let mut gate = PoseGate::default();
    let mut check =
        |x: f64, time: f64| gate.check(fix(x, time), &telemetry, MAX_AGE, WAY, at(time));
    assert_eq!(check(0.0, 1.0), Ok(0));
    assert!(check(9.0, 1.05).is_err());
    assert!(check(5.0, 1.10).is_err());
    assert!(check(9.0, 1.15).is_err());
    assert!(check(9.01, 1.20).is_err());
    assert_eq!(check(9.0, 1.25), Ok(1));
    assert_eq!(check(9.0, 1.30), Ok(1));
}

/// The estimator knows better where the vehicle is than a first pose from far away.
#[test]
fn a_first_pose_in_flight_must_be_where_the_estimator_is() {
    let telemetry = flying(0.0, 0.0, 1.0);
    let far = PoseGate::default().check(fix(3.0, 1.0), &telemetry, MAX_AGE, WAY, at(1.0));
    assert!(matches!(far, Err(PoseRefusal::Jump(_))));
    let near = PoseGate::default().check(fix(0.1, 1.0), &telemetry, MAX_AGE, WAY, at(1.0));
    assert_eq!(near, Ok(0));
}
