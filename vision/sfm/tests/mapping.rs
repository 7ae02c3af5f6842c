//! Mapping of synthetic scenes with known truth.

use std::f64::consts::TAU;
use std::sync::Arc;

use nalgebra::{Isometry3, Matrix3, Point3, UnitQuaternion, Vector3};
use rayon::prelude::*;
use volery_estimation::{IntrinsicsRefinement, TwoViewOptions, estimate_two_view_geometry};
use volery_geometry::{Camera, CameraModel};
use volery_scene::{
    CameraId, ImageId, ImagePrior, NoProgress, Point3d, PointId, SparseModel, TwoViewGeometry,
    UnplacedReason, Verdict,
};
use volery_sfm::quality::Evidence;
use volery_sfm::quality::drift::Drift;
use volery_sfm::{
    MapperOptions, ReconstructError, Reconstruction, SfmCamera, SfmImage, reconstruct,
};
use volery_synthetic::{
    CenterMotion, PointOptions, PointScene, Room, along_wall, cam_from_heading, circle,
    paper_camera, ring,
};

fn camera() -> Camera {
    Camera::from_focal(CameraModel::SimpleRadial, 640, 480, 460.0).unwrap()
}

fn options() -> PointOptions {
    PointOptions { num_points: 3000, noise_px: 0.5, wrong_fraction: 0.1, ..PointOptions::default() }
}

fn fixed(camera: Camera) -> SfmCamera {
    SfmCamera { camera, refine: IntrinsicsRefinement::FIXED, focal_is_guess: false }
}

fn images(scene: &PointScene) -> Vec<SfmImage> {
    scene
        .keypoints
        .iter()
        .enumerate()
        .map(|(index, keypoints)| SfmImage {
            id: ImageId(index as u32),
            name: format!("{index:04}.jpg"),
            camera: CameraId(0),
            keypoints: keypoints.clone(),
            colors: vec![[90, 120, 150]; keypoints.len()],
            features: Arc::default(),
            prior: ImagePrior::default(),
        })
        .collect()
}

fn verified(scene: &PointScene, camera: &SfmCamera) -> Vec<TwoViewGeometry> {
    let options =
        TwoViewOptions { calibrated: !camera.focal_is_guess, ..TwoViewOptions::default() };
    scene
        .matches
        .par_iter()
        .filter_map(|(i, j, matches)| {
            estimate_two_view_geometry(
                ImageId(*i as u32),
                &camera.camera,
                &scene.keypoints[*i],
                ImageId(*j as u32),
                &camera.camera,
                &scene.keypoints[*j],
                matches,
                &options,
                (i * 1000 + j) as u64,
            )
        })
        .collect()
}

fn map(scene: &PointScene, camera: SfmCamera) -> Reconstruction {
    let pairs = verified(scene, &camera);
    reconstruct(&images(scene), &[camera], &pairs, &MapperOptions::default(), &NoProgress).unwrap()
}

/// Largest position error, meters, and largest rotation error, degrees, after an alignment that
/// takes the turn from the orientations, so that straight paths have one too.
fn pose_errors(model: &SparseModel, scene: &PointScene) -> (f64, f64) {
    type PosePair = (Isometry3<f64>, Isometry3<f64>);
    let pairs: Vec<PosePair> = model
        .images
        .iter()
        .map(|(id, image)| {
            (image.cam_from_world.inverse(), scene.cam_from_world[id.0 as usize].inverse())
        })
        .collect();
    let sum: Matrix3<f64> = pairs
        .iter()
        .map(|(m, t)| (t.rotation * m.rotation.inverse()).to_rotation_matrix().into_inner())
        .sum();
    let truth_from_model = UnitQuaternion::from_matrix(&sum);
    let n = pairs.len() as f64;
    let mean =
        |f: &dyn Fn(&PosePair) -> Vector3<f64>| pairs.iter().map(f).sum::<Vector3<f64>>() / n;
    let mean_model = mean(&|p| truth_from_model * p.0.translation.vector);
    let mean_truth = mean(&|p| p.1.translation.vector);
    let centered = |p: &PosePair| {
        (
            truth_from_model * p.0.translation.vector - mean_model,
            p.1.translation.vector - mean_truth,
        )
    };
    let dot: f64 = pairs.iter().map(|p| centered(p).0.dot(&centered(p).1)).sum();
    let scale = dot / pairs.iter().map(|p| centered(p).0.norm_squared()).sum::<f64>();
    let position =
        pairs.iter().map(|p| (centered(p).0 * scale - centered(p).1).norm()).fold(0.0, f64::max);
    let rotation = pairs
        .iter()
        .map(|(m, t)| (truth_from_model * m.rotation).angle_to(&t.rotation))
        .fold(0.0, f64::max);
    (position, rotation.to_degrees())
}

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

