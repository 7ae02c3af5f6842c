//! Pictures as JPEG.

use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use volery_scene::Texture;

/// Why there is no JPEG.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum WriteJpegError {
    /// A side of nothing, or of more than the format can say.
    #[error("a JPEG cannot be {width} by {height} pixels")]
    Size {
        /// Pixels.
        width: u32,
        /// Pixels.
        height: u32,
    },
    /// Pixels that are not as many as the size says.
    #[error("{got} pixels instead of {expected}")]
    PixelCount {
        /// What came.
        got: usize,
        /// Width times height.
        expected: usize,
    },
}

/// A picture as baseline JPEG, colors at full resolution, of a quality from 1 to 100, on libjpeg's scale.
///
/// # Errors
///
/// [`WriteJpegError`] for sizes that JPEG does not have and for missing pixels.
pub fn write_jpeg(picture: &Texture, quality: u8) -> Result<Vec<u8>, WriteJpegError> {
    let (width, height) = (picture.width, picture.height);
    let size = WriteJpegError::Size { width, height };
    let [Ok(w), Ok(h)] = [width, height].map(u16::try_from) else { return Err(size) };
    let expected = usize::from(w) * usize::from(h);
    if picture.pixels.len() != expected {
        return Err(WriteJpegError::PixelCount { got: picture.pixels.len(), expected });
    }
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, quality.clamp(1, 100));
    encoder.set_sampling_factor(SamplingFactor::F_1_1);
    let pixels = picture.pixels.as_flattened();
    encoder.encode(pixels, w, h, ColorType::Rgb).map_err(|_| size)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{DecodeLimits, decode_image};

    fn picture(width: u32, height: u32) -> Texture {
        let color = |i: u32| {
            let (x, y) = ((i % width) as f32, (i / width) as f32);
            let wave = |v: f32| (127.0 + 90.0 * v.sin()) as u8;
            [wave(x / 9.0), wave(y / 7.0 + 1.0), wave((x + y) / 11.0 + 2.0)]
        };
        Texture { width, height, pixels: (0..width * height).map(color).collect() }
    }

    /// Root mean square over all channels.
    fn error(picture: &Texture, quality: u8) -> f64 {
        let bytes = write_jpeg(picture, quality).unwrap();
        let decoded = decode_image(&bytes, &DecodeLimits::default()).unwrap();
        let color = decoded.color.unwrap();
        assert_eq!((color.width(), color.height()), (picture.width, picture.height));
        let rgb = color.to_rgb();
        let squares = rgb.iter().zip(picture.pixels.as_flattened());
        let sum: f64 = squares.map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2)).sum();
        (sum / rgb.len() as f64).sqrt()
    }

    /// Read by a decoder that is not ours; sizes need not be multiples of the blocks.
    #[test]
    fn what_is_read_is_what_was_written() {
        for (width, height) in [(64, 48), (61, 35), (1, 1), (17, 16)] {
            let picture = picture(width, height);
            let [fine, coarse] = [95, 30].map(|quality| error(&picture, quality));
            assert!(fine < 3.0, "{fine} at {width} x {height}");
            assert!(fine <= coarse && coarse < 12.0, "{coarse} at {width} x {height}");
        }
    }

    /// The hardest to code: every coefficient of every block is there.
    #[test]
    fn noise_is_survived() {
        let mut random = volery_geometry::Rng::new(1);
        let mut picture = picture(80, 80);
        for pixel in &mut picture.pixels {
            *pixel = [if random.uniform() < 0.5 { 0 } else { 255 }; 3];
        }
        let rms = error(&picture, 100);
        assert!(rms < 2.5, "{rms}");
    }

    #[test]
    fn lower_quality_is_smaller() {
        let picture = picture(128, 128);
        let sizes = [10, 50, 75, 95].map(|quality| write_jpeg(&picture, quality).unwrap().len());
        assert!(sizes.is_sorted() && sizes[0] < sizes[3], "{sizes:?}");
    }

    #[test]
    fn sizes_that_cannot_be_are_named() {
        let size = |width, height| write_jpeg(&Texture { width, height, pixels: Vec::new() }, 90);
        assert_eq!(size(0, 4), Err(WriteJpegError::Size { width: 0, height: 4 }));
        assert_eq!(size(70_000, 4), Err(WriteJpegError::Size { width: 70_000, height: 4 }));
        assert_eq!(size(3, 4), Err(WriteJpegError::PixelCount { got: 0, expected: 12 }));
    }
}
