//! `multipart/x-mixed-replace`: the pictures of a camera, one after another in an answer that does
//! not end (RFC 2046, 5.1, and what small cameras make of it). Pure: bytes come as they come.

mod jpeg_end;
#[cfg(test)]
mod tests;

use bytes::{Buf, Bytes, BytesMut};

use jpeg_end::JpegEnd;

/// Longest line, and longest head of a part, bytes.
const MAX_HEAD: usize = 8 << 10;
/// Most bytes before the first boundary.
const MAX_PREAMBLE: usize = 64 << 10;

/// A picture with what its camera says of it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Part {
    pub(super) bytes: Bytes,
    /// `X-Timestamp`: seconds of the camera's clock.
    pub(super) stamp_s: Option<f64>,
}

/// Why bytes are no parts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(super) enum MultipartError {
    /// A line or a head does not end.
    #[error("a part's head is longer than {MAX_HEAD} bytes")]
    HeadTooLong,
    /// Other things than parts.
    #[error("no boundary in the first {MAX_PREAMBLE} bytes")]
    NoBoundary,
    /// `Content-Length` is no number of bytes.
    #[error("the length of a part is no number")]
    BadLength,
    /// `Content-Length` is not the part's.
    #[error("a part does not end where its length says")]
    WrongLength,
    /// More bytes than a picture may have.
    #[error("a picture is larger than {0} bytes")]
    TooLarge(usize),
}

/// What the next bytes belong to.
#[derive(Debug, Clone, Copy, PartialEq)]
enum State {
    /// Anything, up to a boundary; so many bytes have gone by.
    Preamble(usize),
    /// Nothing but a boundary: a part of known length has ended.
    Boundary,
    /// Header fields of a part.
    Head(Head),
    /// A part; without a length it goes on to the end of its JPEG, or to the next boundary.
    Body(Head),
    /// The camera has said that there are no more.
    Ended,
}

#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Head {
    num_bytes: usize,
    length: Option<usize>,
    stamp_s: Option<f64>,
}

/// What a line is, between parts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Line {
    Boundary,
    End,
    Other,
}

/// Finds the parts in the bytes of an answer.
#[derive(Debug)]
pub(super) struct Multipart {
    /// As they stand at the begin of a line.
    boundaries: Vec<Vec<u8>>,
    max_bytes: usize,
    buffer: BytesMut,
    /// Bytes of the buffer in which no boundary begins.
    searched: usize,
    jpeg_end: JpegEnd,
    state: State,
}

impl Multipart {
    /// * `content_type`: of the answer.
    /// * `max_bytes`: of a picture.
    /// * Returns `None` if the answer is not made of parts.
    pub(super) fn new(content_type: &str, max_bytes: usize) -> Option<Self> {
        let (kind, parameters) = content_type.split_once(';')?;
        if !kind.trim().to_ascii_lowercase().starts_with("multipart/") {
            return None;
        }
        let boundary = parameters.split(';').find_map(|parameter| {
            let (name, value) = parameter.split_once('=')?;
            name.trim().eq_ignore_ascii_case("boundary").then(|| value.trim().trim_matches('"'))
        })?;
        if boundary.trim_start_matches('-').is_empty() {
            return None;
        }
        // Some cameras count the dashes before a boundary as its own.
        let mut boundaries = vec![format!("--{boundary}").into_bytes()];
        if boundary.starts_with("--") {
            boundaries.push(boundary.as_bytes().to_vec());
        }
        let state = State::Preamble(0);
        let (buffer, jpeg_end) = (BytesMut::new(), JpegEnd::default());
        Some(Self { boundaries, max_bytes, buffer, searched: 0, jpeg_end, state })
    }

    /// Takes bytes as they came.
    pub(super) fn push(&mut self, bytes: &[u8]) {
        self.buffer.extend_from_slice(bytes);
    }

    /// Whether some bytes of a picture have come, and others have not.
    pub(super) fn has_begun(&self) -> bool {
        matches!(self.state, State::Body(_)) && !self.buffer.is_empty()
    }

    /// Whether the camera has said that there are no more parts.
    pub(super) fn has_ended(&self) -> bool {
        self.state == State::Ended
    }

    /// The next whole part, if its last byte has come.
    ///
    /// # Errors
    ///
    /// [`MultipartError`] if the bytes are no parts; those that follow make no sense then.
    pub(super) fn next(&mut self) -> Result<Option<Part>, MultipartError> {
        loop {
            match self.state {
                State::Ended => return Ok(None),
                State::Body(head) => return self.body(head),
                State::Preamble(gone) => {
                    let Some(line) = self.line()? else { return Ok(None) };
                    let gone = gone + line.len();
                    match self.is(&line) {
                        Line::Other if gone > MAX_PREAMBLE => {
                            return Err(MultipartError::NoBoundary);
                        }
                        Line::Other => self.state = State::Preamble(gone),
                        found => self.begin(found),
                    }
                }
                State::Boundary => {
                    let Some(line) = self.line()? else { return Ok(None) };
                    match self.is(&line) {
                        Line::Other if line.trim_ascii().is_empty() => {}
                        Line::Other => return Err(MultipartError::WrongLength),
                        found => self.begin(found),
                    }
                }
                State::Head(head) => {
                    let Some(line) = self.line()? else { return Ok(None) };
                    self.state = if line.trim_ascii().is_empty() {
                        State::Body(head)
                    } else {
                        State::Head(self.field(head, &line)?)
                    };
                }
            }
        }
    }