/// Two right halves put together wrongly have small residuals and every image placed; the verified
/// pairs between them tell.
#[test]
fn wrongly_joined_halves_are_not_called_good() {
    let poses = ring(&Point3::new(0.0, 0.0, 1.5), 1.6, 24, 10);
    let scene = PointScene::observe(&Room::standard(), &camera(), poses, &options(), 10);
    let camera = fixed(camera());
    let pairs = verified(&scene, &camera);
    let found = map(&scene, camera);
    let right = &found.models[0];
    assert_eq!(Evidence::of(right, &pairs).verdict(right, &[camera]).verdict, Verdict::Good);

    for angle in [0.1_f64, 0.5, 2.0] {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), angle);
        let mut wrong = right.clone();
        for (id, image) in &mut wrong.images {
            if id.0 >= 12 {
                image.cam_from_world *= turn.inverse();
            }
        }
        for point in wrong.points.values_mut() {
            // A point follows the half that sees more of it and loses the other half.
            let (late, early): (Vec<_>, Vec<_>) = point.track.iter().partition(|o| o.image.0 >= 12);
            if late.len() > early.len() {
                point.position = turn * point.position;
                point.track = late;
            } else {
                point.track = early;
            }
        }
        for image in wrong.images.values_mut() {
            image.points.fill(None);
        }
        for (&id, point) in &wrong.points {
            for o in &point.track {
                let image = wrong.images.get_mut(&o.image).unwrap();
                image.points[o.keypoint as usize] = Some(id);
            }
        }
        let evidence = Evidence::of(&wrong, &pairs);
        let quality = evidence.verdict(&wrong, &[camera]);
        assert_eq!(quality.verdict, Verdict::Suspect, "{angle}: {evidence:?}");
        let codes: Vec<_> = quality.reasons.iter().map(|r| r.code.as_str()).collect();
        assert!(codes.contains(&"loop_disagreement"), "{codes:?}");
    }
}

/// Two parts that share twenty points hang together by a thread.
#[test]
fn a_thread_between_parts_is_named() {
    let poses = along_wall(&Point3::new(-2.0, -2.0, 1.5), 0.0, 0.3, 12, 11);
    let scene = PointScene::observe(&Room::standard(), &camera(), poses, &options(), 11);
    let found = map(&scene, fixed(camera()));
    let mut model = found.models[0].clone();
    let mut num_across = 0;
    for point in model.points.values_mut() {
        let across =
            point.track.iter().any(|o| o.image.0 < 6) && point.track.iter().any(|o| o.image.0 >= 6);
        if across {
            num_across += 1;
            if num_across > 20 {
                point.track.retain(|o| o.image.0 < 6);
            }
        }
    }
    let evidence = Evidence::of(&model, &[]);
    assert_eq!(evidence.weakest_tie, Some((20, 6)));
    let quality = evidence.verdict(&model, &[fixed(camera())]);
    assert_eq!(quality.verdict, Verdict::Suspect);
    assert_eq!(quality.reasons[0].code, "weakly_tied");
}

