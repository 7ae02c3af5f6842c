//! Photos to pixels: JPEG and PNG, upright, gray and color.

use std::sync::Arc;

use volery_scene::GrayImage;

mod color;
mod complete;
mod frame;
mod huffman;
mod jpeg;
mod orientation;
mod png;
mod segments;
mod sniff;

pub use color::ColorImage;
pub use orientation::Orientation;
pub use sniff::sniff;

/// What a decoder may take. The defaults hold for one photo of any camera on the market.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DecodeLimits {
    /// Bytes of the file.
    pub max_file_bytes: usize,
    /// Width times height.
    pub max_pixels: u64,
    /// Width and height, pixels.
    pub max_side: u32,
    /// Bytes of all buffers of one decoding at once.
    pub max_alloc_bytes: u64,
}

impl Default for DecodeLimits {
    fn default() -> Self {
        Self {
            max_file_bytes: 32 << 20,
            max_pixels: 64_000_000,
            max_side: 16_384,
            max_alloc_bytes: 256 << 20,
        }
    }
}

/// File formats of photos.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ImageFormat {
    /// Baseline or progressive, 8 bit, gray or color.
    Jpeg,
    /// Any color type; 16 bit is rounded to 8, alpha is dropped.
    Png,
}

impl ImageFormat {
    /// `image/jpeg` or `image/png`.
    pub fn media_type(self) -> &'static str {
        match self {
            Self::Jpeg => "image/jpeg",
            Self::Png => "image/png",
        }
    }

    /// `jpg` or `png`.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Jpeg => "jpg",
            Self::Png => "png",
        }
    }
}

/// What the first bytes of a file say.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ImageHeader {
    /// By its bytes, not by its name.
    pub format: ImageFormat,
    /// As stored, before any orientation, pixels.
    pub width: u32,
    /// As stored, before any orientation, pixels.
    pub height: u32,
}

/// An upright photo.
#[derive(Debug, Clone)]
pub struct DecodedImage {
    /// What the header said: format and stored size.
    pub header: ImageHeader,
    /// The orientation tag that has been applied to `gray` and is applied by `color`.
    pub orientation: Orientation,
    /// Rec. 601 luma, as libjpeg's Y.
    pub gray: GrayImage,
    /// `None` for gray photos.
    pub color: Option<Arc<ColorImage>>,
}

impl DecodedImage {
    /// sRGB at an upright pixel position (first pixel center (0.5, 0.5)), clamped to the image;
    /// gray where the photo has no color.
    pub fn rgb_at(&self, x: f32, y: f32) -> [u8; 3] {
        let clamp = |v: f32, size: u32| (v.max(0.0) as u32).min(size - 1);
        let (x, y) = (clamp(x, self.gray.width()), clamp(y, self.gray.height()));
        match &self.color {
            Some(color) => color.rgb(x, y),
            None => [self.gray.row(y)[x as usize]; 3],
        }
    }
}

/// Why bytes are not a photo that can be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum DecodeError {
    /// Zero bytes.
    #[error("the file is empty")]
    EmptyFile,
    /// Neither JPEG nor PNG.
    #[error("not an image that is understood: JPEG and PNG are")]
    NotAnImage,
    /// The end is missing.
    #[error("the image is cut off: {detail}")]
    Truncated {
        /// Where.
        detail: String,
    },
    /// Over a limit; nothing was allocated.
    #[error("{what} is {actual}, at most {limit} is allowed")]
    TooLarge {
        /// Which limit.
        what: &'static str,
        /// What came.
        actual: u64,
        /// The limit.
        limit: u64,
    },
    /// A variant of the format that is not decoded: CMYK, 12 bit, lossless JPEG.
    #[error("unsupported kind of image: {detail}")]
    Unsupported {
        /// Which.
        detail: String,
    },
    /// The bytes contradict the format.
    #[error("the image is damaged: {detail}")]
    Damaged {
        /// How.
        detail: String,
    },
}

impl DecodeError {
    /// The stable code.
    pub fn code(&self) -> &'static str {
        match self {
            Self::EmptyFile => "empty_file",
            Self::NotAnImage => "not_an_image",
            Self::Truncated { .. } => "truncated",
            Self::TooLarge { .. } => "too_large",
            Self::Unsupported { .. } => "unsupported",
            Self::Damaged { .. } => "damaged",
        }
    }
}

/// Decodes a JPEG or PNG, turns it upright by its EXIF orientation (once, here), and takes no
/// memory before the header has passed `limits`.
///
/// # Errors
///
/// [`DecodeError`] for bytes that are no whole JPEG or PNG, or exceed a limit.
pub fn decode_image(bytes: &[u8], limits: &DecodeLimits) -> Result<DecodedImage, DecodeError> {
    check_limit("file size in bytes", bytes.len() as u64, limits.max_file_bytes as u64)?;
    let header = sniff(bytes)?;
    check_limit("image width", header.width.into(), limits.max_side.into())?;
    check_limit("image height", header.height.into(), limits.max_side.into())?;
    let num_pixels = u64::from(header.width) * u64::from(header.height);
    check_limit("number of pixels", num_pixels, limits.max_pixels)?;
    let orientation = crate::exif::read_exif(bytes).orientation;
    let planes = match header.format {
        ImageFormat::Jpeg => jpeg::decode(bytes, &header, orientation, limits)?,
        ImageFormat::Png => png::decode(bytes, &header, orientation, limits)?,
    };
    Ok(DecodedImage { header, orientation, gray: planes.gray, color: planes.color.map(Arc::new) })
}

/// What a format's decoder returns, upright.
struct Planes {
    gray: GrayImage,
    color: Option<ColorImage>,
}

fn check_limit(what: &'static str, actual: u64, limit: u64) -> Result<(), DecodeError> {
    if actual > limit { Err(DecodeError::TooLarge { what, actual, limit }) } else { Ok(()) }
}

#[cfg(test)]
mod tests;
