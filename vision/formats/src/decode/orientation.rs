//! The eight orientations of EXIF.

use volery_scene::GrayImage;

/// How the stored image must be turned to stand upright; EXIF tag 0x0112, values 1 to 8.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Orientation {
    /// 1: it stands upright.
    #[default]
    Upright,
    /// 2: mirrored left to right.
    MirroredHorizontally,
    /// 3: upside down.
    Rotated180,
    /// 4: mirrored top to bottom.
    MirroredVertically,
    /// 5: rows and columns swapped.
    Transposed,
    /// 6: a quarter turn clockwise makes it upright.
    RotateClockwise,
    /// 7: rows and columns swapped about the other diagonal.
    Transversed,
    /// 8: a quarter turn counterclockwise makes it upright.
    RotateCounterclockwise,
}

impl Orientation {
    /// Of the tag's value; values that EXIF does not know are upright.
    pub fn from_exif(value: u32) -> Self {
        match value {
            2 => Self::MirroredHorizontally,
            3 => Self::Rotated180,
            4 => Self::MirroredVertically,
            5 => Self::Transposed,
            6 => Self::RotateClockwise,
            7 => Self::Transversed,
            8 => Self::RotateCounterclockwise,
            _ => Self::Upright,
        }
    }

    /// Whether width and height change places.
    pub fn swaps_sides(self) -> bool {
        matches!(
            self,
            Self::Transposed
                | Self::RotateClockwise
                | Self::Transversed
                | Self::RotateCounterclockwise
        )
    }

    /// Size of the upright image of a stored one.
    pub fn upright_size(self, width: u32, height: u32) -> (u32, u32) {
        if self.swaps_sides() { (height, width) } else { (width, height) }
    }

    /// Stored pixel that stands at the upright pixel `(x, y)`; `width`, `height` are the stored
    /// size.
    #[inline]
    pub fn stored_pixel(self, x: u32, y: u32, width: u32, height: u32) -> (u32, u32) {
        let (right, bottom) = (width - 1, height - 1);
        match self {
            Self::Upright => (x, y),
            Self::MirroredHorizontally => (right - x, y),
            Self::Rotated180 => (right - x, bottom - y),
            Self::MirroredVertically => (x, bottom - y),
            Self::Transposed => (y, x),
            Self::RotateClockwise => (y, bottom - x),
            Self::Transversed => (right - y, bottom - x),
            Self::RotateCounterclockwise => (right - y, x),
        }
    }
}

/// The upright gray image of stored pixels, `luma(index)` being the value of stored pixel
/// `index` in row-major order.
pub(super) fn upright_gray(
    width: u32,
    height: u32,
    orientation: Orientation,
    luma: impl Fn(usize) -> u8,
) -> GrayImage {
    let (out_width, out_height) = orientation.upright_size(width, height);
    let pixels: Vec<u8> = if orientation == Orientation::Upright {
        (0..width as usize * height as usize).map(luma).collect()
    } else {
        let mut pixels = Vec::with_capacity(width as usize * height as usize);
        for y in 0..out_height {
            for x in 0..out_width {
                let (u, v) = orientation.stored_pixel(x, y, width, height);
                pixels.push(luma(v as usize * width as usize + u as usize));
            }
        }
        pixels
    };
    GrayImage::new(out_width, out_height, pixels).expect("one value per pixel")
}
