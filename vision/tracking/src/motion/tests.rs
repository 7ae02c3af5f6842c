use volery_geometry::Rng;
use volery_geometry::frames::enu_from_camera;

use super::*;

const STEP_S: f64 = 0.1;

/// A camera that flies a curve and turns.
fn truth(time_s: f64) -> Isometry3<f64> {
    let position = Vector3::new((0.5 * time_s).sin() * 2.0, 0.6 * time_s, 1.5 + 0.1 * time_s.sin());
    let rotation = enu_from_camera(0.4 * (0.7 * time_s).sin(), 0.0, 0.0);
    Isometry3::from_parts(position.into(), rotation)
}

fn noise() -> Matrix6<f64> {
    Matrix6::from_diagonal(&Vector6::new(1.0, 1.0, 1.0, 0.04, 0.04, 0.04)) * 1e-4
}

fn measured(rng: &mut Rng, time_s: f64) -> Isometry3<f64> {
    let truth = truth(time_s);
    let turn = UnitQuaternion::from_scaled_axis(rng.normal3() * 0.002);
    let position = truth.translation.vector + rng.normal3() * 0.01;
    Isometry3::from_parts(position.into(), turn * truth.rotation)
}

fn flown(rng: &mut Rng, steps: usize, tell: &dyn Fn(f64, &mut Rng) -> Telemetry) -> Motion {
    let mut motion = Motion::at(&measured(rng, 0.0), &noise(), MotionLimits::default());
    for k in 1..steps {
        let time_s = k as f64 * STEP_S;
        motion.predict(STEP_S);
        motion.measure(&measured(rng, time_s), &noise());
        motion.report(&tell(time_s, rng));
    }
    motion
}

fn error(motion: &Motion, time_s: f64) -> Vector6<f64> {
    -motion.innovation(&truth(time_s))
}

/// The pose is no worse than it says, during the flight and after a blackout.
#[test]
fn errors_are_as_stated() {
    let mut rng = Rng::new(3);
    let (mut sum, mut blind) = (0.0, 0.0);
    const TRIALS: usize = 60;
    for _ in 0..TRIALS {
        let mut motion = flown(&mut rng, 30, &|_, _| Telemetry::default());
        let nees = |motion: &Motion, time_s: f64| {
            let e = error(motion, time_s);
            e.dot(&(motion.covariance().try_inverse().unwrap() * e))
        };
        sum += nees(&motion, 2.9) / TRIALS as f64;
        motion.predict(0.5);
        blind += nees(&motion, 3.4) / TRIALS as f64;
    }
    assert!((3.0..8.0).contains(&sum), "{sum}");
    // Drones move less than they may: less than six is expected, more would be a lie.
    assert!(blind < 7.0, "{blind}");
}

/// Dies without the offsets: the compass's north is 70 degrees off the map's, and the height starts
/// elsewhere. During a blackout the heading is held.
#[test]
fn reports_hold_the_heading_through_a_blackout() {
    let tell = |time_s: f64, rng: &mut Rng| {
        let forward = truth(time_s).rotation * Vector3::z();
        Telemetry {
            heading: Some((forward.x.atan2(forward.y) + 1.2 + 0.01 * rng.normal(), 0.01)),
            height: Some((truth(time_s).translation.z - 7.0 + 0.03 * rng.normal(), 0.03)),
            velocity: None,
        }
    };
    let mut rng = Rng::new(5);
    const TRIALS: usize = 20;
    let (mut with, mut without, mut height) = (0.0, 0.0, 0.0);
    for _ in 0..TRIALS {
        let mut told = flown(&mut rng, 40, &tell);
        let mut untold = flown(&mut rng, 40, &|_, _| Telemetry::default());
        for k in 40..60 {
            told.predict(STEP_S);
            told.report(&tell(k as f64 * STEP_S, &mut rng));
            untold.predict(STEP_S);
        }
        let (told, untold) = (error(&told, 5.9), error(&untold, 5.9));
        eprintln!("{:.3?} {:.3?}", told.as_slice(), untold.as_slice());
        with += told[5].powi(2) / TRIALS as f64;
        without += untold[5].powi(2) / TRIALS as f64;
        height += told[2].powi(2) / TRIALS as f64;
    }
    let [with, without, height] = [with, without, height].map(f64::sqrt);
    assert!(with < 0.03 && height < 0.05, "{with} rad, {height} m");
    assert!(without > 3.0 * with, "{without} rad without, {with} with");
}

#[test]
fn velocity_carries_through_a_blackout() {
    let tell = |time_s: f64, rng: &mut Rng| {
        let forward = truth(time_s).rotation * Vector3::z();
        let there = truth(time_s + 1e-4).translation.vector - truth(time_s).translation.vector;
        let north_in_map = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -1.2);
        Telemetry {
            heading: Some((forward.x.atan2(forward.y) + 1.2 + 0.01 * rng.normal(), 0.01)),
            height: None,
            velocity: Some((north_in_map * there / 1e-4 + 0.02 * rng.normal3(), 0.02)),
        }
    };
    let mut rng = Rng::new(6);
    let mut motion = flown(&mut rng, 40, &tell);
    for k in 40..60 {
        motion.predict(STEP_S);
        motion.report(&tell(k as f64 * STEP_S, &mut rng));
    }
    let error = error(&motion, 5.9).fixed_rows::<3>(0).norm();
    assert!(error < 0.25, "{error}");
}

#[test]
fn jumps_and_nonsense_are_not_admitted() {
    let mut rng = Rng::new(9);
    let mut motion = flown(&mut rng, 20, &|_, _| Telemetry::default());
    motion.predict(STEP_S);
    let estimate = |map_from_camera: Isometry3<f64>| PoseEstimate {
        map_from_camera,
        covariance: noise(),
        num_inliers: 50,
        num_correspondences: 50,
        reprojection_px: 0.5,
        sightings: Vec::new(),
    };
    assert!(motion.admits(&estimate(truth(2.0))));
    for shift in [0.3, 2.0, 20.0, f64::NAN] {
        let jump = Isometry3::translation(shift, 0.0, 0.0) * truth(2.0);
        assert!(!motion.admits(&estimate(jump)), "{shift} m");
    }
    let flip = Isometry3::rotation(Vector3::z() * std::f64::consts::PI);
    let mut flipped = truth(2.0);
    flipped.rotation = flip.rotation * flipped.rotation;
    assert!(!motion.admits(&estimate(flipped)));
}
