//! A map triangulated at true poses, so that localization is judged alone.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Point2, Point3, Vector2, Vector3};
use volery_features::{MatchOptions, PackedDescriptors, global_descriptor, match_features};
use volery_geometry::Camera;
use volery_geometry::epipolar::{
    essential_from_pose, fundamental_from_essential, squared_sampson_error,
};
use volery_geometry::triangulation::{camera_center, triangulate_linear, triangulation_angle};
use volery_localization::LocalizationIndex;
use volery_scene::{
    CameraId, Features, ImageId, Observation, Point3d, PointId, RegisteredImage, SparseModel,
};

/// An image of known pose with its features.
pub(crate) struct PosedFeatures {
    pub(crate) name: String,
    pub(crate) cam_from_world: Isometry3<f64>,
    pub(crate) features: Features,
}

const MIN_ANGLE_DEG: f64 = 1.5;

/// Matches all pairs, keeps what agrees with the poses within `max_error_px`, triangulates the
/// tracks.
pub(crate) fn triangulate(
    images: &[PosedFeatures],
    camera: &Camera,
    max_error_px: f64,
) -> SparseModel {
    let packed: Vec<PackedDescriptors> =
        images.iter().map(|image| PackedDescriptors::new(&image.features.descriptors)).collect();
    let mut tracks = Tracks::default();
    for i in 0..images.len() {
        for j in i + 1..images.len() {
            let pose = images[j].cam_from_world * images[i].cam_from_world.inverse();
            // Views that look apart share nothing; turning alone gives no depth.
            let forward = |k: usize| images[k].cam_from_world.rotation.inverse() * Vector3::z();
            if forward(i).dot(&forward(j)) < 0.2 || pose.translation.vector.norm() < 1e-6 {
                continue;
            }
            let essential = essential_from_pose(&pose);
            let f = fundamental_from_essential(&essential, camera, camera).expect("invertible");
            for m in match_features(&packed[i], &packed[j], &MatchOptions::default()) {
                let pixel = |image: usize, feature: u32| {
                    let keypoint = &images[image].features.keypoints[feature as usize];
                    undistorted(camera, &keypoint.pixel())
                };
                let (Some(x1), Some(x2)) = (pixel(i, m.feature1), pixel(j, m.feature2)) else {
                    continue;
                };
                if squared_sampson_error(&f, &x1, &x2) < max_error_px * max_error_px {
                    tracks.join((i as u32, m.feature1), (j as u32, m.feature2));
                }
            }
        }
    }
    model(images, camera, tracks, max_error_px)
}

pub(crate) fn index(images: &[PosedFeatures], model: &SparseModel) -> LocalizationIndex {
    let descriptors: Vec<_> = images.iter().map(|i| i.features.descriptors.clone()).collect();
    let globals: Vec<_> = images.iter().map(|i| global_descriptor(&i.features)).collect();
    LocalizationIndex::new(model, &descriptors, &globals)
}

fn undistorted(camera: &Camera, pixel: &Point2<f64>) -> Option<Point2<f64>> {
    let xy = camera.unproject(pixel)?;
    let k = camera.calibration_matrix();
    Some(Point2::from((k * xy.push(1.0)).xy()))
}

/// Union-find over features.
#[derive(Default)]
struct Tracks {
    parent: BTreeMap<(u32, u32), (u32, u32)>,
}

impl Tracks {
    fn root(&mut self, node: (u32, u32)) -> (u32, u32) {
        let parent = *self.parent.entry(node).or_insert(node);
        if parent == node {
            return node;
        }
        let root = self.root(parent);
        self.parent.insert(node, root);
        root
    }

    fn join(&mut self, a: (u32, u32), b: (u32, u32)) {
        let (a, b) = (self.root(a), self.root(b));
        self.parent.insert(a.max(b), a.min(b));
    }
}

fn model(
    images: &[PosedFeatures],
    camera: &Camera,
    mut tracks: Tracks,
    max_error_px: f64,
) -> SparseModel {
    let mut sets: BTreeMap<(u32, u32), Vec<(u32, u32)>> = BTreeMap::new();
    for node in tracks.parent.keys().copied().collect::<Vec<_>>() {
        sets.entry(tracks.root(node)).or_default().push(node);
    }
    let mut model = SparseModel::default();
    model.cameras.insert(CameraId(0), *camera);
    for (id, image) in images.iter().enumerate() {
        let registered = RegisteredImage {
            name: image.name.clone(),
            camera: CameraId(0),
            cam_from_world: image.cam_from_world,
            keypoints: image.features.keypoints.iter().map(|k| k.pixel()).collect(),
            points: vec![None; image.features.len()],
        };
        model.images.insert(ImageId(id as u32), registered);
    }
    for (number, track) in sets.into_values().enumerate() {
        let id = PointId(number as u64);
        let Some(point) = point(images, camera, track, max_error_px) else { continue };
        for observation in &point.track {
            let image = model.images.get_mut(&observation.image).expect("it is there");
            image.points[observation.keypoint as usize] = Some(id);
        }
        model.points.insert(id, point);
    }
    model
}

fn point(
    images: &[PosedFeatures],
    camera: &Camera,
    mut track: Vec<(u32, u32)>,
    max_error_px: f64,
) -> Option<Point3d> {
    // An image that comes twice contradicts itself.
    track.dedup_by_key(|node| node.0);
    loop {
        if track.len() < 2 {
            return None;
        }
        let poses: Vec<Isometry3<f64>> =
            track.iter().map(|&(i, _)| images[i as usize].cam_from_world).collect();
        let pixel =
            |&(i, f): &(u32, u32)| images[i as usize].features.keypoints[f as usize].pixel();
        let xy: Option<Vec<Vector2<f64>>> =
            track.iter().map(|node| camera.unproject(&pixel(node))).collect();
        let position = triangulate_linear(&poses, &xy?)?;
        let error = |k: usize| {
            let projected = camera.project(&(poses[k] * position));
            projected.map_or(f64::INFINITY, |p| (p - pixel(&track[k])).norm())
        };
        let errors: Vec<f64> = (0..track.len()).map(error).collect();
        let worst = (0..track.len()).max_by(|&a, &b| errors[a].total_cmp(&errors[b]))?;
        if errors[worst] > max_error_px {
            track.remove(worst);
            continue;
        }
        if widest_angle(&poses, &position) < MIN_ANGLE_DEG.to_radians() {
            return None;
        }
        return Some(Point3d {
            position,
            color: [128; 3],
            error_px: errors.iter().sum::<f64>() / errors.len() as f64,
            track: track
                .iter()
                .map(|&(image, keypoint)| Observation { image: ImageId(image), keypoint })
                .collect(),
        });
    }
}

fn widest_angle(poses: &[Isometry3<f64>], point: &Point3<f64>) -> f64 {
    let centers: Vec<Point3<f64>> = poses.iter().map(camera_center).collect();
    let mut widest = 0.0_f64;
    for (i, a) in centers.iter().enumerate() {
        for b in &centers[..i] {
            widest = widest.max(triangulation_angle(a, b, point));
        }
    }
    widest
}
