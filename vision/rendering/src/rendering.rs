//! What a virtual camera delivers.

use volery_scene::GrayImage;

/// A drawn image with its depth.
#[derive(Debug, Clone, PartialEq)]
pub struct Rendering {
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// sRGB row by row; black where nothing is seen.
    pub colors: Vec<[u8; 3]>,
    /// Depth along the camera's z at the pixel centers; 0 where nothing is seen.
    pub depth: Vec<f32>,
}

impl Rendering {
    /// Luma (BT.601, as JPEG has it).
    pub fn gray(&self) -> GrayImage {
        let luma = |c: &[u8; 3]| {
            let sum = 19_595 * u32::from(c[0]) + 38_470 * u32::from(c[1]) + 7_471 * u32::from(c[2]);
            ((sum + 32_768) >> 16) as u8
        };
        GrayImage::new(self.width, self.height, self.colors.iter().map(luma).collect())
            .expect("one color per pixel")
    }

    /// Part of the pixels that see something, 0..1.
    pub fn seen_part(&self) -> f64 {
        let seen = self.depth.iter().filter(|&&depth| depth > 0.0).count();
        seen as f64 / self.depth.len().max(1) as f64
    }
}
