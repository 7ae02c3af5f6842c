//! Observed scenes as the mapper takes them, and how far a map is from the truth.

use nalgebra::{Isometry3, Matrix3, UnitQuaternion, Vector3};
use rayon::prelude::*;
use volery_estimation::{TwoViewOptions, estimate_two_view_geometry};
use volery_geometry::{Camera, CameraModel};
use volery_scene::{ImageId, NoProgress, SparseModel, TwoViewGeometry};
use volery_sfm::{MapperOptions, Reconstruction, SfmCamera, SfmImage, reconstruct};
use volery_synthetic::{PointOptions, PointScene};

pub(crate) fn camera() -> Camera {
    Camera::from_focal(CameraModel::SimpleRadial, 640, 480, 460.0).unwrap()
}

pub(crate) fn options() -> PointOptions {
    PointOptions { num_points: 3000, noise_px: 0.5, wrong_fraction: 0.1, ..PointOptions::default() }
}

pub(crate) fn fixed(camera: Camera) -> SfmCamera {
    SfmCamera::calibrated(camera)
}

pub(crate) fn images(scene: &PointScene) -> Vec<SfmImage> {
    scene
        .keypoints
        .iter()
        .enumerate()
        .map(|(index, keypoints)| SfmImage::from_keypoints(index, keypoints.clone()))
        .collect()
}

pub(crate) fn verified(scene: &PointScene, camera: &SfmCamera) -> Vec<TwoViewGeometry> {
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

pub(crate) fn map(scene: &PointScene, camera: SfmCamera) -> Reconstruction {
    let pairs = verified(scene, &camera);
    reconstruct(&images(scene), &[camera], &pairs, &MapperOptions::default(), &NoProgress).unwrap()
}

/// Largest position error, meters, and largest rotation error, degrees, after an alignment that
/// takes the turn from the orientations, so that straight paths have one too.
pub(crate) fn pose_errors(model: &SparseModel, scene: &PointScene) -> (f64, f64) {
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
