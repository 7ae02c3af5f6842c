//! Rendered halls through every stage behind the decoder.

use std::sync::Arc;

use rayon::prelude::*;
use volery_estimation::{TwoViewOptions, estimate_two_view_geometry};
use volery_features::{
    MatchOptions, PackedDescriptors, SiftOptions, detect_and_describe, match_features,
};
use volery_geometry::Camera;
use volery_scene::{Features, GrayImage, ImageId, NoProgress};
use volery_sfm::{MapperOptions, Reconstruction, SfmCamera, SfmImage, reconstruct};
use volery_synthetic::{DemoHall, Shot};

use crate::scans::Knowledge;

/// A hall's scan with its map.
pub struct MappedHall {
    /// The hall.
    pub demo: DemoHall,
    /// Of the scan's photos in order; the id of an image is its index.
    pub features: Vec<Features>,
    /// What the mapper makes of them.
    pub reconstruction: Reconstruction,
}

impl MappedHall {
    /// Renders, matches and maps the hall of `seed`.
    ///
    /// # Panics
    ///
    /// If the mapper refuses the photos.
    pub fn new(seed: u64) -> Self {
        let demo = DemoHall::new(seed);
        let photos: Vec<_> = demo.scan.par_iter().map(|shot| demo.photo(shot).gray()).collect();
        let features = features_of(&photos);
        let name = |image: SfmImage, shot: &Shot| SfmImage {
            name: shot.name.clone(),
            prior: shot.prior,
            ..image
        };
        let images = sfm_images(&features).zip(&demo.scan).map(|(image, shot)| name(image, shot));
        let camera = Knowledge::Fixed(demo.camera().mean_focal()).camera(demo.camera());
        let reconstruction = map(&images.collect::<Vec<_>>(), &features, camera);
        Self { demo, features, reconstruction }
    }
}

/// What the mapper makes of photos of one camera.
///
/// # Panics
///
/// If it refuses them.
pub fn map_photos(photos: &[GrayImage], camera: &Camera, knowledge: Knowledge) -> Reconstruction {
    let features = features_of(photos);
    map(&sfm_images(&features).collect::<Vec<_>>(), &features, knowledge.camera(camera))
}

fn features_of(photos: &[GrayImage]) -> Vec<Features> {
    let options = SiftOptions { max_features: 3000, ..SiftOptions::default() };
    photos.par_iter().map(|photo| detect_and_describe(photo, &options)).collect()
}

fn sfm_images(features: &[Features]) -> impl Iterator<Item = SfmImage> {
    let image = |(index, features): (usize, &Features)| {
        SfmImage::from_features(index, Arc::new(features.clone()))
    };
    features.iter().enumerate().map(image)
}

/// All pairs are matched.
fn map(images: &[SfmImage], features: &[Features], camera: SfmCamera) -> Reconstruction {
    let packed: Vec<_> = features.iter().map(|f| PackedDescriptors::new(&f.descriptors)).collect();
    let pixels: Vec<Vec<_>> =
        features.iter().map(|f| f.keypoints.iter().map(|k| k.pixel()).collect()).collect();
    let n = features.len();
    let pairs: Vec<(usize, usize)> = (0..n).flat_map(|i| (i + 1..n).map(move |j| (i, j))).collect();
    let options =
        TwoViewOptions { calibrated: !camera.focal_is_guess, ..TwoViewOptions::default() };
    let verify = |&(i, j): &(usize, usize)| {
        let matches = match_features(&packed[i], &packed[j], &MatchOptions::default());
        estimate_two_view_geometry(
            ImageId(i as u32),
            &camera.camera,
            &pixels[i],
            ImageId(j as u32),
            &camera.camera,
            &pixels[j],
            &matches,
            &options,
            1,
        )
    };
    let verified: Vec<_> = pairs.par_iter().filter_map(verify).collect();
    reconstruct(images, &[camera], &verified, &MapperOptions::default(), &NoProgress)
        .expect("the photos are of a known camera")
}
