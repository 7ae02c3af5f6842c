//! A rendered flight along the racks of a hall, and what may befall it.

#[path = "../../localization/tests/support/mod.rs"]
mod support;

use std::cell::Cell;
use std::sync::LazyLock;
use std::time::Duration;

use nalgebra::{Isometry3, Point3, Vector3, Vector6};
use support::{PosedFeatures, index, triangulate};
use volery_features::{SiftOptions, detect_and_describe};
use volery_geometry::{Camera, CameraModel};
use volery_localization::LocalizationIndex;
use volery_scene::GrayImage;
use volery_synthetic::{Hall, Renderer, Sensor, along_wall, cam_from_heading};
use volery_tracking::{
    Frame, FrameFault, Telemetry, TrackAnswer, TrackProblem, TrackState, Tracker, TrackerOptions,
};

const NUM_FRAMES: usize = 45;
const STEP: Duration = Duration::from_millis(100);

/// A frame with its true pose, if it shows the hall of the map.
#[derive(Clone)]
struct Shot {
    image: GrayImage,
    truth: Option<Isometry3<f64>>,
}

struct Stage {
    camera: Camera,
    index: LocalizationIndex,
    flight: Vec<Shot>,
    other_hall: Vec<Shot>,
}

fn camera() -> Camera {
    Camera::new(CameraModel::Pinhole, 320, 240, &[231.0, 231.0, 160.0, 120.0]).unwrap()
}

fn hall(seed: u64) -> Hall {
    Hall::furnished(Vector3::new(8.0, 6.0, 3.2), 0.006, seed)
}

fn photo(renderer: &Renderer, hall: &Hall, cam_from_world: &Isometry3<f64>, seed: u64) -> Shot {
    let image = Sensor::default().expose(&renderer.render(hall, cam_from_world), seed).gray();
    Shot { image, truth: Some(cam_from_world.inverse()) }
}

/// Sideways along the racks, swaying and turning.
fn flown(time_s: f64) -> Isometry3<f64> {
    let place = Point3::new(
        -1.6 + 0.7 * time_s,
        0.9 + 0.15 * (1.3 * time_s).sin(),
        1.55 + 0.1 * (0.9 * time_s).sin(),
    );
    let yaw = 0.25 * (1.1 * time_s).sin();
    cam_from_heading(&place, yaw, 0.02 * (2.0 * time_s).sin(), 0.02 * (2.3 * time_s).cos())
}

/// The map is triangulated at true poses: tracking is judged alone.
static STAGE: LazyLock<Stage> = LazyLock::new(|| {
    let camera = camera();
    let renderer = Renderer::new(&camera);
    let [hall, other] = [5, 77].map(hall);
    let mut scan = Vec::new();
    for (height, distance) in [(1.35, 0.6), (1.75, 0.8)] {
        scan.extend(along_wall(&Point3::new(-2.2, distance, height), 0.0, 0.5, 10, 3));
    }
    let images: Vec<PosedFeatures> = scan
        .iter()
        .enumerate()
        .map(|(k, pose)| {
            let shot = photo(&renderer, &hall, pose, k as u64);
            let features = detect_and_describe(&shot.image, &SiftOptions::default());
            PosedFeatures { name: format!("{k}"), cam_from_world: *pose, features }
        })
        .collect();
    let fly = |hall: &Hall, count: usize| -> Vec<Shot> {
        let pose = |k: usize| flown(k as f64 * STEP.as_secs_f64());
        (0..count).map(|k| photo(&renderer, hall, &pose(k), 1000 + k as u64)).collect()
    };
    let mut other_hall = fly(&other, 15);
    other_hall.iter_mut().for_each(|shot| shot.truth = None);
    let index = index(&images, &triangulate(&images, &camera, 2.0));
    Stage { camera, index, flight: fly(&hall, NUM_FRAMES), other_hall }
});

fn track(stage: &Stage, shots: &[Shot], telemetry: Telemetry) -> Vec<TrackAnswer> {
    let mut tracker = Tracker::new(&stage.camera, &TrackerOptions::default());
    let answer = |(k, shot): (usize, &Shot)| {
        let frame = Frame { image: &shot.image, capture_time: STEP * (k as u32 + 7), telemetry };
        let answer = tracker.track(&frame, &stage.index, &|| 0.0);
        tracker.catch_up(&stage.index, false);
        answer
    };
    shots.iter().enumerate().map(answer).collect()
}

