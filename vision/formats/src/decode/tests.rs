use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};

use super::*;

const LIMITS: DecodeLimits = DecodeLimits {
    max_file_bytes: 1 << 20,
    max_pixels: 1_000_000,
    max_side: 2_000,
    max_alloc_bytes: 16 << 20,
};

fn png(width: u32, height: u32, pixels: &[u8], color: ExtendedColorType) -> Vec<u8> {
    let mut bytes = Vec::new();
    PngEncoder::new(&mut bytes).write_image(pixels, width, height, color).unwrap();
    bytes
}

fn jpeg(width: u32, height: u32, pixels: &[u8], color: ExtendedColorType) -> Vec<u8> {
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, 95)
        .write_image(pixels, width, height, color)
        .unwrap();
    bytes
}

/// A smooth picture without symmetry.
fn picture(width: u32, height: u32) -> Vec<u8> {
    let pixel = |i: u32| {
        let (x, y) = (i % width, i / width);
        (40 + 120 * x / width + 60 * y / height + if x < width / 3 { 20 } else { 0 }) as u8
    };
    (0..width * height).map(pixel).collect()
}

/// An APP1 segment with the orientation tag alone, put behind the start marker.
fn with_orientation(jpeg: &[u8], orientation: u16) -> Vec<u8> {
    let mut tiff = b"II*\0\x08\0\0\0\x01\0".to_vec();
    tiff.extend(0x0112_u16.to_le_bytes());
    tiff.extend(3_u16.to_le_bytes());
    tiff.extend(1_u32.to_le_bytes());
    tiff.extend(u32::from(orientation).to_le_bytes());
    tiff.extend([0; 4]);
    let mut bytes = jpeg[..2].to_vec();
    bytes.extend([0xff, 0xe1]);
    bytes.extend((tiff.len() as u16 + 8).to_be_bytes());
    bytes.extend(b"Exif\0\0");
    bytes.extend(tiff);
    bytes.extend(&jpeg[2..]);
    bytes
}

#[test]
fn gray_png_is_exact() {
    let pixels = picture(37, 21);
    let decoded = decode_image(&png(37, 21, &pixels, ExtendedColorType::L8), &LIMITS).unwrap();
    assert_eq!(decoded.gray.pixels(), pixels);
    assert!(decoded.color.is_none());
    assert_eq!(decoded.header, ImageHeader { format: ImageFormat::Png, width: 37, height: 21 });
}

/// 16 bits are rounded to the nearest of 256 levels, alpha is dropped, colors stay.
#[test]
fn png_of_every_depth() {
    let rgba = [10, 20, 30, 0, 200, 100, 50, 255];
    let decoded = decode_image(&png(2, 1, &rgba, ExtendedColorType::Rgba8), &LIMITS).unwrap();
    assert_eq!(decoded.rgb_at(0.5, 0.5), [10, 20, 30]);
    assert_eq!(decoded.rgb_at(1.5, 0.5), [200, 100, 50]);
    assert_eq!(decoded.gray.pixels()[1], (0.299 * 200.0 + 0.587 * 100.0 + 0.114 * 50.0_f64) as u8);

    let gray16: Vec<u8> =
        [0_u16, 128, 129, 257, 65_535].iter().flat_map(|v| v.to_ne_bytes()).collect();
    let decoded = decode_image(&png(5, 1, &gray16, ExtendedColorType::L16), &LIMITS).unwrap();
    assert_eq!(decoded.gray.pixels(), [0, 0, 1, 1, 255]);

    let rgb16: Vec<u8> =
        [257_u16 * 9, 257 * 8, 257 * 7].iter().flat_map(|v| v.to_ne_bytes()).collect();
    let decoded = decode_image(&png(1, 1, &rgb16, ExtendedColorType::Rgb16), &LIMITS).unwrap();
    assert_eq!(decoded.rgb_at(0.0, 0.0), [9, 8, 7]);
}

