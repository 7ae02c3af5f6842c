//! Point scenes through two-view geometry and the mapper, judged against the truth.

use rayon::prelude::*;
use volery_estimation::{IntrinsicsRefinement, TwoViewOptions, estimate_two_view_geometry};
use volery_scene::{CameraId, ImageId, ImagePrior, NoProgress, TwoViewGeometry};
use volery_sfm::{
    MapperOptions, ReconstructError, Reconstruction, SfmCamera, SfmImage, reconstruct,
};
use volery_synthetic::PointScene;

use crate::evaluation::{Alignment, Evaluation, Poses, evaluate, poses_of};

/// File name of image `index` of a scene.
pub fn image_name(index: usize) -> String {
    format!("{index:04}.png")
}

/// True camera-to-world poses of a scene.
pub fn truth_of(scene: &PointScene) -> Poses {
    let poses = scene.cam_from_world.iter().enumerate();
    poses.map(|(index, pose)| (image_name(index), pose.inverse())).collect()
}

/// Verified pairs of a scene with known intrinsics.
pub fn verified_pairs(scene: &PointScene, seed: u64) -> Vec<TwoViewGeometry> {
    let options = TwoViewOptions::default();
    let estimate = |(i, j, matches): &(usize, usize, Vec<_>)| {
        estimate_two_view_geometry(
            ImageId(*i as u32),
            &scene.camera,
            &scene.keypoints[*i],
            ImageId(*j as u32),
            &scene.camera,
            &scene.keypoints[*j],
            matches,
            &options,
            seed,
        )
    };
    scene.matches.par_iter().filter_map(estimate).collect()
}

/// Maps a scene whose intrinsics are known.
pub fn map_scene(scene: &PointScene, seed: u64) -> Result<Reconstruction, ReconstructError> {
    let images: Vec<SfmImage> = scene
        .keypoints
        .iter()
        .enumerate()
        .map(|(index, keypoints)| SfmImage {
            id: ImageId(index as u32),
            name: image_name(index),
            camera: CameraId(0),
            keypoints: keypoints.clone(),
            colors: vec![[128; 3]; keypoints.len()],
            prior: ImagePrior::default(),
        })
        .collect();
    let camera = SfmCamera {
        camera: scene.camera,
        refine: IntrinsicsRefinement::FIXED,
        focal_is_guess: false,
    };
    let options = MapperOptions { seed, ..MapperOptions::default() };
    reconstruct(&images, &[camera], &verified_pairs(scene, seed), &options, &NoProgress)
}

/// Errors of the map against the truth of the scene; `None` without a map that can be aligned.
/// Centers that move by centimeters say nothing of the rotation, so the orientations fix it.
pub fn judge(scene: &PointScene, reconstruction: &Reconstruction) -> Option<Evaluation> {
    evaluate(&poses_of(reconstruction.models.first()?), &truth_of(scene), Alignment::Orientations)
}
