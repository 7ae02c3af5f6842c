//! Point scenes through two-view geometry and the mapper, judged against the truth.

use rayon::prelude::*;
use volery_estimation::{IntrinsicsRefinement, TwoViewOptions, estimate_two_view_geometry};
use volery_geometry::Camera;
use volery_scene::{ImageId, NoProgress, TwoViewGeometry};
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

/// What is known of the camera before mapping.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Knowledge {
    /// Its focal length, which is believed.
    Fixed(f64),
    /// A guess of its focal length, to be refined with the distortion.
    Guess(f64),
}

impl Knowledge {
    /// The camera as the mapper is told of it.
    pub(crate) fn camera(self, truth: &Camera) -> SfmCamera {
        let (Self::Fixed(focal) | Self::Guess(focal)) = self;
        let focal_is_guess = matches!(self, Self::Guess(_));
        let mut camera = *truth;
        let num_focals = camera.model.num_focals();
        camera.params_mut()[..num_focals].fill(focal);
        let refine = if focal_is_guess {
            IntrinsicsRefinement::FOCAL_AND_DISTORTION
        } else {
            IntrinsicsRefinement::FIXED
        };
        SfmCamera { camera, refine, focal_is_guess }
    }
}

/// Verified pairs of a scene.
pub fn verified_pairs(scene: &PointScene, knowledge: Knowledge, seed: u64) -> Vec<TwoViewGeometry> {
    let camera = knowledge.camera(&scene.camera);
    let options =
        TwoViewOptions { calibrated: !camera.focal_is_guess, ..TwoViewOptions::default() };
    let estimate = |(i, j, matches): &(usize, usize, Vec<_>)| {
        estimate_two_view_geometry(
            ImageId(*i as u32),
            &camera.camera,
            &scene.keypoints[*i],
            ImageId(*j as u32),
            &camera.camera,
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
    let knowledge = Knowledge::Fixed(scene.camera.mean_focal());
    map_pairs(scene, knowledge, &verified_pairs(scene, knowledge, seed), seed)
}

/// Maps a scene from its verified `pairs`.
pub fn map_pairs(
    scene: &PointScene,
    knowledge: Knowledge,
    pairs: &[TwoViewGeometry],
    seed: u64,
) -> Result<Reconstruction, ReconstructError> {
    let images: Vec<SfmImage> = scene
        .keypoints
        .iter()
        .enumerate()
        .map(|(index, keypoints)| SfmImage {
            name: image_name(index),
            ..SfmImage::from_keypoints(index, keypoints.clone())
        })
        .collect();
    let camera = knowledge.camera(&scene.camera);
    let options = MapperOptions { seed, ..MapperOptions::default() };
    reconstruct(&images, &[camera], pairs, &options, &NoProgress)
}

/// Errors of the map against the truth of the scene; `None` without a map that can be aligned.
/// Centers that move by centimeters say nothing of the rotation, so the orientations fix it.
pub fn judge(scene: &PointScene, reconstruction: &Reconstruction) -> Option<Evaluation> {
    evaluate(&poses_of(reconstruction.models.first()?), &truth_of(scene), Alignment::Orientations)
}