/// Steps so wide that hardly a point is in three images leave the scale to drift along the chain,
/// with small residuals everywhere (P34).
#[test]
fn a_chain_without_common_scale_is_not_called_good() {
    let room = Room::standard();
    for (num_views, is_tied) in [(12, false), (24, true)] {
        for seed in 0..3 {
            let poses = circle(&Point3::new(0.3, -0.2, 1.5), 0.5, num_views, seed);
            let scene =
                PointScene::observe(&room, &paper_camera(), poses, &PointOptions::default(), seed);
            let found = map(&scene, fixed(scene.camera));
            let codes: Vec<_> = found.quality.reasons.iter().map(|r| r.code.as_str()).collect();
            assert_eq!(codes.contains(&"weakly_tied"), !is_tied, "{num_views}, {seed}: {codes:?}");
            assert_eq!(found.quality.verdict == Verdict::Good, is_tied, "{num_views}, {seed}");
        }
    }
}

/// A lens no one builds is named.
#[test]
fn absurd_intrinsics_are_named() {
    let poses = along_wall(&Point3::new(-2.0, -2.0, 1.5), 0.0, 0.3, 8, 12);
    let scene = PointScene::observe(&Room::standard(), &camera(), poses, &options(), 12);
    let found = map(&scene, fixed(camera()));
    assert_eq!(found.quality.verdict, Verdict::Good, "{:?}", found.quality);
    for params in
        [[40.0, 320.0, 240.0, 0.0], [4000.0, 320.0, 240.0, 0.0], [460.0, 320.0, 240.0, 3.0]]
    {
        let mut model = found.models[0].clone();
        let absurd = Camera::new(CameraModel::SimpleRadial, 640, 480, &params).unwrap();
        model.cameras.insert(CameraId(0), absurd);
        let guess = SfmCamera { focal_is_guess: true, ..fixed(camera()) };
        let quality = Evidence::of(&model, &[]).verdict(&model, &[guess]);
        assert_eq!(quality.verdict, Verdict::Suspect);
        assert!(quality.reasons.iter().any(|r| r.code == "absurd_intrinsics"), "{params:?}");
    }
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

/// Keypoints with plain noise: the map is as far off as its drift allows. An order of magnitude
/// too wide would be no statement either.
#[test]
fn drift_bounds_the_errors() {
    let scenes = [
        ring(&Point3::new(0.0, 0.0, 1.5), 1.6, 16, 20),
        along_wall(&Point3::new(-2.0, -2.0, 1.5), 0.0, 0.3, 14, 21),
        circle(&Point3::new(0.3, -0.2, 1.5), 0.5, 24, 22),
    ];
    for (seed, poses) in scenes.into_iter().enumerate() {
        let scene =
            PointScene::observe(&Room::standard(), &camera(), poses, &options(), seed as u64);
        let found = map(&scene, fixed(camera()));
        let model = &found.models[0];
        let drift = Drift::of(model);
        let (position, rotation) = pose_errors(model, &scene);
        // The room is 2 to 4 m deep as seen from within.
        let (most, least) = (4.0 * drift.position, 2.0 * drift.position);
        assert!(position < most && position > 0.05 * least, "{seed}: {position}, {drift:?}");
        assert!(rotation.to_radians() < drift.rotation, "{seed}: {rotation} degrees, {drift:?}");
    }
}

/// The same images tied only to their neighbors, and to all others: a chain drifts, and says so.
#[test]
fn a_chain_drifts_more_than_a_net() {
    let poses = ring(&Point3::new(0.0, 0.0, 1.5), 1.6, 40, 23);
    let scene = PointScene::observe(&Room::standard(), &camera(), poses, &options(), 23);
    let net = map(&scene, fixed(camera()));
    let mut model = net.models[0].clone();
    let net = Drift::of(&model);
    // Every point is taken apart into points of three images in a row.
    let points = std::mem::take(&mut model.points);
    for image in model.images.values_mut() {
        image.points.fill(None);
    }
    for point in points.into_values() {
        for track in point.track.chunks(3).filter(|track| track.len() > 1) {
            let id = PointId(model.points.len() as u64);
            model.points.insert(id, Point3d { track: track.to_vec(), ..point.clone() });
        }
    }
    let chain = Drift::of(&model);
    assert!(chain.position > net.position, "{chain:?} against {net:?}");
    assert_eq!(chain, Drift::of(&model), "a verdict is a function of its model");

    // Nothing holds two images without points.
    model.points.clear();
    assert!(Drift::of(&model).position.is_infinite());
}