/// Position, then rotation about the axes of the map.
fn error(answer: &TrackAnswer, truth: &Isometry3<f64>) -> Option<Vector6<f64>> {
    let found = answer.pose.as_ref()?.map_from_camera;
    let shift = found.translation.vector - truth.translation.vector;
    let turn = (found.rotation * truth.rotation.inverse()).scaled_axis();
    Some(Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z))
}

/// Poses are where they say and only of frames that show the hall; pose and state agree.
fn assert_true(shots: &[Shot], answers: &[TrackAnswer]) {
    for (k, (shot, answer)) in shots.iter().zip(answers).enumerate() {
        assert_eq!(answer.pose.is_some(), answer.state == TrackState::Tracking, "frame {k}");
        assert_eq!(answer.pose.is_some(), answer.problem.is_none(), "frame {k}");
        let Some(pose) = &answer.pose else { continue };
        let truth = shot.truth.unwrap_or_else(|| panic!("frame {k} shows no place: {pose:?}"));
        let error = error(answer, &truth).unwrap();
        let (shift, turn) = (error.fixed_rows::<3>(0).norm(), error.fixed_rows::<3>(3).norm());
        assert!(shift < 0.05 && turn < 0.0175, "frame {k}: {shift} m, {turn} rad");
        let squared = error.dot(&(pose.covariance.try_inverse().unwrap() * error));
        assert!(squared < 45.0, "frame {k}: squared error {squared} in deviations");
    }
}

fn first_pose_from(answers: &[TrackAnswer], from: usize) -> usize {
    let after = answers[from..].iter().position(|a| a.state == TrackState::Tracking);
    from + after.expect("it is found again")
}

fn black() -> Shot {
    Shot { image: GrayImage::new(320, 240, vec![3; 320 * 240]).unwrap(), truth: None }
}

/// From the third frame on every frame has a pose; errors are as stated.
#[test]
fn a_flight_is_followed() {
    let answers = track(&STAGE, &STAGE.flight, Telemetry::default());
    assert_true(&STAGE.flight, &answers);
    let problems: Vec<_> = answers.iter().map(|a| a.problem).collect();
    assert_eq!(problems[..2], [Some(TrackProblem::Unconfirmed); 2]);
    assert!(problems[2..].iter().all(Option::is_none), "{problems:?}");
    assert!(answers.iter().all(|a| a.reset_counter == 0));
    let squared = answers.iter().zip(&STAGE.flight).filter_map(|(answer, shot)| {
        let error = error(answer, &shot.truth?)?;
        Some(error.dot(&(answer.pose.as_ref()?.covariance.try_inverse()? * error)))
    });
    let mean = squared.sum::<f64>() / (NUM_FRAMES - 2) as f64;
    assert!((2.0..12.0).contains(&mean), "six would be exact: {mean}");
}

#[test]
fn the_same_frames_give_the_same_poses() {
    let shots = &STAGE.flight[..14];
    let runs = [0, 1].map(|_| track(&STAGE, shots, Telemetry::default()));
    assert_eq!(runs[0], runs[1]);
}

/// The light halves and doubles from frame to frame.
#[test]
fn light_does_not_matter() {
    let mut shots = STAGE.flight[..20].to_vec();
    for (k, shot) in shots.iter_mut().enumerate() {
        let gain = [1.0, 0.75, 0.5, 0.6][k % 4];
        let pixels = shot.image.pixels().iter().map(|&v| (f64::from(v) * gain + 12.0) as u8);
        shot.image = GrayImage::new(320, 240, pixels.collect()).unwrap();
    }
    let answers = track(&STAGE, &shots, Telemetry::default());
    assert_true(&shots, &answers);
    assert!(answers[2..].iter().all(|a| a.pose.is_some()));
}

/// Frames without a picture have no pose, whatever is known of the motion; after 0.6 s and after
/// 1.3 s of them the pose is back within half a second.
#[test]
fn a_blackout_is_survived() {
    for length in [6, 13] {
        let mut shots = STAGE.flight.clone();
        shots[15..15 + length].fill(black());
        let answers = track(&STAGE, &shots, Telemetry::default());
        assert_true(&shots, &answers);
        for answer in &answers[16..15 + length] {
            assert_eq!(answer.problem, Some(TrackProblem::Frame));
            // The second black frame equals the first.
            assert!(matches!(answer.fault, Some(FrameFault::NoContrast | FrameFault::Frozen)));
        }
        let is_lost = answers[15 + length - 1].state == TrackState::Lost;
        assert_eq!(is_lost, length > 10, "lost after a second");
        let found = first_pose_from(&answers, 15 + length);
        assert!(found <= 15 + length + 4, "{found}");
    }
}

