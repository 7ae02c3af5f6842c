//! Format and size from the first bytes, and whether the last ones are there.

use super::{DecodeError, ImageFormat, ImageHeader};

const PNG_SIGNATURE: &[u8; 8] = b"\x89PNG\r\n\x1a\n";
const JPEG_SIGNATURE: &[u8; 3] = b"\xff\xd8\xff";

/// Marker codes of JPEG (ITU-T T.81, table B.1).
mod marker {
    pub(super) const SOI: u8 = 0xd8;
    pub(super) const EOI: u8 = 0xd9;
    pub(super) const SOS: u8 = 0xda;
    pub(super) const TEM: u8 = 0x01;

    /// Start of frame of any coding.
    pub(super) fn is_frame(code: u8) -> bool {
        (0xc0..=0xcf).contains(&code) && !matches!(code, 0xc4 | 0xc8 | 0xcc)
    }

    pub(super) fn is_restart(code: u8) -> bool {
        (0xd0..=0xd7).contains(&code)
    }
}

/// Format and stored size of an image, reading its header only.
pub fn sniff(bytes: &[u8]) -> Result<ImageHeader, DecodeError> {
    if bytes.is_empty() {
        return Err(DecodeError::EmptyFile);
    }
    if bytes.starts_with(PNG_SIGNATURE) {
        return sniff_png(bytes);
    }
    if bytes.starts_with(JPEG_SIGNATURE) {
        let frame = walk_jpeg(bytes, Until::Frame)?;
        return Ok(ImageHeader {
            format: ImageFormat::Jpeg,
            width: frame.width,
            height: frame.height,
        });
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
        return Err(DecodeError::Damaged { detail: "PNG without header chunk".into() });
    }
    let side =
        |at: usize| u32::from_be_bytes([chunk[at], chunk[at + 1], chunk[at + 2], chunk[at + 3]]);
    let (width, height) = (side(4), side(8));
    if width == 0 || height == 0 {
        return Err(DecodeError::Damaged { detail: format!("size {width} x {height}") });
    }
    Ok(ImageHeader { format: ImageFormat::Png, width, height })
}

/// The frame header of a JPEG.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct JpegFrame {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) num_components: u8,
    /// Coefficients of the whole image are kept until its last scan.
    pub(super) progressive: bool,
}

#[derive(Clone, Copy, PartialEq)]
enum Until {
    /// The frame header.
    Frame,
    /// The end marker.
    End,
}

/// Walks all segments and scans of a JPEG to its end marker. Decoders invent gray pixels where
/// bytes are missing, so this is what tells a whole file from a cut one.
pub(super) fn check_complete_jpeg(bytes: &[u8]) -> Result<JpegFrame, DecodeError> {
    walk_jpeg(bytes, Until::End)
}

fn walk_jpeg(bytes: &[u8], until: Until) -> Result<JpegFrame, DecodeError> {
    let mut at = 2;
    let mut frame = None;
    let mut num_scans = 0;
    loop {
        at = next_marker(bytes, at)
            .ok_or_else(|| truncated(&format!("no end marker after {num_scans} scans")))?;
        let code = bytes[at];
        at += 1;
        match code {
            marker::EOI => {
                let frame = frame.ok_or_else(|| damaged("JPEG without frame header"))?;
                return if num_scans > 0 { Ok(frame) } else { Err(damaged("JPEG without scan")) };
            }
            marker::SOI | marker::TEM => continue,
            code if marker::is_restart(code) => continue,
            _ => {}
        }
        let missing = || truncated(&format!("segment at byte {at}"));
        let length = bytes.get(at..at + 2).ok_or_else(missing)?;
        let length = usize::from(u16::from_be_bytes([length[0], length[1]]));
        let segment = bytes.get(at..at + length).ok_or_else(missing)?;
        if length < 2 {
            return Err(damaged("JPEG segment without length"));
        }
        if marker::is_frame(code) && frame.is_none() {
            frame = Some(read_frame(code, segment)?);
            if until == Until::Frame {
                return Ok(frame.expect("just set"));
            }
        }
        at += length;
        if code == marker::SOS {
            num_scans += 1;
        }
    }
}

/// Position after the 0xff of the next marker, skipping entropy-coded bytes: stuffed zeros and
/// fill bytes are no markers.
fn next_marker(bytes: &[u8], mut at: usize) -> Option<usize> {
    loop {
        at += bytes.get(at..)?.iter().position(|&byte| byte == 0xff)?;
        while *bytes.get(at)? == 0xff {
            at += 1;
        }
        if bytes[at] != 0 {
            return Some(at);
        }
    }
}

fn read_frame(code: u8, segment: &[u8]) -> Result<JpegFrame, DecodeError> {
    // Length, precision, height, width, number of components.
    let [_, _, precision, h1, h0, w1, w0, num_components, ..] = *segment else {
        return Err(damaged("JPEG frame header is too short"));
    };
    let (width, height) = (u16::from_be_bytes([w1, w0]), u16::from_be_bytes([h1, h0]));
    if !(0xc0..=0xc2).contains(&code) {
        let detail = format!("JPEG coding process {}", code - 0xc0);
        return Err(DecodeError::Unsupported { detail });
    }
    if precision != 8 {
        return Err(DecodeError::Unsupported { detail: format!("JPEG of {precision} bits") });
    }
    if width == 0 || height == 0 {
        return Err(damaged(&format!("size {width} x {height}")));
    }
    Ok(JpegFrame {
        width: width.into(),
        height: height.into(),
        num_components,
        progressive: code == 0xc2,
    })
}

fn truncated(detail: &str) -> DecodeError {
    DecodeError::Truncated { detail: detail.into() }
}

fn damaged(detail: &str) -> DecodeError {
    DecodeError::Damaged { detail: detail.into() }
}