#[test]
fn jpeg_luma_and_color_are_close_to_what_was_written() {
    let pixels: Vec<u8> = picture(64, 48).iter().flat_map(|&v| [v, 255 - v, v / 2 + 30]).collect();
    let decoded = decode_image(&jpeg(64, 48, &pixels, ExtendedColorType::Rgb8), &LIMITS).unwrap();
    for y in 2..46 {
        // Around the edge of the picture the encoder rings.
        for x in (2..18_usize).chain(26..62) {
            let at = 3 * (y * 64 + x);
            let [r, g, b] = [pixels[at], pixels[at + 1], pixels[at + 2]].map(f64::from);
            let luma = 0.299 * r + 0.587 * g + 0.114 * b;
            let decoded_luma = f64::from(decoded.gray.row(y as u32)[x]);
            assert!((decoded_luma - luma).abs() < 6.0, "({x}, {y}): {decoded_luma} for {luma}");
            let rgb = decoded.rgb_at(x as f32 + 0.5, y as f32 + 0.5).map(f64::from);
            let error = (rgb[0] - r).abs().max((rgb[1] - g).abs()).max((rgb[2] - b).abs());
            assert!(error < 16.0, "({x}, {y}): {rgb:?} for {:?}", [r, g, b]);
        }
    }
}

/// For each of the eight orientations: the stored picture is the upright one, turned so that the
/// tag turns it back. Sides swap with the pixels.
#[test]
fn orientations_turn_pixels_once() {
    let (width, height) = (48_usize, 32_usize);
    let stored = picture(48, 32);
    let bytes = jpeg(48, 32, &stored, ExtendedColorType::L8);
    let plain = decode_image(&bytes, &LIMITS).unwrap().gray;
    let at = |x: usize, y: usize| plain.pixels()[y * width + x];
    for value in 1..=9 {
        let decoded = decode_image(&with_orientation(&bytes, value), &LIMITS).unwrap();
        let swaps = (5..=8).contains(&value);
        let size = if swaps { (height, width) } else { (width, height) };
        assert_eq!((decoded.gray.width() as usize, decoded.gray.height() as usize), size);
        // EXIF 2.32, table 6: which side of the scene row 0 and column 0 of the file are.
        for y in 0..size.1 {
            for x in 0..size.0 {
                let (last_x, last_y) = (width - 1, height - 1);
                let expected = match value {
                    2 => at(last_x - x, y),          // row 0 top, column 0 right
                    3 => at(last_x - x, last_y - y), // row 0 bottom, column 0 right
                    4 => at(x, last_y - y),          // row 0 bottom, column 0 left
                    5 => at(y, x),                   // row 0 left, column 0 top
                    6 => at(y, last_y - x),          // row 0 right, column 0 top
                    7 => at(last_x - y, last_y - x), // row 0 right, column 0 bottom
                    8 => at(last_x - y, x),          // row 0 left, column 0 bottom
                    _ => at(x, y),
                };
                assert_eq!(decoded.gray.row(y as u32)[x], expected, "{value}: ({x}, {y})");
            }
        }
    }
}

#[test]
fn colors_turn_with_the_pixels() {
    let pixels: Vec<u8> = picture(32, 16).iter().flat_map(|&v| [v, v, 255 - v]).collect();
    let bytes = jpeg(32, 16, &pixels, ExtendedColorType::Rgb8);
    for value in 1..=8 {
        let decoded = decode_image(&with_orientation(&bytes, value), &LIMITS).unwrap();
        let color = decoded.color.clone().unwrap();
        assert_eq!((color.width(), color.height()), (decoded.gray.width(), decoded.gray.height()));
        for (i, rgb) in color.to_rgb().chunks_exact(3).enumerate() {
            let luma = color::luma_from_rgb(rgb[0], rgb[1], rgb[2]);
            assert!(luma.abs_diff(decoded.gray.pixels()[i]) <= 2, "{value}: pixel {i}");
        }
    }
}

