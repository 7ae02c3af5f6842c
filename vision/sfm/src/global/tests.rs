//! Yaw scans of a room: the paper's capture.

use nalgebra::UnitQuaternion;
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
                None => println!(
                    "{name:12} {seed} none pairs {} {:?}",
                    scan.pairs.len(),
                    start.elapsed()
                ),
                Some(model) => {
                    let (ate, angle) = scan.errors(&model);
                    println!(
                        "{name:12} {seed} {:2}/36 ATE {:.2} cm rot {:.3} deg points {} err {:.2} px pairs {} {:?}",
                        model.images.len(),
                        100.0 * ate,
                        angle,
                        model.points.len(),
                        model.mean_reprojection_error_px().unwrap_or(0.0),
                        scan.pairs.len(),
                        start.elapsed()
                    );
                }
            }
        }
    }
}

#[test]
fn debug() {
for (name, motion, seed) in [("w2", CenterMotion::Wobble { sigma: 0.02 }, 3), ("w2", CenterMotion::Wobble { sigma: 0.02 }, 0), ("c1", CenterMotion::Circle { radius: 1.0 }, 0), ("c1", CenterMotion::Circle { radius: 1.0 }, 1), ("spin", CenterMotion::Spin, 0)] {
        {
            let scan = scan(motion, seed);
            let kinds: Vec<usize> = [
                volery_scene::TwoViewKind::General,
                volery_scene::TwoViewKind::Planar,
                volery_scene::TwoViewKind::RotationOnly,
                volery_scene::TwoViewKind::Uncalibrated,
            ]
            .iter()
            .map(|k| scan.pairs.iter().filter(|p| p.kind == *k).count())
            .collect();
            let (mut bad, mut all) = (0, 0);
            let mut errs: Vec<f64> = Vec::new();
            for p in &scan.pairs {
                let (i, j) = (p.image1.0 as usize, p.image2.0 as usize);
                for m in &p.matches {
                    all += 1;
                    bad += usize::from(!scan.scene.is_true_match(i, j, m));
                }
                let truth = scan.scene.cam_from_world[j].rotation
                    * scan.scene.cam_from_world[i].rotation.inverse();
                errs.push(p.cam2_from_cam1.unwrap().rotation.angle_to(&truth).to_degrees());
            }
            errs.sort_by(f64::total_cmp);
            println!(
                "CASE {name} {seed} kinds G/P/R/U {kinds:?} bad {bad}/{all} pair rot err median {:.3} p90 {:.3} max {:.3}",
                errs[errs.len() / 2],
                errs[errs.len() * 9 / 10],
                errs[errs.len() - 1]
            );
            let options = MapperOptions { min_angle: super::MIN_ANGLE, ..MapperOptions::default() };
            let input = crate::incremental::Input {
                images: &scan.images,
                cameras: &scan.cameras,
                pairs: &scan.pairs,
                options: &options,
            };
            let tracks = crate::tracks::build_tracks(&scan.images, &scan.pairs);
            let make = || {
                crate::incremental::WorkingModel::new(
                    input,
                    vec![scan.scene.camera],
                    &tracks,
                    vec![true; 36],
                )
            };
            let report = |what: &str, model: &crate::incremental::WorkingModel<'_>| {
                let sparse = model.to_sparse();
                let (ate, angle) = scan.errors(&sparse);
                println!(
                    "  {what:10} images {} ATE {:.2} cm rot {:.3} points {} err {:.3} obs {} parallax/noise {:.1}",
                    sparse.images.len(),
                    100.0 * ate,
                    angle,
                    sparse.points.len(),
                    sparse.mean_reprojection_error_px().unwrap_or(0.0),
                    sparse.num_observations(),
                    super::parallax::parallax_to_noise(model).unwrap_or(0.0)
                );
            };
            let mut truth = make();
            for i in 0..36 {
                truth.poses[i] = Some(scan.scene.cam_from_world[i]);
            }
            truth.update_tracks();
            report("truth", &truth);
            truth.finish(&NoProgress).unwrap();
            report("truth+ba", &truth);
            let mut model = make();
            let average = super::rotations(&model, &scan.images);
            model.position(&average.cam_from_world, &NoProgress).unwrap();
            report("averaged", &model);
            for (loss, limit) in super::COARSE {
                model.activate_within(limit * 4.0);
                report("activated", &model);
                model
                    .adjust_all(
                        &volery_estimation::BundleOptions {
                            max_iterations: 30,
                            loss_scale_px: Some(loss),
                            cost_tolerance: 1e-4,
                        },
                        &NoProgress,
                    )
                    .unwrap();
                report("coarse", &model);
            }
            model.activate_within(4.0);
            report("act", &model);
            model.finish(&NoProgress).unwrap();
            report("finish", &model);
        }
    }
}
