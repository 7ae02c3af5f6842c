//! Format and size from the first bytes.

use super::frame::read_frame;
use super::segments::{Segments, damaged, marker, truncated};
use super::{DecodeError, ImageFormat, ImageHeader};

const PNG_SIGNATURE: &[u8; 8] = b"\x89PNG\r\n\x1a\n";
const JPEG_SIGNATURE: &[u8; 3] = b"\xff\xd8\xff";

/// Format and stored size of an image, reading its header only.
pub fn sniff(bytes: &[u8]) -> Result<ImageHeader, DecodeError> {
    if bytes.is_empty() {
        return Err(DecodeError::EmptyFile);
    }
    if bytes.starts_with(PNG_SIGNATURE) {
        return sniff_png(bytes);
    }
    if bytes.starts_with(JPEG_SIGNATURE) {
        return sniff_jpeg(bytes);
    }
    // A file that ends inside a signature is cut off rather than something else.
    if bytes.len() < 8 && (PNG_SIGNATURE.starts_with(bytes) || JPEG_SIGNATURE.starts_with(bytes)) {
        return Err(truncated("the header is missing"));
    }
    Err(DecodeError::NotAnImage)
}

fn sniff_png(bytes: &[u8]) -> Result<ImageHeader, DecodeError> {
    // Signature, chunk length, "IHDR", width, height.
    let chunk = bytes.get(12..24).ok_or_else(|| truncated("the header is missing"))?;
    if &chunk[..4] != b"IHDR" {
        return Err(damaged("PNG without header chunk"));
    }
    let side =
        |at: usize| u32::from_be_bytes([chunk[at], chunk[at + 1], chunk[at + 2], chunk[at + 3]]);
    let (width, height) = (side(4), side(8));
    if width == 0 || height == 0 {
        return Err(damaged(&format!("size {width} x {height}")));
    }
    Ok(ImageHeader { format: ImageFormat::Png, width, height })
}

fn sniff_jpeg(bytes: &[u8]) -> Result<ImageHeader, DecodeError> {
    let mut segments = Segments::new(bytes);
    while let Some(segment) = segments.next()? {
        if marker::is_frame(segment.code) {
            let frame = read_frame(segment.code, segment.body)?;
            let (width, height) = (frame.width, frame.height);
            return Ok(ImageHeader { format: ImageFormat::Jpeg, width, height });
        }
    }
    Err(damaged("JPEG without frame header"))
}
