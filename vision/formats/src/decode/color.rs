//! The colors of a photo.

use super::Orientation;

/// How the three bytes of a stored pixel are to be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ColorSpace {
    Rgb,
    /// JFIF's full-range YCbCr.
    YCbCr,
}

/// Colors, kept as they were stored (neither turned nor converted) and read through
/// [`ColorImage::rgb`]: most callers want a few thousand pixels of millions.
#[derive(Debug, Clone)]
pub struct ColorImage {
    width: u32,
    height: u32,
    orientation: Orientation,
    space: ColorSpace,
    samples: Vec<u8>,
}

impl ColorImage {
    /// Of `width * height` interleaved stored pixels of three bytes.
    pub(super) fn new(
        width: u32,
        height: u32,
        orientation: Orientation,
        space: ColorSpace,
        samples: Vec<u8>,
    ) -> Self {
        debug_assert_eq!(samples.len(), width as usize * height as usize * 3);
        Self { width, height, orientation, space, samples }
    }

    /// Upright width, pixels.
    pub fn width(&self) -> u32 {
        self.orientation.upright_size(self.width, self.height).0
    }

    /// Upright height, pixels.
    pub fn height(&self) -> u32 {
        self.orientation.upright_size(self.width, self.height).1
    }

    /// sRGB of the upright pixel `(x, y)`, which must lie inside.
    pub fn rgb(&self, x: u32, y: u32) -> [u8; 3] {
        let (u, v) = self.orientation.stored_pixel(x, y, self.width, self.height);
        let start = (v as usize * self.width as usize + u as usize) * 3;
        let [a, b, c] = [self.samples[start], self.samples[start + 1], self.samples[start + 2]];
        match self.space {
            ColorSpace::Rgb => [a, b, c],
            ColorSpace::YCbCr => rgb_from_ycbcr(a, b, c),
        }
    }

    /// All upright pixels, row-major, three bytes each.
    pub fn to_rgb(&self) -> Vec<u8> {
        let mut rgb = Vec::with_capacity(self.samples.len());
        for y in 0..self.height() {
            for x in 0..self.width() {
                rgb.extend(self.rgb(x, y));
            }
        }
        rgb
    }
}

/// JFIF's conversion (ITU-T T.871, section 7), rounded.
fn rgb_from_ycbcr(y: u8, cb: u8, cr: u8) -> [u8; 3] {
    let (y, cb, cr) = (f32::from(y), f32::from(cb) - 128.0, f32::from(cr) - 128.0);
    let byte = |v: f32| (v + 0.5).clamp(0.0, 255.0) as u8;
    [byte(y + 1.402 * cr), byte(y - 0.344_136 * cb - 0.714_136 * cr), byte(y + 1.772 * cb)]
}

/// Rec. 601 luma of 8-bit RGB, rounded: 0.299 R + 0.587 G + 0.114 B in 16-bit fixed point.
#[inline]
pub(super) fn luma_from_rgb(r: u8, g: u8, b: u8) -> u8 {
    ((19_595 * u32::from(r) + 38_470 * u32::from(g) + 7_471 * u32::from(b) + 32_768) >> 16) as u8
}
