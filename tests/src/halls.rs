//! Rendered halls through every stage behind the decoder.

use std::sync::Arc;

use rayon::prelude::*;
use volery_estimation::{TwoViewOptions, estimate_two_view_geometry};
use volery_features::{
    MatchOptions, PackedDescriptors, SiftOptions, detect_and_describe, match_features,
};
use volery_scene::{Features, ImageId, NoProgress, TwoViewGeometry};
use volery_sfm::{MapperOptions, Reconstruction, SfmCamera, SfmImage, reconstruct};
use volery_synthetic::DemoHall;

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
        let features = features_of(&demo);
        let pairs = pairs_of(&demo, &features);
        let images: Vec<SfmImage> = demo
            .scan
            .iter()
            .zip(&features)
            .enumerate()
            .map(|(index, (shot, features))| SfmImage {
                name: shot.name.clone(),
                prior: shot.prior,
                ..SfmImage::from_features(index, Arc::new(features.clone()))
            })
            .collect();
        let camera = SfmCamera::calibrated(*demo.camera());
        let options = MapperOptions::default();
        let reconstruction = reconstruct(&images, &[camera], &pairs, &options, &NoProgress)
            .expect("the scan of a hall can be mapped");
        Self { demo, features, reconstruction }
    }
}

fn features_of(demo: &DemoHall) -> Vec<Features> {
    let options = SiftOptions { max_features: 3000, ..SiftOptions::default() };
    demo.scan
        .par_iter()
        .map(|shot| detect_and_describe(&demo.photo(shot).gray(), &options))
        .collect()
}

fn pairs_of(demo: &DemoHall, features: &[Features]) -> Vec<TwoViewGeometry> {
    let packed: Vec<_> = features.iter().map(|f| PackedDescriptors::new(&f.descriptors)).collect();
    let pixels: Vec<Vec<_>> =
        features.iter().map(|f| f.keypoints.iter().map(|k| k.pixel()).collect()).collect();
    let n = features.len();
    let pairs: Vec<(usize, usize)> = (0..n).flat_map(|i| (i + 1..n).map(move |j| (i, j))).collect();
    let verify = |&(i, j): &(usize, usize)| {
        let matches = match_features(&packed[i], &packed[j], &MatchOptions::default());
        estimate_two_view_geometry(
            ImageId(i as u32),
            demo.camera(),
            &pixels[i],
            ImageId(j as u32),
            demo.camera(),
            &pixels[j],
            &matches,
            &TwoViewOptions::default(),
            1,
        )
    };
    pairs.par_iter().filter_map(verify).collect()
}
