//! SIFT.

use volery_scene::{Features, GrayImage};

/// Options of [`detect_and_describe`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SiftOptions {
    /// Most features kept, spread evenly over the image and its scales.
    pub max_features: usize,
    /// -1 doubles the image first, 0 starts at its own size.
    pub first_octave: i32,
    /// Least DoG contrast, of a gray range of 1 (COLMAP's 0.02 / 3).
    pub peak_threshold: f32,
    /// Greatest ratio of principal curvatures (COLMAP's 10).
    pub edge_threshold: f32,
    /// All orientations are this angle (radians); `None` estimates them.
    pub upright: Option<f32>,
}

impl Default for SiftOptions {
    fn default() -> Self {
        Self {
            max_features: 8192,
            first_octave: -1,
            peak_threshold: 0.02 / 3.0,
            edge_threshold: 10.0,
            upright: None,
        }
    }
}

/// SIFT features of an image.
pub fn detect_and_describe(image: &GrayImage, options: &SiftOptions) -> Features {
    let _ = (image, options);
    todo!()
}