    fn begin(&mut self, found: Line) {
        self.searched = 0;
        self.jpeg_end = JpegEnd::default();
        self.state = if found == Line::End { State::Ended } else { State::Head(Head::default()) };
    }

    /// The next line with its end.
    fn line(&mut self) -> Result<Option<Bytes>, MultipartError> {
        match self.buffer.iter().take(MAX_HEAD).position(|byte| *byte == b'\n') {
            Some(end) => Ok(Some(self.buffer.split_to(end + 1).freeze())),
            None if self.buffer.len() >= MAX_HEAD => Err(MultipartError::HeadTooLong),
            None => Ok(None),
        }
    }

    fn is(&self, line: &[u8]) -> Line {
        let rest = self.boundaries.iter().find_map(|boundary| line.strip_prefix(&boundary[..]));
        match rest.map(<[u8]>::trim_ascii) {
            Some(b"") => Line::Boundary,
            Some(b"--") => Line::End,
            _ => Line::Other,
        }
    }

    /// Takes a header field, if it is one that counts.
    fn field(&self, mut head: Head, line: &[u8]) -> Result<Head, MultipartError> {
        head.num_bytes += line.len();
        if head.num_bytes > MAX_HEAD {
            return Err(MultipartError::HeadTooLong);
        }
        let text = String::from_utf8_lossy(line);
        let Some((name, value)) = text.split_once(':') else { return Ok(head) };
        if name.trim().eq_ignore_ascii_case("content-length") {
            let length = value.trim().parse().map_err(|_| MultipartError::BadLength)?;
            if length > self.max_bytes {
                return Err(MultipartError::TooLarge(self.max_bytes));
            }
            head.length = Some(length);
        } else if name.trim().eq_ignore_ascii_case("x-timestamp") {
            let seconds = value.trim().parse().ok();
            head.stamp_s = seconds.filter(|s: &f64| s.is_finite() && *s >= 0.0);
        }
        Ok(head)
    }

    fn body(&mut self, head: Head) -> Result<Option<Part>, MultipartError> {
        let bytes = match head.length {
            Some(length) if self.buffer.len() < length => return Ok(None),
            Some(length) => {
                self.state = State::Boundary;
                self.buffer.split_to(length).freeze()
            }
            None => match self.up_to_end() {
                Some(bytes) => bytes,
                None if self.buffer.len() > self.max_bytes + MAX_HEAD => {
                    return Err(MultipartError::TooLarge(self.max_bytes));
                }
                None => return Ok(None),
            },
        };
        if bytes.len() > self.max_bytes {
            return Err(MultipartError::TooLarge(self.max_bytes));
        }
        Ok(Some(Part { bytes, stamp_s: head.stamp_s }))
    }

    /// The bytes to the end of the JPEG, or of the part, if that comes first.
    fn up_to_end(&mut self) -> Option<Bytes> {
        let jpeg_end = self.jpeg_end.find(&self.buffer);
        let part_end = self.boundary();
        match (jpeg_end, part_end) {
            (Some(end), part_end) if part_end.is_none_or(|(start, ..)| end < start) => {
                // What some cameras add to it does not count.
                self.state = State::Preamble(0);
                Some(self.buffer.split_to(end).freeze())
            }
            (_, Some((start, end, line))) => {
                // The line end before a boundary belongs to it.
                let mut bytes = self.buffer.split_to(start - 1).freeze();
                if bytes.ends_with(b"\r") {
                    bytes.truncate(bytes.len() - 1);
                }
                self.buffer.advance(end + 2 - start);
                self.begin(line);
                Some(bytes)
            }
            _ => None,
        }
    }

    /// Where the line of the next boundary begins and ends, if that is known, and what it is.
    fn boundary(&mut self) -> Option<(usize, usize, Line)> {
        while let Some(found) = self.buffer[self.searched..].iter().position(|b| *b == b'\n') {
            let start = self.searched + found + 1;
            let ahead = &self.buffer[start..];
            let is_possible = self.boundaries.iter().any(|boundary| {
                let length = boundary.len().min(ahead.len());
                ahead[..length] == boundary[..length]
            });
            if is_possible {
                let Some(length) = ahead.iter().take(MAX_HEAD).position(|b| *b == b'\n') else {
                    // The rest of the line tells, unless there is far too much of it.
                    if ahead.len() < MAX_HEAD {
                        self.searched = start - 1;
                        return None;
                    }
                    self.searched = start;
                    continue;
                };
                let line = self.is(&ahead[..=length]);
                if line != Line::Other {
                    self.searched = start - 1;
                    return Some((start, start + length, line));
                }
            }
            self.searched = start;
        }
        self.searched = self.buffer.len();
        None
    }
}
