//! Which image pairs to match.

use volery_features::GlobalDescriptor;
use volery_scene::ImagePrior;

/// Options of [`select_pairs`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairOptions {
    /// Up to so many images every pair is matched.
    pub max_exhaustive_images: usize,
    /// Neighbors on either side in the order of the images.
    pub num_sequential: usize,
    /// Most alike images per image.
    pub num_retrieved: usize,
}

impl Default for PairOptions {
    fn default() -> Self {
        Self { max_exhaustive_images: 120, num_sequential: 8, num_retrieved: 20 }
    }
}

/// Index pairs `(i, j)`, `i < j`, sorted. Linear in the number of images beyond
/// `max_exhaustive_images`. `priors` may add pairs by yaw and position; empty or one per image.
pub fn select_pairs(
    global_descriptors: &[GlobalDescriptor],
    priors: &[ImagePrior],
    options: &PairOptions,
) -> Vec<(usize, usize)> {
    let _ = (global_descriptors, priors, options);
    todo!()
}
