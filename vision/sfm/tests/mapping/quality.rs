//! Maps that are wrong are not called good.

use nalgebra::{Point3, UnitQuaternion, Vector3};
use volery_geometry::{Camera, CameraModel};
use volery_scene::{CameraId, Verdict};
use volery_sfm::SfmCamera;
use volery_sfm::quality::Evidence;
use volery_synthetic::{PointOptions, PointScene, Room, along_wall, circle, paper_camera, ring};

use super::observed::{camera, fixed, map, options, verified};

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
