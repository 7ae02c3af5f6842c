use super::*;

const MAX: usize = 1000;

fn reader(boundary: &str) -> Multipart {
    Multipart::new(&format!("multipart/x-mixed-replace; boundary={boundary}"), MAX).unwrap()
}

/// Parts of bytes that come in these pieces, and how it ended.
fn read<'a>(
    mut multipart: Multipart,
    pieces: impl IntoIterator<Item = &'a [u8]>,
) -> (Vec<Part>, Result<bool, MultipartError>) {
    let mut parts = Vec::new();
    for piece in pieces {
        multipart.push(piece);
        loop {
            match multipart.next() {
                Ok(Some(part)) => parts.push(part),
                Ok(None) => break,
                Err(error) => return (parts, Err(error)),
            }
        }
    }
    (parts, Ok(multipart.has_ended()))
}

/// Numbers that only look random.
fn random(state: &mut u64) -> usize {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*state >> 33) as usize
}

/// Pictures full of what could be taken for a boundary.
fn pictures() -> Vec<Vec<u8>> {
    let mut seed = 1;
    let traps: [&[u8]; 8] = [
        b"\r\n",
        b"\n",
        b"--framed",
        b"\r\n--fram",
        b"\r\n--frame2\r\n",
        b"\r\n\r\n",
        b"-",
        b"\xff",
    ];
    (0..20)
        .map(|_| {
            let mut picture = b"\xff\xd8\xff".to_vec();
            for _ in 0..random(&mut seed) % 40 {
                picture.extend_from_slice(traps[random(&mut seed) % traps.len()]);
            }
            [&picture[..], b"\xff\xd9"].concat()
        })
        .collect()
}

/// As a camera sends them.
fn stream(pictures: &[Vec<u8>], has_length: bool, line_end: &str) -> Vec<u8> {
    let mut bytes = b"hello\r\n".to_vec();
    for (index, picture) in pictures.iter().enumerate() {
        let mut head = format!("--frame{line_end}Content-Type: image/jpeg{line_end}");
        if has_length {
            head += &format!("content-length: {}{line_end}", picture.len());
        }
        head += &format!("X-Timestamp: {index}.250000{line_end}{line_end}");
        bytes.extend_from_slice(head.as_bytes());
        bytes.extend_from_slice(picture);
        bytes.extend_from_slice(line_end.as_bytes());
    }
    [&bytes[..], b"--frame--", line_end.as_bytes()].concat()
}

/// The same pictures come out however the bytes are cut, with lengths and without.
#[test]
fn any_cut_gives_the_same_pictures() {
    let pictures = pictures();
    let expected: Vec<_> = (0_u8..)
        .zip(&pictures)
        .map(|(index, picture)| Part {
            bytes: picture.clone().into(),
            stamp_s: Some(f64::from(index) + 0.25),
        })
        .collect();
    for (has_length, line_end) in [(true, "\r\n"), (false, "\r\n"), (true, "\n"), (false, "\n")] {
        let bytes = stream(&pictures, has_length, line_end);
        for cut in 0..bytes.len() {
            let (one, two) = bytes.split_at(cut);
            assert_eq!(read(reader("frame"), [one, two]), (expected.clone(), Ok(true)), "{cut}");
        }
        assert_eq!(read(reader("frame"), bytes.chunks(1)), (expected.clone(), Ok(true)));
        for mut seed in 0..200 {
            let (mut rest, mut pieces) = (&bytes[..], Vec::new());
            while !rest.is_empty() {
                let (piece, after) = rest.split_at((random(&mut seed) % 100).min(rest.len()));
                pieces.push(piece);
                rest = after;
            }
            assert_eq!(read(reader("frame"), pieces), (expected.clone(), Ok(true)));
        }
    }
}

/// A JPEG is there with its last byte too, and what a camera adds to it does not count; the line end
/// of an empty part is the boundary's.
#[test]
fn a_jpeg_needs_neither_length_nor_boundary() {
    let jpeg = jpeg_end::tests::jpeg();
    let one = [b"--frame\r\n\r\n", &jpeg[..]].concat();
    let (parts, end) = read(reader("frame"), [&one[..]]);
    assert_eq!((parts.len(), end), (1, Ok(false)));
    let whole = [&one[..], b"\0\0\r\n", &one, b"\r\n--frame\r\n\r\n\r\n--frame--\r\n"].concat();
    let pictures: Vec<Bytes> = vec![jpeg.clone().into(), jpeg.into(), Bytes::new()];
    for cut in 0..whole.len() {
        let (one, two) = whole.split_at(cut);
        let (parts, end) = read(reader("frame"), [one, two]);
        assert_eq!(end, Ok(true), "{cut}");
        assert!(parts.iter().map(|part| &part.bytes).eq(&pictures), "{cut}");
    }
}

