//! Exact nearest-neighbor matching.

use nalgebra::Matrix3;
use volery_scene::{Descriptor, FeatureMatch, Features};

/// Options of [`match_features`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MatchOptions {
    /// Greatest ratio of the nearest to the second-nearest distance.
    pub max_ratio: f32,
}

impl Default for MatchOptions {
    fn default() -> Self {
        Self { max_ratio: 0.8 }
    }
}

/// Descriptors laid out for the matching kernel; made once per image, used for every pair.
pub struct PackedDescriptors {}

impl PackedDescriptors {
    /// Packs `descriptors`.
    pub fn new(descriptors: &[Descriptor]) -> Self {
        let _ = descriptors;
        todo!()
    }
}

/// Mutual nearest neighbors that pass the ratio test both ways, sorted by `feature1`.
pub fn match_features(
    features1: &PackedDescriptors,
    features2: &PackedDescriptors,
    options: &MatchOptions,
) -> Vec<FeatureMatch> {
    let _ = (features1, features2, options);
    todo!()
}

/// Matches within `max_error_px` of the epipolar lines of `fundamental` (`x₂ᵀ F x₁ = 0`), mutual
/// and ratio-tested among the candidates of the band (P18). `pixels1/2` are the undistorted
/// keypoints.
pub fn match_guided(
    features1: &Features,
    pixels1: &[nalgebra::Point2<f64>],
    features2: &Features,
    pixels2: &[nalgebra::Point2<f64>],
    fundamental: &Matrix3<f64>,
    max_error_px: f64,
    options: &MatchOptions,
) -> Vec<FeatureMatch> {
    let _ = (features1, pixels1, features2, pixels2, fundamental, max_error_px, options);
    todo!()
}
