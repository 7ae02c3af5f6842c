//! A rendered hall from pixels to poses: every stage behind the decoder, against exact truth.

use std::sync::Arc;

use rayon::prelude::*;
use volery_estimation::{IntrinsicsRefinement, TwoViewOptions, estimate_two_view_geometry};
use volery_features::{
    MatchOptions, PackedDescriptors, SiftOptions, detect_and_describe, match_features,
};
use volery_scene::{CameraId, Features, ImageId, NoProgress, TwoViewGeometry, Verdict};
use volery_sfm::{MapperOptions, SfmCamera, SfmImage, reconstruct};
use volery_synthetic::DemoHall;
use volery_tests::evaluation::{Alignment, Poses, evaluate, poses_of};

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

/// The scan of the paper (P30, P34, P35): take-off, yaw station, circle, run along the rack.
#[test]
fn the_demo_hall_is_mapped_to_a_centimeter() {
    let demo = DemoHall::new(1);
    let features = features_of(&demo);
    let pairs = pairs_of(&demo, &features);
    let images: Vec<SfmImage> = demo
        .scan
        .iter()
        .zip(&features)
        .enumerate()
        .map(|(index, (shot, features))| SfmImage {
            id: ImageId(index as u32),
            name: shot.name.clone(),
            camera: CameraId(0),
            keypoints: features.keypoints.iter().map(|k| k.pixel()).collect(),
            colors: vec![[128; 3]; features.len()],
            features: Arc::new(features.clone()),
            prior: shot.prior,
        })
        .collect();
    let camera = SfmCamera {
        camera: *demo.camera(),
        refine: IntrinsicsRefinement::FIXED,
        focal_is_guess: false,
    };
    let result =
        reconstruct(&images, &[camera], &pairs, &MapperOptions::default(), &NoProgress).unwrap();
    let truth: Poses =
        demo.scan.iter().map(|s| (s.name.clone(), s.cam_from_world.inverse())).collect();
    let estimate = poses_of(result.models.first().expect("a map"));
    let figures = evaluate(&estimate, &truth, Alignment::Centers).unwrap();
    println!("{} pairs, {figures}, {:?}", pairs.len(), result.quality.verdict);
    assert_eq!(result.quality.verdict, Verdict::Good, "{:?}", result.quality);
    assert_eq!(figures.num_registered, demo.scan.len(), "{:?}", result.unplaced);
    assert!(figures.ate_rmse <= 0.01 && figures.rotation_median_deg <= 0.1, "{figures}");
}