/// A part of known length is there with its last byte: nobody waits for the next boundary.
#[test]
fn a_length_needs_no_boundary() {
    let bytes = b"--frame\r\nContent-Length: 3\r\n\r\nabc";
    let (parts, end) = read(reader("frame"), [&bytes[..]]);
    assert_eq!((parts.len(), end), (1, Ok(false)));
    assert_eq!(parts[0], Part { bytes: Bytes::from_static(b"abc"), stamp_s: None });
}

/// Quotes, and dashes that some cameras count as the boundary's own.
#[test]
fn boundaries_of_sloppy_cameras() {
    let bytes = b"--frame\r\n\r\nabc\r\n--frame\r\n";
    for boundary in ["frame", "\"frame\"", "--frame", "\"--frame\"", " frame ; charset=x"] {
        let (parts, end) = read(reader(boundary), [&bytes[..]]);
        assert_eq!((parts.len(), end), (1, Ok(false)), "{boundary}");
    }
    for content_type in [
        "image/jpeg",
        "text/html; boundary=frame",
        "multipart/x-mixed-replace",
        "multipart/x-mixed-replace; boundary=",
        "multipart/x-mixed-replace; boundary=\"--\"",
    ] {
        assert!(Multipart::new(content_type, MAX).is_none(), "{content_type}");
    }
    let named = Multipart::new("Multipart/X-Mixed-Replace;BOUNDARY=frame", MAX).unwrap();
    assert_eq!(read(named, [&bytes[..]]).0.len(), 1);
}

/// A length that lies, one that is none, and heads and pictures without an end are named.
#[test]
fn nonsense_is_refused() {
    let head = |fields: &str| format!("--frame\r\n{fields}\r\n").into_bytes();
    let with = |fields: &str, body: &[u8]| [&head(fields)[..], body].concat();
    let long = vec![b'x'; 100_000];
    let lines = [b'\n'; 100_000];
    for (bytes, error) in [
        (with("Content-Length: 2\r\n", b"abcdef\r\n"), MultipartError::WrongLength),
        (with("Content-Length: -2\r\n", b""), MultipartError::BadLength),
        (with("Content-Length: 1001\r\n", b""), MultipartError::TooLarge(MAX)),
        (with("", &long), MultipartError::TooLarge(MAX)),
        (with("", &lines), MultipartError::TooLarge(MAX)),
        (with(&format!("A: {}\r\n", "a".repeat(MAX_HEAD)), b""), MultipartError::HeadTooLong),
        (with(&"A: a\r\n".repeat(MAX_HEAD), b""), MultipartError::HeadTooLong),
        (long, MultipartError::HeadTooLong),
        (lines.to_vec(), MultipartError::NoBoundary),
    ] {
        for size in [1, 7, 1 << 20] {
            assert_eq!(read(reader("frame"), bytes.chunks(size)).1, Err(error), "{size}");
        }
    }
}

/// Bytes of which nothing comes are not kept beyond the limits.
#[test]
fn memory_is_bounded() {
    for head in ["", "--frame\r\n", "--frame\r\n\r\n", "--frame\r\nContent-Length: 1000\r\n\r\n"] {
        for filler in [b"x", b"\n"] {
            let mut multipart = reader("frame");
            multipart.push(head.as_bytes());
            for _ in 0..200_000 {
                if multipart.next().is_err() {
                    break;
                }
                assert!(multipart.buffer.len() <= MAX + MAX_HEAD);
                multipart.push(filler);
            }
        }
    }
}

/// A stamp that is none is no stamp.
#[test]
fn stamps_are_numbers() {
    for (text, stamp_s) in [("1.5", Some(1.5)), ("inf", None), ("-1", None), ("noon", None)] {
        let bytes = format!("--frame\r\nX-Timestamp: {text}\r\nContent-Length: 1\r\n\r\na");
        let (parts, _) = read(reader("frame"), [bytes.as_bytes()]);
        assert_eq!(parts[0].stamp_s, stamp_s, "{text}");
    }
}
