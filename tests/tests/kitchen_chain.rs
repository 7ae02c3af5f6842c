//! A real walk through a kitchen, every photo matched with the next three only. Nothing closes a
//! loop, and mappers return maps that are off by a centimeter to half a meter without a word.
//!
//! Features of seventy photos take a while: only with `VOLERY_LONG=1`.

use std::sync::Arc;

use rayon::prelude::*;
use volery_estimation::{TwoViewOptions, estimate_two_view_geometry};
use volery_features::{
    MatchOptions, PackedDescriptors, SiftOptions, detect_and_describe, match_features,
};
use volery_formats::{DecodeLimits, decode_image};
use volery_scene::{Features, NoProgress, TwoViewGeometry, Verdict};
use volery_sfm::{MapperOptions, Reconstruction, SfmCamera, SfmImage, reconstruct};
use volery_tests::evaluation::poses_of;
use volery_tests::shared::read_poses;
use volery_tests::{Alignment, SharedSet, evaluate};

/// Positions that are off by more are not good, meters.
const MAX_ERROR: f64 = 0.01;

fn map(set: &SharedSet, features: &[Features], window: usize) -> Reconstruction {
    let camera = SfmCamera::calibrated(set.camera.expect("the kitchen is calibrated"));
    let images: Vec<SfmImage> = set
        .images
        .iter()
        .zip(features)
        .enumerate()
        .map(|(index, (name, features))| SfmImage {
            name: name.clone(),
            ..SfmImage::from_features(index, Arc::new(features.clone()))
        })
        .collect();
    let packed: Vec<_> = features.iter().map(|f| PackedDescriptors::new(&f.descriptors)).collect();
    let verify = |&(i, j): &(usize, usize)| -> Option<TwoViewGeometry> {
        let matches = match_features(&packed[i], &packed[j], &MatchOptions::default());
        estimate_two_view_geometry(
            images[i].id,
            &camera.camera,
            &images[i].keypoints,
            images[j].id,
            &camera.camera,
            &images[j].keypoints,
            &matches,
            &TwoViewOptions::default(),
            (i * images.len() + j) as u64,
        )
    };
    let n = images.len();
    let neighbors: Vec<(usize, usize)> =
        (0..n).flat_map(|i| (i + 1..n.min(i + window + 1)).map(move |j| (i, j))).collect();
    let pairs: Vec<_> = neighbors.par_iter().filter_map(verify).collect();
    reconstruct(&images, &[camera], &pairs, &MapperOptions::default(), &NoProgress).unwrap()
}

#[test]
fn a_chain_is_right_or_not_good() {
    if std::env::var_os("VOLERY_LONG").is_none() {
        eprintln!("SKIPPED: VOLERY_LONG is not set");
        return;
    }
    let Some(set) = SharedSet::open("redkitchen") else { return };
    let truth = read_poses(&set.dir.join("reference_sfm.csv")).expect("the kitchen has poses");
    let describe = |name: &String| {
        let bytes = std::fs::read(set.images_dir.join(name)).unwrap();
        let gray = decode_image(&bytes, &DecodeLimits::default()).unwrap().gray;
        detect_and_describe(&gray, &SiftOptions::default())
    };
    let features: Vec<Features> = set.images.par_iter().map(describe).collect();
    for window in [2, 3, 5, 8, 70] {
        let found = map(&set, &features, window);
        let figures = evaluate(&poses_of(&found.models[0]), &truth, Alignment::Centers).unwrap();
        println!("next {window}: {figures}, {:?}", found.quality);
        let is_good = found.quality.verdict == Verdict::Good;
        assert!(!is_good || figures.ate_rmse <= MAX_ERROR, "next {window}: {figures}");
        // All pairs close every loop: there is nothing to doubt.
        assert!(window < 70 || is_good, "{:?}", found.quality);
    }
}
