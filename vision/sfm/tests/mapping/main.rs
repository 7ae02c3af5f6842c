//! Mapping of synthetic scenes with known truth.

mod calibration;
mod drift;
mod given_poses;
mod observed;
mod quality;

use std::f64::consts::TAU;

use nalgebra::{Point3, Vector3};
use volery_estimation::IntrinsicsRefinement;
use volery_geometry::{Camera, CameraModel};
use volery_scene::{CameraId, ImageId, NoProgress, UnplacedReason, Verdict};
use volery_sfm::{MapperOptions, ReconstructError, SfmCamera, reconstruct};
use volery_synthetic::{
    CenterMotion, PointOptions, PointScene, Room, along_wall, cam_from_heading, ring,
};

use observed::{camera, fixed, images, map, options, pose_errors, verified};

/// P30, P32, P34: a full ring is registered, closed and right; a tenth of the matches is wrong.
#[test]
fn a_ring_is_mapped_whole() {
    let poses = ring(&Point3::new(0.0, 0.0, 1.5), 1.6, 24, 1);
    let scene = PointScene::observe(&Room::standard(), &camera(), poses, &options(), 1);
    let found = map(&scene, fixed(camera()));
    assert_eq!(found.models[0].images.len(), 24, "{:?}", found.unplaced);
    let (position, rotation) = pose_errors(&found.models[0], &scene);
    assert!(position < 0.005 && rotation < 0.1, "{position} m, {rotation} degrees");
    assert_eq!(found.quality.verdict, Verdict::Good, "{:?}", found.quality.reasons);
    assert!(found.models[0].mean_reprojection_error_px().unwrap() < 0.8);
}

/// A focal length of 1.2 times the width instead of 0.72, and a lens with distortion: both are
/// found.
#[test]
fn an_unknown_camera_is_calibrated() {
    let truth =
        Camera::new(CameraModel::SimpleRadial, 640, 480, &[460.0, 320.0, 240.0, -0.08]).unwrap();
    let poses = ring(&Point3::new(0.0, 0.0, 1.5), 1.6, 24, 2);
    let scene = PointScene::observe(&Room::standard(), &truth, poses, &options(), 2);
    let guess = SfmCamera {
        camera: Camera::from_focal(CameraModel::SimpleRadial, 640, 480, 768.0).unwrap(),
        refine: IntrinsicsRefinement::FOCAL_AND_DISTORTION,
        focal_is_guess: true,
    };
    let found = map(&scene, guess);
    let model = &found.models[0];
    assert_eq!(model.images.len(), 24);
    let params = model.cameras[&CameraId(0)].params().to_vec();
    assert!((params[0] / 460.0 - 1.0).abs() < 0.01, "{params:?}");
    assert!((params[3] + 0.08).abs() < 0.01, "{params:?}");
    let (position, rotation) = pose_errors(model, &scene);
    assert!(position < 0.01 && rotation < 0.2, "{position} m, {rotation} degrees");
    assert_eq!(found.quality.verdict, Verdict::Good, "{:?}", found.quality.reasons);
}

/// Two rooms that share nothing: the larger part is the map, the other a zone.
#[test]
fn two_parts_are_two_models() {
    let near = along_wall(&Point3::new(-2.0, -2.0, 1.5), 0.0, 0.35, 10, 3);
    let far = along_wall(&Point3::new(2.0, 2.0, 1.5), TAU / 2.0, 0.35, 8, 4);
    let poses: Vec<_> = near.into_iter().chain(far).collect();
    let mut scene = PointScene::observe(&Room::standard(), &camera(), poses, &options(), 3);
    scene.matches.retain(|(i, j, _)| (*i < 10) == (*j < 10));
    let found = map(&scene, fixed(camera()));
    assert_eq!(found.models.len(), 2);
    assert_eq!(found.models[0].images.len(), 10);
    assert_eq!(found.models[1].images.len(), 8);
    assert!(found.models[0].images.keys().all(|id| id.0 < 10));
    assert_eq!(found.unplaced.len(), 8);
    assert!(found.unplaced.iter().all(|u| u.reason == UnplacedReason::OtherZone));
    for model in &found.models {
        let (position, rotation) = pose_errors(model, &scene);
        assert!(position < 0.02 && rotation < 0.2, "{position} m, {rotation} degrees");
    }
}

/// P34: a camera that only turns gives no map, and the reason.
#[test]
fn pure_rotation_gives_no_wrong_map() {
    let poses: Vec<_> = (0..24)
        .map(|i| {
            cam_from_heading(&Point3::new(0.3, -0.2, 1.5), TAU / 24.0 * f64::from(i), 0.0, 0.0)
        })
        .collect();
    let scene = PointScene::observe(&Room::standard(), &camera(), poses, &options(), 5);
    let found = map(&scene, fixed(camera()));
    assert_ne!(found.quality.verdict, Verdict::Good);
    assert!(found.models.iter().all(|model| model.images.len() < 3), "{:?}", found.quality);
    assert_eq!(found.quality.verdict, Verdict::Failed);
    assert_eq!(found.quality.reasons[0].code, "no_parallax");
    assert_eq!(found.unplaced.len(), 24);
    assert!(found.unplaced.iter().all(|u| u.reason == UnplacedReason::NoParallax));
}