#[test]
fn every_truncation_is_an_error() {
    let pixels = picture(40, 40);
    let rgb: Vec<u8> = pixels.iter().flat_map(|&v| [v, 255 - v, 90]).collect();
    let whole = [
        jpeg(40, 40, &pixels, ExtendedColorType::L8),
        with_orientation(&jpeg(40, 40, &rgb, ExtendedColorType::Rgb8), 6),
        png(40, 40, &pixels, ExtendedColorType::L8),
        png(40, 40, &rgb, ExtendedColorType::Rgb8),
    ];
    for bytes in &whole {
        assert!(decode_image(bytes, &LIMITS).is_ok());
        for end in 0..bytes.len() {
            let error = decode_image(&bytes[..end], &LIMITS).unwrap_err();
            let expected = match end {
                0 => "empty_file",
                1 | 2 => "truncated",
                _ => error.code(),
            };
            assert_eq!(error.code(), expected, "cut at {end}: {error}");
            assert!(
                matches!(error.code(), "empty_file" | "truncated" | "damaged"),
                "cut at {end}: {error}"
            );
        }
        // What a broken transfer does: the last quarter is missing.
        let error = decode_image(&bytes[..bytes.len() * 3 / 4], &LIMITS).unwrap_err();
        assert_eq!(error.code(), "truncated", "{error}");
    }
}

/// A color photo with one scan per channel, chroma at half the size: the scans of three gray ones.
fn one_scan_per_channel() -> Vec<u8> {
    let luma = jpeg(120, 90, &picture(120, 90), ExtendedColorType::L8);
    let chroma = jpeg(60, 45, &picture(60, 45), ExtendedColorType::L8);
    let find =
        |bytes: &[u8], code: u8| bytes.windows(2).position(|pair| pair == [0xff, code]).unwrap();
    let (frame, scan) = (find(&luma, 0xc0), find(&luma, 0xda));
    let mut bytes = luma[..frame].to_vec();
    bytes.extend([0xff, 0xc0, 0, 17, 8, 0, 90, 0, 120, 3]);
    bytes.extend([1, 0x22, 0, 2, 0x11, 0, 3, 0x11, 0]);
    let after_frame = frame + 2 + usize::from(luma[frame + 3]);
    bytes.extend(&luma[after_frame..scan]);
    for (id, of) in [(1, &luma), (2, &chroma), (3, &chroma)] {
        bytes.extend([0xff, 0xda, 0, 8, 1, id, 0, 0, 63, 0]);
        bytes.extend(&of[find(of, 0xda) + 10..of.len() - 2]);
    }
    bytes.extend([0xff, 0xd9]);
    bytes
}

/// Cut short, but closed with an end marker: decoders fill in gray, which is no photo.
#[test]
fn cut_scans_with_an_end_marker_are_errors() {
    let pixels = picture(120, 90);
    let rgb: Vec<u8> = pixels.iter().flat_map(|&v| [v, 255 - v, 90]).collect();
    let files = [
        jpeg(120, 90, &pixels, ExtendedColorType::L8),
        jpeg(120, 90, &rgb, ExtendedColorType::Rgb8),
        one_scan_per_channel(),
        include_bytes!("testdata/restarts.jpg").to_vec(),
        include_bytes!("testdata/progressive.jpg").to_vec(),
    ];
    for (number, bytes) in files.iter().enumerate() {
        decode_image(bytes, &LIMITS).unwrap_or_else(|e| panic!("file {number}: {e}"));
        let scans: Vec<_> =
            (0..bytes.len()).filter(|&at| bytes[at..].starts_with(&[0xff, 0xda])).collect();
        let is_progressive = number == 4;
        let end = if is_progressive { scans[scans.len() - 1] } else { bytes.len() - 2 };
        for end in scans[0]..end {
            let cut = [&bytes[..end], &[0xff, 0xd9]].concat();
            let code = decode_image(&cut, &LIMITS).map_err(|error| error.code()).err();
            // Between the scans of a progressive photo a cut may make nonsense of a table.
            let is_named = code == Some("truncated") || is_progressive && code == Some("damaged");
            assert!(is_named, "file {number} cut at {end} of {}: {code:?}", bytes.len());
        }
    }
}

