//! Yaw scans of a room: the paper's capture.

mod graphs;

use nalgebra::UnitQuaternion;
use volery_estimation::{TwoViewOptions, estimate_two_view_geometry};
use volery_geometry::similarity_from_points;
use volery_scene::{ImageId, NoProgress, SparseModel, TwoViewGeometry};
use volery_synthetic::{CenterMotion, PointScene};

use super::map_globally;
use crate::{MapperOptions, SfmCamera, SfmImage};

/// What the mapper gets of a scene.
struct Scan {
    scene: PointScene,
    images: Vec<SfmImage>,
    cameras: Vec<SfmCamera>,
    pairs: Vec<TwoViewGeometry>,
}

fn scan(motion: CenterMotion, seed: u64) -> Scan {
    let scene = PointScene::yaw_scan(36, 10_f64.to_radians(), motion, seed);
    let images = scene
        .keypoints
        .iter()
        .enumerate()
        .map(|(index, keypoints)| SfmImage::from_keypoints(index, keypoints.clone()))
        .collect();
    let cameras = vec![SfmCamera::calibrated(scene.camera)];
    let pairs = scene
        .matches
        .iter()
        .filter_map(|(i, j, matches)| {
            estimate_two_view_geometry(
                ImageId(*i as u32),
                &scene.camera,
                &scene.keypoints[*i],
                ImageId(*j as u32),
                &scene.camera,
                &scene.keypoints[*j],
                matches,
                &TwoViewOptions::default(),
                seed,
            )
        })
        .collect();
    Scan { scene, images, cameras, pairs }
}

impl Scan {
    fn map(&self) -> Option<SparseModel> {
        let start = [self.scene.camera];
        let options = MapperOptions::default();
        map_globally(&self.images, &self.cameras, &start, &self.pairs, &options, &NoProgress)
            .unwrap()
            .into_iter()
            .next()
    }

    /// Root mean square of the center errors, meters, and median rotation error, degrees, after
    /// alignment.
    fn errors(&self, model: &SparseModel) -> (f64, f64) {
        let (mut found, mut truth) = (Vec::new(), Vec::new());
        for (id, image) in &model.images {
            found.push(image.center());
            let cam_from_world = self.scene.cam_from_world[id.0 as usize];
            truth.push(volery_geometry::triangulation::camera_center(&cam_from_world));
        }
        let truth_from_found = similarity_from_points(&found, &truth).unwrap();
        let sum: f64 =
            found.iter().zip(&truth).map(|(f, t)| (truth_from_found * f - t).norm_squared()).sum();
        // The frames of scans in place are aligned by the rotations: the centers hardly tell.
        let true_rotation = |id: &ImageId| self.scene.cam_from_world[id.0 as usize].rotation;
        let frames: Vec<_> = model
            .images
            .iter()
            .map(|(id, image)| true_rotation(id).inverse() * image.cam_from_world.rotation)
            .collect();
        let turns: nalgebra::Vector3<f64> =
            frames.iter().map(|frame| (frames[0].inverse() * frame).scaled_axis()).sum();
        let frame = frames[0] * UnitQuaternion::from_scaled_axis(turns / frames.len() as f64);
        let mut angles: Vec<f64> = model
            .images
            .iter()
            .map(|(id, image)| {
                let aligned = image.cam_from_world.rotation * frame.inverse();
                aligned.angle_to(&true_rotation(id)).to_degrees()
            })
            .collect();
        angles.sort_by(f64::total_cmp);
        ((sum / found.len() as f64).sqrt(), angles[angles.len() / 2])
    }
}

const CASES: [(&str, CenterMotion, f64); 6] = [
    ("wobble 2 cm", CenterMotion::Wobble { sigma: 0.02 }, 0.05),
    ("wobble 3 cm", CenterMotion::Wobble { sigma: 0.03 }, 0.05),
    ("wobble 5 cm", CenterMotion::Wobble { sigma: 0.05 }, 0.05),
    ("circle 10 cm", CenterMotion::Circle { radius: 0.1 }, 0.05),
    ("circle 30 cm", CenterMotion::Circle { radius: 0.3 }, 0.05),
    // Fewest points per image: the best fit to the true points is no closer.
    ("circle 1 m", CenterMotion::Circle { radius: 1.0 }, 0.1),
];

/// P34: a turn in place with centimeters of drift gives every pose within 1 cm.
#[test]
fn yaw_scans_are_mapped() {
    for (name, motion, max_angle_deg) in CASES {
        let scan = scan(motion, 0);
        let model = scan.map().unwrap_or_default();
        assert_eq!(model.images.len(), 36, "{name}");
        let (ate, angle) = scan.errors(&model);
        println!("{name}: ATE {:.2} cm, {angle:.3} deg", 100.0 * ate);
        assert!(ate <= 0.01 && angle <= max_angle_deg, "{name}: {ate} m, {angle} deg");
    }
}

/// P34: a perfect spin has no positions, and none are made up.
#[test]
fn perfect_spin_gives_no_map() {
    assert_eq!(scan(CenterMotion::Spin, 0).map(), None);
}
