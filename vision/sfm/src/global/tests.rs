//! Yaw scans of a room: the paper's capture.

use volery_estimation::{IntrinsicsRefinement, TwoViewOptions, estimate_two_view_geometry};
use volery_geometry::similarity_from_points;
use volery_scene::{CameraId, ImageId, ImagePrior, NoProgress, SparseModel, TwoViewGeometry};
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
        .map(|(index, keypoints)| SfmImage {
            id: ImageId(index as u32),
            name: format!("{index:02}"),
            camera: CameraId(0),
            keypoints: keypoints.clone(),
            colors: vec![[0; 3]; keypoints.len()],
            prior: ImagePrior::default(),
        })
        .collect();
    let cameras = vec![SfmCamera {
        camera: scene.camera,
        refine: IntrinsicsRefinement::FIXED,
        focal_is_guess: false,
    }];
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
        let sum: f64 = found
            .iter()
            .zip(&truth)
            .map(|(f, t)| (truth_from_found * f - t).norm_squared())
            .sum();
        let mut angles: Vec<f64> = model
            .images
            .iter()
            .map(|(id, image)| {
                let rotation =
                    image.cam_from_world.rotation * truth_from_found.isometry.rotation.inverse();
                rotation.angle_to(&self.scene.cam_from_world[id.0 as usize].rotation).to_degrees()
            })
            .collect();
        angles.sort_by(f64::total_cmp);
        ((sum / found.len() as f64).sqrt(), angles[angles.len() / 2])
    }
}

#[test]
fn figures() {
    let cases = [
        ("spin", CenterMotion::Spin),
        ("wobble 2", CenterMotion::Wobble { sigma: 0.02 }),
        ("wobble 3", CenterMotion::Wobble { sigma: 0.03 }),
        ("wobble 5", CenterMotion::Wobble { sigma: 0.05 }),
        ("circle 0.1", CenterMotion::Circle { radius: 0.1 }),
        ("circle 0.3", CenterMotion::Circle { radius: 0.3 }),
        ("circle 1", CenterMotion::Circle { radius: 1.0 }),
    ];
    let seeds: u64 = std::env::var("SEEDS").ok().and_then(|s| s.parse().ok()).unwrap_or(2);
    for (name, motion) in cases {
        for seed in 0..seeds {
            let scan = scan(motion, seed);
            let start = std::time::Instant::now();
            match scan.map() {
                None => println!("{name:12} {seed} none pairs {} {:?}", scan.pairs.len(), start.elapsed()),
                Some(model) => {
                    let (ate, angle) = scan.errors(&model);
                    println!(
                        "{name:12} {seed} {:2}/36 ATE {:.2} cm rot {:.3} deg points {} err {:.2} px pairs {} {:?}",
                        model.images.len(), 100.0 * ate, angle, model.points.len(),
                        model.mean_reprojection_error_px().unwrap_or(0.0), scan.pairs.len(), start.elapsed()
                    );
                }
            }
        }
    }
}
