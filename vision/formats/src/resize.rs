//! Smaller images.

use volery_scene::GrayImage;

/// Size of `width` x `height` reduced to `max_side`, sides rounded, never enlarged, never zero.
pub fn downscaled_size(width: u32, height: u32, max_side: u32) -> (u32, u32) {
    let longest = width.max(height);
    if longest <= max_side {
        return (width, height);
    }
    let side = |s: u32| {
        let scaled = (f64::from(s) * f64::from(max_side) / f64::from(longest)).round();
        (scaled as u32).max(1)
    };
    (side(width), side(height))
}

/// The image with its longer side reduced to `max_side`, each pixel the area average of what it
/// covers; `None` if it is small enough already.
///
/// A pixel (x, y) of the result (first center (0.5, 0.5)) is (x · width / result width, y · height
/// / result height) of the original.
pub fn downscale_to_max_side(image: &GrayImage, max_side: u32) -> Option<GrayImage> {
    let _ = (image, max_side);
    todo!()
}
