//! What looking for the points of a model in further images adds, against the truth.

use std::{collections::BTreeSet, sync::Arc};

use nalgebra::Point3;
use volery_estimation::{TwoViewOptions, estimate_two_view_geometry};
use volery_geometry::{Camera, CameraModel};
use volery_scene::{Descriptor, Features, ImageId, Keypoint, NoProgress, SparseModel};
use volery_sfm::{MapperOptions, SfmCamera, SfmImage, reconstruct};
use volery_synthetic::{PointOptions, PointScene, Rng, Room, ring};

/// A random look for each point.
fn looks(num_points: usize) -> Vec<Descriptor> {
    let mut rng = Rng::fork(7, 0);
    (0..num_points).map(|_| std::array::from_fn(|_| (rng.uniform() * 60.0) as u8)).collect()
}

/// The keypoints of an image, each with the look of its point, a little changed.
fn features(scene: &PointScene, image: usize, looks: &[Descriptor]) -> Features {
    let mut rng = Rng::fork(11, image as u64);
    let cam_from_world = &scene.cam_from_world[image];
    let mut features = Features::default();
    for (pixel, &point) in scene.keypoints[image].iter().zip(&scene.point_of_keypoint[image]) {
        let depth = (cam_from_world * scene.points[point]).z;
        features.keypoints.push(Keypoint {
            x: pixel.x as f32,
            y: pixel.y as f32,
            scale: (8.0 / depth) as f32,
            orientation: 0.0,
        });
        let changed = |v: u8| (f64::from(v) + 4.0 * rng.normal()).clamp(0.0, 255.0) as u8;
        features.descriptors.push(looks[point].map(changed));
    }
    features
}

/// The model of a ring of 18 images, of whose matches three quarters were not found.
fn model(scene: &PointScene, with_features: bool) -> SparseModel {
    let looks = looks(scene.points.len());
    let pairs: Vec<_> = scene
        .matches
        .iter()
        .filter_map(|(i, j, matches)| {
            let mut rng = Rng::fork(3, (i * 1000 + j) as u64);
            let mut matches = matches.clone();
            matches.retain(|_| rng.chance(0.25));
            estimate_two_view_geometry(
                ImageId(*i as u32),
                &scene.camera,
                &scene.keypoints[*i],
                ImageId(*j as u32),
                &scene.camera,
                &scene.keypoints[*j],
                &matches,
                &TwoViewOptions::default(),
                1,
            )
        })
        .collect();
    let images: Vec<SfmImage> = (0..scene.keypoints.len())
        .map(|index| {
            let image = SfmImage::from_keypoints(index, scene.keypoints[index].clone());
            if with_features {
                SfmImage { features: Arc::new(features(scene, index, &looks)), ..image }
            } else {
                image
            }
        })
        .collect();
    let camera = SfmCamera::calibrated(scene.camera);
    let options = MapperOptions::default();
    let mut found = reconstruct(&images, &[camera], &pairs, &options, &NoProgress).unwrap();
    found.models.swap_remove(0)
}

/// Sightings of the model that show another point than most of their track.
fn num_wrong(model: &SparseModel, scene: &PointScene) -> usize {
    let truth = |o: &volery_scene::Observation| {
        scene.point_of_keypoint[o.image.0 as usize][o.keypoint as usize]
    };
    model
        .points
        .values()
        .map(|point| {
            let same = |a| point.track.iter().filter(|b| truth(b) == a).count();
            let most = point.track.iter().map(|o| same(truth(o))).max().unwrap_or(0);
            point.track.len() - most
        })
        .sum()
}

/// P32: points are found again in images whose matches with the others were missed, right ones
/// only, and no keypoint shows two points.
#[test]
fn points_are_found_in_images_that_were_not_matched() {
    let camera = Camera::from_focal(CameraModel::Pinhole, 640, 480, 460.0).unwrap();
    let poses = ring(&Point3::new(0.0, 0.0, 1.5), 1.6, 18, 1);
    let options =
        PointOptions { num_points: 2500, noise_px: 0.5, wrong_fraction: 0.1, ..Default::default() };
    let scene = PointScene::observe(&Room::standard(), &camera, poses, &options, 1);
    let (without, with) = (model(&scene, false), model(&scene, true));
    assert_eq!((without.images.len(), with.images.len()), (18, 18));
    let (before, after) = (without.num_observations(), with.num_observations());
    assert!(after as f64 > 1.15 * before as f64, "{before} sightings became {after}");
    assert!(with.points.len() < without.points.len(), "no points were merged");

    let (wrong_before, wrong_after) = (num_wrong(&without, &scene), num_wrong(&with, &scene));
    let joined = after - before;
    assert!(
        wrong_after <= wrong_before + joined / 100,
        "{wrong_before} wrong sightings became {wrong_after}; {joined} joined"
    );
    for point in with.points.values() {
        let images: BTreeSet<ImageId> = point.track.iter().map(|o| o.image).collect();
        assert_eq!(images.len(), point.track.len(), "an image shows a point once");
    }
    for (id, image) in &with.images {
        for (keypoint, point) in image.points.iter().enumerate() {
            let num_tracks = with
                .points
                .values()
                .flat_map(|p| &p.track)
                .filter(|o| o.image == *id && o.keypoint as usize == keypoint)
                .count();
            assert!(num_tracks <= 1 && (num_tracks == 1) == point.is_some());
        }
    }
}
