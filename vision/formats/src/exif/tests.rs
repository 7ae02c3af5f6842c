//! P21: intrinsics come from EXIF, and missing or absurd EXIF never stops anything.

use exif::experimental::Writer;
use exif::{Field, Rational};

use super::*;

/// A JPEG header with these fields.
fn photo(fields: &[(Tag, Value)]) -> Vec<u8> {
    let fields: Vec<Field> = fields
        .iter()
        .map(|(tag, value)| Field { tag: *tag, ifd_num: In::PRIMARY, value: value.clone() })
        .collect();
    let mut writer = Writer::new();
    for field in &fields {
        writer.push_field(field);
    }
    let mut tiff = Cursor::new(Vec::new());
    writer.write(&mut tiff, true).unwrap();
    let tiff = tiff.into_inner();
    let mut bytes = vec![0xff, 0xd8, 0xff, 0xe1];
    bytes.extend((tiff.len() as u16 + 8).to_be_bytes());
    bytes.extend(b"Exif\0\0");
    bytes.extend(tiff);
    bytes.extend([0xff, 0xd9]);
    bytes
}

fn ratio(num: u32, denom: u32) -> Value {
    Value::Rational(vec![Rational { num, denom }])
}

fn text(s: &str) -> Value {
    Value::Ascii(vec![s.as_bytes().to_vec()])
}

fn focal(fields: &[(Tag, Value)]) -> FocalGuess {
    read_exif(&photo(fields)).focal_px(1600, 1200)
}

/// The 35 mm value refers to the frame's width of 36 mm; its diagonal would give 3-4 % less for
/// pictures of 4:3.
#[test]
fn film_focal_is_relative_to_the_frame_width() {
    let guess = focal(&[(Tag::FocalLengthIn35mmFilm, Value::Short(vec![26]))]);
    assert_eq!(guess.source, FocalSource::Exif35mm);
    assert!((guess.px - 26.0 / 36.0 * 1600.0).abs() < 1e-9);
    assert!(guess.warnings.is_empty());
}

/// The longer side counts, whichever way the photo stands.
#[test]
fn upright_photos_have_the_same_focal_length() {
    let exif = read_exif(&photo(&[(Tag::FocalLengthIn35mmFilm, Value::Short(vec![26]))]));
    assert_eq!(exif.focal_px(1200, 1600), exif.focal_px(1600, 1200));
}

/// 8 mm at 1000 pixels per cm is 800 px of the recorded 3200 px, so 400 px of 1600.
#[test]
fn focal_plane_resolution_scales_with_the_image() {
    let fields = [
        (Tag::FocalLength, ratio(80, 10)),
        (Tag::FocalPlaneXResolution, ratio(1000, 1)),
        (Tag::FocalPlaneResolutionUnit, Value::Short(vec![3])),
        (Tag::PixelXDimension, Value::Long(vec![3200])),
        (Tag::PixelYDimension, Value::Long(vec![2400])),
    ];
    let guess = focal(&fields);
    assert_eq!(guess.source, FocalSource::FocalPlane);
    assert!((guess.px - 400.0).abs() < 1e-9);
    // In inches the same number means less resolution.
    let mut inches = fields.clone();
    inches[2].1 = Value::Short(vec![2]);
    inches[1].1 = ratio(2540, 1);
    assert!((focal(&inches).px - 400.0).abs() < 1e-9);
}

#[test]
fn known_cameras_have_a_sensor_width() {
    let guess = focal(&[(Tag::Model, text("FC6310")), (Tag::FocalLength, ratio(88, 10))]);
    assert_eq!(guess.source, FocalSource::SensorTable);
    assert!((guess.px - 8.8 / 13.2 * 1600.0).abs() < 1e-9);
}

#[test]
fn without_exif_the_focal_length_is_a_guess() {
    for bytes in [&b""[..], b"no image", b"\xff\xd8\xff\xd9"] {
        let guess = read_exif(bytes).focal_px(640, 480);
        assert_eq!((guess.px, guess.source), (1.2 * 640.0, FocalSource::Guess));
    }
}

