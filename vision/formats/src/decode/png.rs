//! PNG by the png crate.

use std::io::Cursor;

use png::{ColorType, Decoder, DecodingError, Limits, Transformations};

use super::color::{ColorImage, ColorSpace, luma_from_rgb};
use super::orientation::{Orientation, upright_gray};
use super::{DecodeError, DecodeLimits, ImageHeader, Planes, check_limit};

pub(super) fn decode(
    bytes: &[u8],
    header: &ImageHeader,
    orientation: Orientation,
    limits: &DecodeLimits,
) -> Result<Planes, DecodeError> {
    let max_bytes = usize::try_from(limits.max_alloc_bytes).unwrap_or(usize::MAX);
    let mut decoder = Decoder::new_with_limits(Cursor::new(bytes), Limits { bytes: max_bytes });
    // Palettes become colors, 1 to 4 bits become 8; 16 bits are kept and rounded below.
    decoder.set_transformations(Transformations::EXPAND);
    let mut reader = decoder.read_info().map_err(from_png)?;
    let num_bytes = reader
        .output_buffer_size()
        .ok_or_else(|| DecodeError::Damaged { detail: "size overflows".into() })?;
    // The decoded samples, and at most three bytes of color and one of gray per pixel.
    let num_pixels = header.width as usize * header.height as usize;
    let total = num_bytes as u64 + 4 * num_pixels as u64;
    check_limit("decoding memory in bytes", total, limits.max_alloc_bytes)?;

    let mut samples = vec![0; num_bytes];
    let info = reader.next_frame(&mut samples).map_err(from_png)?;
    reader.finish().map_err(from_png)?; // the end chunk must be there
    if (info.width, info.height) != (header.width, header.height) {
        return Err(DecodeError::Damaged { detail: "frame size differs from header".into() });
    }
    let num_channels = info.color_type.samples();
    if info.bit_depth == png::BitDepth::Sixteen {
        round_to_8_bits(&mut samples);
    }
    if samples.len() < num_pixels * num_channels {
        return Err(DecodeError::Damaged { detail: "too few samples".into() });
    }
    let (width, height) = (header.width, header.height);
    match info.color_type {
        ColorType::Grayscale | ColorType::GrayscaleAlpha => {
            let gray = upright_gray(width, height, orientation, |i| samples[i * num_channels]);
            Ok(Planes { gray, color: None })
        }
        ColorType::Rgb | ColorType::Rgba => {
            keep_three_of(&mut samples, num_channels, num_pixels);
            let luma =
                |i: usize| luma_from_rgb(samples[3 * i], samples[3 * i + 1], samples[3 * i + 2]);
            let gray = upright_gray(width, height, orientation, luma);
            let color = ColorImage::new(width, height, orientation, ColorSpace::Rgb, samples);
            Ok(Planes { gray, color: Some(color) })
        }
        ColorType::Indexed => {
            Err(DecodeError::Unsupported { detail: "PNG palette was not expanded".into() })
        }
    }
}

/// Big-endian 16-bit samples to 8 bits in place: v / 257, rounded.
fn round_to_8_bits(samples: &mut Vec<u8>) {
    let num_samples = samples.len() / 2;
    for i in 0..num_samples {
        let value = u32::from(u16::from_be_bytes([samples[2 * i], samples[2 * i + 1]]));
        samples[i] = ((value + 128) / 257) as u8;
    }
    samples.truncate(num_samples);
}

/// Drops alpha in place.
fn keep_three_of(samples: &mut Vec<u8>, num_channels: usize, num_pixels: usize) {
    if num_channels > 3 {
        for i in 0..num_pixels {
            samples.copy_within(i * num_channels..i * num_channels + 3, 3 * i);
        }
    }
    samples.truncate(3 * num_pixels);
    samples.shrink_to_fit();
}

fn from_png(error: DecodingError) -> DecodeError {
    match error {
        DecodingError::IoError(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => {
            DecodeError::Truncated { detail: error.to_string() }
        }
        DecodingError::LimitsExceeded => DecodeError::Damaged {
            detail: "a chunk asks for more memory than an image of this size needs".into(),
        },
        other => DecodeError::Damaged { detail: other.to_string() },
    }
}
