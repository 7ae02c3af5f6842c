//! The segments of a JPEG file (ITU-T T.81, annex B).

use super::DecodeError;

/// Marker codes (table B.1).
pub(super) mod marker {
    pub(crate) const DHT: u8 = 0xc4;
    pub(crate) const SOI: u8 = 0xd8;
    pub(crate) const EOI: u8 = 0xd9;
    pub(crate) const SOS: u8 = 0xda;
    pub(crate) const DRI: u8 = 0xdd;
    pub(crate) const TEM: u8 = 0x01;

    /// Start of frame of any coding.
    pub(crate) fn is_frame(code: u8) -> bool {
        (0xc0..=0xcf).contains(&code) && !matches!(code, DHT | 0xc8 | 0xcc)
    }

    /// Between two restart intervals of a scan.
    pub(crate) fn is_restart(code: u8) -> bool {
        (0xd0..=0xd7).contains(&code)
    }
}

/// A marker with what belongs to it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Segment<'a> {
    /// Its marker.
    pub(super) code: u8,
    /// What follows its length.
    pub(super) body: &'a [u8],
    /// What follows the segment: behind [`marker::SOS`], entropy-coded data.
    pub(super) rest: &'a [u8],
}

/// Walks from segment to segment, to the end marker.
#[derive(Debug, Clone)]
pub(super) struct Segments<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Segments<'a> {
    /// Of a file that starts with [`marker::SOI`].
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 2 }
    }

    /// The next one; `None` at the end marker. A file that ends before it is cut off.
    pub(super) fn next(&mut self) -> Result<Option<Segment<'a>>, DecodeError> {
        loop {
            let at = next_marker(self.bytes, self.at).ok_or_else(|| truncated("no end marker"))?;
            let code = self.bytes[at];
            self.at = at + 1;
            match code {
                marker::EOI => return Ok(None),
                marker::SOI | marker::TEM => continue,
                code if marker::is_restart(code) => continue,
                _ => {}
            }
            let missing = || truncated(&format!("segment at byte {at}"));
            let rest = &self.bytes[self.at..];
            let (length, _) = rest.split_first_chunk().ok_or_else(missing)?;
            let length = usize::from(u16::from_be_bytes(*length));
            let (segment, rest) = rest.split_at_checked(length).ok_or_else(missing)?;
            let body = segment.get(2..).ok_or_else(|| damaged("JPEG segment without length"))?;
            self.at += length;
            return Ok(Some(Segment { code, body, rest }));
        }
    }
}

/// Position after the 0xff of the next marker, skipping entropy-coded bytes: stuffed zeros and
/// fill bytes are no markers.
pub(super) fn next_marker(bytes: &[u8], mut at: usize) -> Option<usize> {
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

pub(super) fn truncated(detail: &str) -> DecodeError {
    DecodeError::Truncated { detail: detail.into() }
}

pub(super) fn damaged(detail: &str) -> DecodeError {
    DecodeError::Damaged { detail: detail.into() }
}
