//! Points for poses that are given.

use nalgebra::{Isometry3, Point3, Translation3, Vector3};
use volery_scene::{ImageId, NoProgress, UnplacedImage, UnplacedReason, Verdict};
use volery_sfm::{MapperOptions, Reconstruction, SfmImage, reconstruct};
use volery_synthetic::{PointScene, Room, ring};

use crate::observed::{camera, fixed, images, options, verified};

fn scene() -> PointScene {
    let poses = ring(&Point3::new(0.0, 0.0, 1.5), 1.6, 16, 1);
    PointScene::observe(&Room::standard(), &camera(), poses, &options(), 1)
}

/// The images of a scene with their true poses, in a world that is turned and moved.
fn posed(scene: &PointScene, true_from_world: &Isometry3<f64>) -> Vec<SfmImage> {
    let mut posed = images(scene);
    for (image, cam_from_true) in posed.iter_mut().zip(&scene.cam_from_world) {
        image.prior.pose = Some(cam_from_true * true_from_world);
    }
    posed
}

fn map(scene: &PointScene, posed: &[SfmImage]) -> Reconstruction {
    let options = MapperOptions { poses_are_given: true, ..MapperOptions::default() };
    let pairs = verified(scene, &fixed(camera()));
    reconstruct(posed, &[fixed(camera())], &pairs, &options, &NoProgress).unwrap()
}

/// Poses come out as they went in, to the bit; the points lie where they should. An image without
/// a pose is told, not guessed.
#[test]
fn points_are_found_and_poses_stay() {
    let scene = scene();
    let turn = Isometry3::new(Vector3::new(3.0, -7.0, 2.0), Vector3::new(0.4, 1.0, -0.3));
    let mut given = posed(&scene, &turn);
    given[5].prior.pose = None;
    let found = map(&scene, &given);
    let model = &found.models[0];
    assert_eq!((found.mapper, model.images.len()), ("given", 15));
    let left_out = UnplacedImage { image: ImageId(5), reason: UnplacedReason::NoGivenPose };
    assert_eq!(found.unplaced, [left_out]);
    for (id, image) in &model.images {
        assert_eq!(Some(image.cam_from_world), given[id.0 as usize].prior.pose);
    }
    assert_eq!(found.quality.verdict, Verdict::Good, "{:?}", found.quality.reasons);
    assert!(model.points.len() > 500, "{}", model.points.len());
    // A point stands where it is seen to less than the noise of one sighting.
    let mut errors: Vec<f64> = Vec::new();
    for point in model.points.values() {
        let first = point.track[0];
        let truly = scene.point_of_keypoint[first.image.0 as usize][first.keypoint as usize];
        for sighting in &point.track {
            let pose = model.images[&sighting.image].cam_from_world;
            let [seen, true_pixel] = [point.position, turn.inverse() * scene.points[truly]]
                .map(|point| camera().project(&(pose * point)));
            errors.extend(seen.zip(true_pixel).map(|(a, b)| (a - b).norm()));
        }
    }
    errors.sort_by(f64::total_cmp);
    assert!(errors[errors.len() / 2] < 0.5, "{} px", errors[errors.len() / 2]);
}

/// Poses that the photos contradict make no good map.
#[test]
fn wrong_poses_are_not_believed_silently() {
    let scene = scene();
    let mut given = posed(&scene, &Isometry3::identity());
    for image in given.iter_mut().take(8) {
        let aside = Isometry3::from_parts(
            Translation3::new(0.3, 0.0, 0.0),
            nalgebra::UnitQuaternion::from_euler_angles(0.0, 0.1, 0.0),
        );
        image.prior.pose = image.prior.pose.map(|pose| aside * pose);
    }
    let found = map(&scene, &given);
    assert_ne!(found.quality.verdict, Verdict::Good);
}