/// Carried 1.7 m within a frame: three fixes must agree, then the counter tells of the jump.
#[test]
fn a_kidnapped_camera_is_found_with_a_reset() {
    let mut shots = STAGE.flight[..12].to_vec();
    shots.extend_from_slice(&STAGE.flight[36..]);
    let answers = track(&STAGE, &shots, Telemetry::default());
    assert_true(&shots, &answers);
    assert_eq!(answers[11].reset_counter, 0);
    let found = first_pose_from(&answers, 12);
    assert!((14..=16).contains(&found), "{found}");
    assert_eq!(answers[found].reset_counter, 1);
    assert_eq!(answers.last().unwrap().reset_counter, 1);
}

#[test]
fn another_hall_is_not_this_one() {
    let mut shots = STAGE.flight[..10].to_vec();
    shots.extend_from_slice(&STAGE.other_hall);
    shots.extend_from_slice(&STAGE.flight[25..32]);
    let answers = track(&STAGE, &shots, Telemetry::default());
    assert_true(&shots, &answers);
    assert_eq!(answers[24].state, TrackState::Lost);
    let found = first_pose_from(&answers, 25);
    assert!(found <= 29, "{found}");
}

#[test]
fn what_is_no_new_frame_has_no_pose() {
    let mut tracker = Tracker::new(&STAGE.camera, &TrackerOptions::default());
    let mut ask = |image: &GrayImage, millis: u64| {
        let capture_time = Duration::from_millis(millis);
        let frame = Frame { image, capture_time, telemetry: Telemetry::default() };
        let answer = tracker.track(&frame, &STAGE.index, &|| 0.0);
        tracker.catch_up(&STAGE.index, false);
        answer
    };
    for (k, shot) in STAGE.flight[..4].iter().enumerate() {
        ask(&shot.image, 100 * k as u64);
    }
    let (still, next) = (&STAGE.flight[3].image, &STAGE.flight[4].image);
    let frozen = ask(still, 400);
    assert_eq!((frozen.fault, frozen.pose), (Some(FrameFault::Frozen), None));
    let early = ask(next, 300);
    assert_eq!((early.fault, early.pose), (Some(FrameFault::OutOfOrder), None));
    let small = GrayImage::new(160, 120, vec![9; 160 * 120]).unwrap();
    let small = ask(&small, 450);
    assert_eq!((small.fault, small.pose), (Some(FrameFault::WrongSize), None));
    let after = ask(&STAGE.flight[5].image, 500);
    assert_eq!(after.state, TrackState::Tracking);
    // A second later it is lost, not where it was.
    for k in 6..18 {
        let answer = ask(&STAGE.flight[5].image, 100 * k);
        assert!(answer.pose.is_none());
        assert_eq!(answer.state == TrackState::Lost, k >= 15, "{k}");
    }
}

/// Turning on the spot by 45 degrees a second, also while others wait: once followed, no frame has
/// to look for features before its answer.
#[test]
fn a_turn_is_followed() {
    let renderer = Renderer::new(&STAGE.camera);
    let hall = hall(5);
    let place = Point3::new(0.0, 0.9, 1.55);
    let shots: Vec<Shot> = (0..18)
        .map(|k| {
            let yaw = -0.5 + 0.0785 * f64::from((k - 4).max(0));
            photo(&renderer, &hall, &cam_from_heading(&place, yaw, 0.0, 0.0), 2000 + k as u64)
        })
        .collect();
    for is_hurried in [false, true] {
        let mut tracker = Tracker::new(&STAGE.camera, &TrackerOptions::default());
        let seconds = Cell::new(0.0);
        let clock = || {
            seconds.set(seconds.get() + 1.0);
            seconds.get()
        };
        let mut answers = Vec::new();
        for (k, shot) in shots.iter().enumerate() {
            let capture_time = STEP * (k as u32 + 7);
            let telemetry = Telemetry::default();
            let frame = Frame { image: &shot.image, capture_time, telemetry };
            answers.push(tracker.track(&frame, &STAGE.index, &clock));
            tracker.catch_up(&STAGE.index, is_hurried);
        }
        assert_true(&shots, &answers);
        let is_quick = |a: &TrackAnswer| a.pose.is_some() && a.timings.features_ms == 0.0;
        assert!(answers[3..].iter().all(is_quick), "{answers:?}");
    }
}
