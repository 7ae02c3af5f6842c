//! How far maps may have drifted.

use nalgebra::{Point3, Vector3};
use volery_scene::{CameraId, ImageId, Observation, Point3d, PointId};
use volery_sfm::quality::drift::Drift;
use volery_synthetic::{PointScene, Room, along_wall, circle, ring};

use super::observed::{camera, fixed, map, options, pose_errors};

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

/// Wrong matches of two images put points next to a camera's center, where Jacobians are huge. What
/// they say of the poses is next to nothing, and must not drown what the others say.
#[test]
fn a_point_at_a_camera_changes_nothing() {
    let poses = ring(&Point3::new(0.0, 0.0, 1.5), 1.6, 40, 24);
    let scene = PointScene::observe(&Room::standard(), &camera(), poses, &options(), 24);
    let mut model = map(&scene, fixed(camera())).models.swap_remove(0);
    let before = Drift::of(&model);
    let ids: Vec<ImageId> = model.images.keys().copied().collect();
    let (near, far) = (ids[0], ids[1]);
    let center = model.images[&near].center();
    let toward_far = model.images[&far].center() - center;
    for factor in [1e-2, 1e-3, 3e-4, 1e-5, 1e-6] {
        // A little in front of the one camera; the other looks where it must.
        let forward = model.images[&near].cam_from_world.inverse() * (Vector3::z() * factor);
        let position = center + forward + toward_far * (0.1 * factor);
        let id = PointId(1_000_000 + model.points.len() as u64);
        let mut track = Vec::new();
        for image in [near, far] {
            let camera = model.cameras[&CameraId(0)];
            let image_of = model.images.get_mut(&image).unwrap();
            let in_cam = image_of.cam_from_world * position;
            let Some(pixel) = camera.project(&in_cam) else { continue };
            track.push(Observation { image, keypoint: image_of.keypoints.len() as u32 });
            image_of.keypoints.push(pixel);
            image_of.points.push(Some(id));
        }
        assert_eq!(track.len(), 2, "both cameras see it");
        let any = model.points.values().next().unwrap().clone();
        model.points.insert(id, Point3d { position, track, ..any });
    }
    let after = Drift::of(&model);
    assert!((after.position / before.position - 1.0).abs() < 0.1, "{before:?}, {after:?}");
    assert!((after.rotation / before.rotation - 1.0).abs() < 0.1, "{before:?}, {after:?}");
}