/// The same with a camera nothing is known of, as phones and drones have them: a guessed focal
/// length lets noise look like depth.
#[test]
fn pure_rotation_of_an_unknown_camera_gives_no_map() {
    for seed in 0..3 {
        let fov = (50.0 + 12.5 * seed as f64).to_radians();
        let focal = 320.0 / (0.5 * fov).tan();
        let truth = Camera::from_focal(CameraModel::SimpleRadial, 640, 480, focal).unwrap();
        let poses: Vec<_> = (0..30)
            .map(|i| {
                let tilt = 0.1 * f64::from(i % 3) - 0.1;
                cam_from_heading(&Point3::new(0.3, -0.2, 1.5), 0.2 * f64::from(i), tilt, 0.0)
            })
            .collect();
        let scene = PointScene::observe(&Room::standard(), &truth, poses, &options(), seed);
        let guess = SfmCamera {
            camera: Camera::from_focal(CameraModel::SimpleRadial, 640, 480, 768.0).unwrap(),
            refine: IntrinsicsRefinement::FOCAL_AND_DISTORTION,
            focal_is_guess: true,
        };
        let found = map(&scene, guess);
        assert!(found.models.is_empty(), "{seed}: {:?}", found.quality);
        assert_eq!(found.quality.verdict, Verdict::Failed);
        assert_eq!(found.quality.reasons[0].code, "no_parallax", "{seed}");
    }
}

/// P34: the paper's scan, turning in place while the drone wobbles by 5 cm.
#[test]
fn a_wobbling_scan_is_mapped() {
    let scene = PointScene::yaw_scan(36, TAU / 36.0, CenterMotion::Wobble { sigma: 0.05 }, 7);
    let found = map(&scene, fixed(scene.camera));
    assert_eq!(found.quality.verdict, Verdict::Good, "{:?}", found.quality);
    assert_eq!(found.models[0].images.len(), 36);
    let (position, rotation) = pose_errors(&found.models[0], &scene);
    assert!(position < 0.01 && rotation < 0.1, "{position} m, {rotation} degrees");
}

#[test]
fn strangers_share_no_map() {
    let poses = vec![
        cam_from_heading(&Point3::new(0.0, 0.0, 1.5), 0.0, 0.0, 0.0),
        cam_from_heading(&Point3::new(0.5, 0.0, 1.5), TAU / 2.0, 0.0, 0.0),
    ];
    let scene = PointScene::observe(&Room::standard(), &camera(), poses, &options(), 6);
    let found = map(&scene, fixed(camera()));
    assert!(found.models.is_empty());
    assert_eq!(found.quality.verdict, Verdict::Failed);
    assert_eq!(found.quality.reasons[0].code, "no_overlap");
    assert!(found.unplaced.iter().all(|u| u.reason == UnplacedReason::NoOverlap));
    assert_eq!(found.unplaced.len(), 2);
}

/// Half of all matches wrong: fewer points, the same poses.
#[test]
fn wrong_matches_do_not_bend_the_map() {
    let poses = along_wall(&Point3::new(-2.0, -2.0, 1.5), 0.0, 0.3, 12, 8);
    let wrong = PointOptions { wrong_fraction: 0.5, ..options() };
    let scene = PointScene::observe(&Room::standard(), &camera(), poses, &wrong, 8);
    let found = map(&scene, fixed(camera()));
    assert_eq!(found.models[0].images.len(), 12);
    let (position, rotation) = pose_errors(&found.models[0], &scene);
    assert!(position < 0.02 && rotation < 0.2, "{position} m, {rotation} degrees");
}

/// The same bits for one thread and for many, and again.
#[test]
fn threads_do_not_matter() {
    let poses = ring(&Point3::new(0.0, 0.0, 1.5), 1.6, 16, 9);
    let scene = PointScene::observe(&Room::standard(), &camera(), poses, &options(), 9);
    let with_threads = |n: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
        pool.install(|| map(&scene, fixed(camera())))
    };
    let one = with_threads(1);
    assert!(one == with_threads(3), "three threads");
    assert!(one == with_threads(1), "again");
    let offset: Vector3<f64> = one.models[0].images[&ImageId(3)].center().coords;
    assert!(offset.iter().all(|v| v.is_finite()));
}

/// Nonsense is refused or left out, never a panic.
#[test]
fn nonsense_is_refused() {
    let poses = along_wall(&Point3::new(-2.0, -2.0, 1.5), 0.0, 0.3, 6, 13);
    let scene = PointScene::observe(&Room::standard(), &camera(), poses, &options(), 13);
    let known = fixed(camera());
    let mut pairs = verified(&scene, &known);
    let mut images = images(&scene);
    let options = MapperOptions::default();
    let one = reconstruct(&images[..1], &[known], &[], &options, &NoProgress);
    assert!(matches!(one, Err(ReconstructError::TooFewImages { got: 1 })));
    let none = reconstruct(&images, &[], &pairs, &options, &NoProgress);
    assert!(matches!(none, Err(ReconstructError::UnknownCamera { .. })));

    images[2].keypoints[5].x = f64::NAN;
    pairs[0].matches[0].feature1 = 1_000_000;
    let mut stranger = pairs[1].clone();
    stranger.image2 = ImageId(77);
    pairs.push(stranger);
    let found = reconstruct(&images, &[known], &pairs, &options, &NoProgress).unwrap();
    assert_eq!(found.models[0].images.len(), 6);
    let (position, _) = pose_errors(&found.models[0], &scene);
    assert!(position < 0.02);
}
