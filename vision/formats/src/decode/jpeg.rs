//! JPEG by zune-jpeg.

use zune_core::bytestream::ZCursor;
use zune_core::colorspace::ColorSpace as ZuneSpace;
use zune_core::options::DecoderOptions;
use zune_jpeg::JpegDecoder;
use zune_jpeg::errors::DecodeErrors;

use super::color::{ColorImage, ColorSpace, luma_from_rgb};
use super::complete::check_complete_jpeg;
use super::orientation::{Orientation, upright_gray};
use super::{DecodeError, DecodeLimits, ImageHeader, Planes, check_limit};

/// More scans than this are an attack: a progressive photo has about ten.
const MAX_SCANS: usize = 64;

pub(super) fn decode(
    bytes: &[u8],
    header: &ImageHeader,
    orientation: Orientation,
    limits: &DecodeLimits,
) -> Result<Planes, DecodeError> {
    let frame = check_complete_jpeg(bytes)?;
    let num_channels = frame.components.len() as u64;
    // Samples and the gray plane; a progressive image also keeps its 16-bit coefficients.
    let bytes_per_pixel = num_channels + 1 + if frame.progressive { 2 * num_channels } else { 0 };
    let num_pixels = u64::from(header.width) * u64::from(header.height);
    check_limit("decoding memory in bytes", num_pixels * bytes_per_pixel, limits.max_alloc_bytes)?;

    let (space, samples) = match decode_samples(bytes, true) {
        // Some cameras leave stray bytes between segments, which is harmless.
        Err(DecodeErrors::FormatStatic(reason)) if reason.contains("Extra bytes") => {
            decode_samples(bytes, false)
        }
        result => result,
    }
    .map_err(from_zune)?;

    let (width, height) = (header.width, header.height);
    let num_pixels = num_pixels as usize;
    let (gray, color) = match (space, samples) {
        (ZuneSpace::Luma, samples) if samples.len() == num_pixels => {
            (upright_gray(width, height, orientation, |i| samples[i]), None)
        }
        (ZuneSpace::YCbCr, samples) if samples.len() == 3 * num_pixels => {
            let gray = upright_gray(width, height, orientation, |i| samples[3 * i]);
            (gray, Some((ColorSpace::YCbCr, samples)))
        }
        (ZuneSpace::RGB, samples) if samples.len() == 3 * num_pixels => {
            let luma =
                |i: usize| luma_from_rgb(samples[3 * i], samples[3 * i + 1], samples[3 * i + 2]);
            let gray = upright_gray(width, height, orientation, luma);
            (gray, Some((ColorSpace::Rgb, samples)))
        }
        _ => return Err(DecodeError::Damaged { detail: "unexpected number of samples".into() }),
    };
    let color =
        color.map(|(space, samples)| ColorImage::new(width, height, orientation, space, samples));
    Ok(Planes { gray, color })
}

/// Samples in the file's own color space: no conversion is paid for that nobody asks for.
fn decode_samples(bytes: &[u8], strict: bool) -> Result<(ZuneSpace, Vec<u8>), DecodeErrors> {
    let options = DecoderOptions::default()
        .set_strict_mode(strict)
        .set_max_width(usize::from(u16::MAX))
        .set_max_height(usize::from(u16::MAX))
        .jpeg_set_max_scans(MAX_SCANS);
    // The decoder is known to panic on damaged input; that is an answer, not a crash.
    let result = std::panic::catch_unwind(|| {
        let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
        decoder.decode_headers()?;
        let space = match decoder.input_colorspace() {
            Some(space @ (ZuneSpace::Luma | ZuneSpace::YCbCr | ZuneSpace::RGB)) => space,
            other => return Err(DecodeErrors::Format(format!("color space {other:?}"))),
        };
        decoder.set_options(options.jpeg_set_out_colorspace(space));
        Ok((space, decoder.decode()?))
    });
    result.unwrap_or(Err(DecodeErrors::FormatStatic("the decoder gave up")))
}

fn from_zune(error: DecodeErrors) -> DecodeError {
    match error {
        DecodeErrors::Unsupported(_) => DecodeError::Unsupported { detail: format!("{error:?}") },
        DecodeErrors::ExhaustedData
        | DecodeErrors::IoErrors(_)
        | DecodeErrors::FormatStatic("Premature end of buffer") => {
            DecodeError::Truncated { detail: format!("{error:?}") }
        }
        _ => DecodeError::Damaged { detail: format!("{error:?}") },
    }
}
