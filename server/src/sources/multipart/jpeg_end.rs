//! Where a JPEG ends (ITU-T T.81, B.1): the only way to know it before the next part begins, for a
//! part without a length. Pure.

/// Walks over a JPEG whose bytes come as they come.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct JpegEnd {
    /// Bytes that are behind.
    at: usize,
    step: Step,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
enum Step {
    #[default]
    Start,
    /// A marker comes.
    Marker,
    /// Entropy-coded data, up to a marker.
    Scan,
    /// It is no JPEG.
    Lost,
}

impl JpegEnd {
    /// Goes on over `bytes`, which begin as those of the last call; the length of the JPEG, once its
    /// end is among them.
    pub(super) fn find(&mut self, bytes: &[u8]) -> Option<usize> {
        loop {
            match self.step {
                Step::Lost => return None,
                Step::Start => {
                    let start = bytes.first_chunk::<2>()?;
                    self.step = if *start == [0xff, 0xd8] { Step::Marker } else { Step::Lost };
                    self.at = 2;
                }
                Step::Scan => {
                    let rest = bytes.get(self.at..)?;
                    // Stuffed zeros and restarts belong to the data.
                    let marker = rest
                        .windows(2)
                        .position(|b| b[0] == 0xff && !matches!(b[1], 0 | 0xd0..=0xd7));
                    let Some(marker) = marker else {
                        self.at += rest.len().saturating_sub(1);
                        return None;
                    };
                    self.at += marker;
                    self.step = Step::Marker;
                }
                Step::Marker => match *bytes.get(self.at..)?.first_chunk::<2>()? {
                    [0xff, 0xff] => self.at += 1,
                    [0xff, 0xd9] => return Some(self.at + 2),
                    [0xff, 0x01 | 0xd0..=0xd7] => self.at += 2,
                    [0xff, marker @ 0xc0..=0xff] => {
                        let [high, low] = *bytes.get(self.at + 2..)?.first_chunk::<2>()?;
                        let length = usize::from(u16::from_be_bytes([high, low]));
                        self.at += 2 + length;
                        self.step = match (length, marker) {
                            (..2, _) | (_, 0xd8) => Step::Lost,
                            (_, 0xda) => Step::Scan,
                            _ => Step::Marker,
                        };
                    }
                    _ => self.step = Step::Lost,
                },
            }
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A JPEG in form: a segment with an end of its own inside, as a thumbnail has it, and two scans.
    pub(in super::super) fn jpeg() -> Vec<u8> {
        [
            &[0xff, 0xd8, 0xff, 0xe1, 0, 8, 0xff, 0xd8, b'\n', b'-', 0xff, 0xd9][..],
            &[0xff, 0xff, 0xdb, 0, 2, 0xff, 0xda, 0, 3, 1],
            &[1, 2, 0xff, 0, 3, 0xff, 0xd0, 4, 0xff, 0xc4, 0, 4, 9, 9, 0xff, 0xda, 0, 2, 0xff, 0],
            &[0xff, 0xff, 0xd9],
        ]
        .concat()
    }

    #[test]
    fn the_end_is_found_however_the_bytes_come() {
        let whole = jpeg();
        let more = [&whole[..], b"\r\n--cut\r\n"].concat();
        assert_eq!(JpegEnd::default().find(&more), Some(whole.len()));
        for first in 0..more.len() {
            let mut end = JpegEnd::default();
            let found = end.find(&more[..first]);
            assert_eq!(found, (first >= whole.len()).then_some(whole.len()), "{first} bytes");
            assert_eq!(end.find(&more), Some(whole.len()), "after {first} bytes");
        }
        let mut end = JpegEnd::default();
        let found = (0..=more.len()).find_map(|length| end.find(&more[..length]));
        assert_eq!(found, Some(whole.len()));
    }

    #[test]
    fn what_is_no_jpeg_has_no_end() {
        for bytes in [
            &b"\x89PNG\xff\xd9"[..],
            b"\xff\xd8\xff\xe0\x00\x01\xff\xd9",
            b"\xff\xd8\x00\xff\xd9",
            b"\xff\xd8\xff\x10\xff\xd9",
            b"\xff\xd8\xff\xd8\xff\xd9",
            b"\xff\xd8\xff\xe0\xff\xff\xff\xd9",
        ] {
            assert_eq!(JpegEnd::default().find(bytes), None, "{bytes:x?}");
        }
    }
}