#[test]
fn damaged_bytes_never_panic() {
    let rgb: Vec<u8> = picture(24, 24).iter().flat_map(|&v| [v, 255 - v, 90]).collect();
    let files =
        [jpeg(24, 24, &rgb, ExtendedColorType::Rgb8), png(24, 24, &rgb, ExtendedColorType::Rgb8)];
    for bytes in &files {
        for at in 0..bytes.len() {
            for value in [0, 0x80, 0xff] {
                let mut damaged = bytes.clone();
                damaged[at] = value;
                let _ = decode_image(&damaged, &LIMITS);
            }
        }
    }
}

#[test]
fn not_images() {
    let code = |bytes: &[u8]| decode_image(bytes, &LIMITS).unwrap_err().code();
    assert_eq!(code(b""), "empty_file");
    assert_eq!(code(b"a text that calls itself photo.jpg"), "not_an_image");
    assert_eq!(code(b"GIF89a\x01\0\x01\0"), "not_an_image");
    assert_eq!(code(b"\xff\xd8\xff"), "truncated");
    assert_eq!(code(b"\xff\xd8\xff\xd9"), "damaged");
}

/// A header of 60000 x 60000 costs nothing but the answer.
#[test]
fn huge_sizes_are_refused_by_the_header() {
    let mut bomb = png(1, 1, &[0], ExtendedColorType::L8);
    bomb[16..20].copy_from_slice(&60_000_u32.to_be_bytes());
    bomb[20..24].copy_from_slice(&60_000_u32.to_be_bytes());
    let error = decode_image(&bomb, &DecodeLimits::default()).unwrap_err();
    assert_eq!(error.code(), "too_large");
    assert!(error.to_string().contains("60000"), "{error}");
    assert_eq!(sniff(&bomb).unwrap().width, 60_000);

    let mut wide = jpeg(8, 8, &[7; 64], ExtendedColorType::L8);
    let frame = wide.windows(2).position(|w| w == [0xff, 0xc0]).unwrap();
    wide[frame + 5..frame + 9].copy_from_slice(&[0xff, 0xff, 0xff, 0xff]);
    assert_eq!(decode_image(&wide, &DecodeLimits::default()).unwrap_err().code(), "too_large");
}

#[test]
fn each_limit_is_kept() {
    let bytes = png(40, 20, &picture(40, 20), ExtendedColorType::L8);
    let code = |limits: DecodeLimits| decode_image(&bytes, &limits).map_err(|e| e.code()).err();
    assert_eq!(code(LIMITS), None);
    assert_eq!(code(DecodeLimits { max_side: 39, ..LIMITS }), Some("too_large"));
    assert_eq!(code(DecodeLimits { max_pixels: 799, ..LIMITS }), Some("too_large"));
    assert_eq!(code(DecodeLimits { max_alloc_bytes: 1000, ..LIMITS }), Some("too_large"));
    assert_eq!(code(DecodeLimits { max_file_bytes: bytes.len() - 1, ..LIMITS }), Some("too_large"));
}

#[test]
fn jpeg_variants_that_are_not_decoded_say_so() {
    let mut lossless = jpeg(8, 8, &[7; 64], ExtendedColorType::L8);
    let frame = lossless.windows(2).position(|w| w == [0xff, 0xc0]).unwrap();
    lossless[frame + 1] = 0xc3;
    assert_eq!(decode_image(&lossless, &LIMITS).unwrap_err().code(), "unsupported");
    let mut twelve_bit = lossless.clone();
    twelve_bit[frame + 1] = 0xc1;
    twelve_bit[frame + 4] = 12;
    assert_eq!(decode_image(&twelve_bit, &LIMITS).unwrap_err().code(), "unsupported");
}