/// 0, x/0, 0/0, infinite, far too large, of another type: not fatal, reported, next source used.
#[test]
fn absurd_values_are_ignored_with_a_warning() {
    let absurd = [
        (Tag::FocalLength, ratio(0, 1)),
        (Tag::FocalLength, ratio(5, 0)),
        (Tag::FocalLength, ratio(0, 0)),
        (Tag::FocalLength, text("50 mm")),
        (Tag::FocalLengthIn35mmFilm, Value::Short(vec![0])),
        (Tag::FocalLengthIn35mmFilm, Value::Short(vec![])),
        (Tag::FocalLengthIn35mmFilm, Value::Float(vec![f32::NAN])),
        (Tag::FocalLengthIn35mmFilm, Value::Double(vec![-3.0])),
        (Tag::FocalPlaneXResolution, ratio(1000, 0)),
    ];
    for field in absurd {
        let exif = read_exif(&photo(std::slice::from_ref(&field)));
        let guess = exif.focal_px(1600, 1200);
        assert_eq!(guess.source, FocalSource::Guess, "{field:?}");
        assert!(!exif.warnings.is_empty(), "{field:?}");
        assert!(guess.px.is_finite() && guess.px > 0.0);
    }
}

/// 1 mm on film is a field of view of 173 degrees, 2000 mm one of 1 degree: no such lens flies.
#[test]
fn impossible_fields_of_view_are_ignored_with_a_warning() {
    for millimeters in [1, 2000] {
        let fields = [
            (Tag::FocalLengthIn35mmFilm, Value::Short(vec![millimeters])),
            (Tag::Model, text("FC6310")),
            (Tag::FocalLength, ratio(88, 10)),
        ];
        let guess = focal(&fields);
        assert_eq!(guess.source, FocalSource::SensorTable);
        assert!(guess.warnings[0].contains("field of view"), "{:?}", guess.warnings);
    }
}

#[test]
fn time_and_place() {
    let dms = |d, m, s| Value::Rational([d, m, s].map(|num| Rational { num, denom: 1 }).to_vec());
    let exif = read_exif(&photo(&[
        (Tag::DateTimeOriginal, text("2024:02:29 12:00:01")),
        (Tag::SubSecTimeOriginal, text("25")),
        (Tag::GPSLatitude, dms(48, 30, 0)),
        (Tag::GPSLatitudeRef, text("S")),
        (Tag::GPSLongitude, dms(2, 0, 36)),
        (Tag::GPSLongitudeRef, text("E")),
        (Tag::GPSAltitudeRef, Value::Byte(vec![1])),
        (Tag::GPSAltitude, ratio(15, 10)),
    ]));
    assert_eq!(exif.time_s, Some(1_709_208_001.25));
    let gps = exif.gps.unwrap();
    assert!((gps.latitude_deg + 48.5).abs() < 1e-12 && (gps.longitude_deg - 2.01).abs() < 1e-12);
    assert_eq!(gps.altitude_m, Some(-1.5));
    let blank = read_exif(&photo(&[(Tag::DateTimeOriginal, text("0000:00:00 00:00:00"))]));
    assert_eq!(blank.time_s, None);
}

#[test]
fn every_truncation_is_harmless() {
    let whole = photo(&[
        (Tag::Make, text("DJI")),
        (Tag::FocalLength, ratio(88, 10)),
        (Tag::Orientation, Value::Short(vec![6])),
    ]);
    for end in 0..whole.len() {
        let _ = read_exif(&whole[..end]);
        let mut damaged = whole.clone();
        damaged[end] = 0xff;
        let _ = read_exif(&damaged);
    }
    assert_eq!(read_exif(&whole).orientation, Orientation::RotateClockwise);
    assert_eq!(read_exif(&whole).make.as_deref(), Some("DJI"));
}
