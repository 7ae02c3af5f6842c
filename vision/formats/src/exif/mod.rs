//! What a camera wrote beside its pixels. Bad EXIF is never an error: what cannot be read is not
//! there.

use std::io::Cursor;

use exif::{Exif, In, Reader, Tag, Value};

use crate::decode::Orientation;

mod focal;
mod sensors;

pub use focal::{FocalGuess, FocalSource, guess_focal};

/// Position from a satellite receiver.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GpsPosition {
    /// Degrees, north positive.
    pub latitude_deg: f64,
    /// Degrees, east positive.
    pub longitude_deg: f64,
    /// Meters above sea level.
    pub altitude_m: Option<f64>,
}

/// The part of EXIF that a reconstruction uses.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ExifSummary {
    /// Maker of the camera.
    pub make: Option<String>,
    /// Model of the camera.
    pub model: Option<String>,
    /// Serial number of the body.
    pub serial: Option<String>,
    /// FocalLength, millimeters.
    pub focal_mm: Option<f64>,
    /// FocalLengthIn35mmFilm, millimeters.
    pub focal_35mm: Option<f64>,
    /// FocalPlaneXResolution in pixels per millimeter.
    pub focal_plane_pixels_per_mm: Option<f64>,
    /// Longer side of the image to which the focal plane resolution refers, pixels.
    pub recorded_max_side: Option<u32>,
    /// How the stored image is turned.
    pub orientation: Orientation,
    /// DateTimeOriginal with its fraction, seconds since 1970 of the camera's own clock.
    pub time_s: Option<f64>,
    /// Where it was taken.
    pub gps: Option<GpsPosition>,
    /// Fields that are there but make no sense, for the report.
    pub warnings: Vec<String>,
}

impl ExifSummary {
    /// Focal length in pixels of an image of `width` x `height` (stored or upright, the longer
    /// side counts), best source first; see [`guess_focal`]. Always an answer: the last resort is
    /// [`FocalSource::Guess`].
    pub fn focal_px(&self, width: u32, height: u32) -> FocalGuess {
        guess_focal(self, width, height)
    }
}

/// Reads the EXIF block of a JPEG or PNG. Without one, all fields are empty.
pub fn read_exif(bytes: &[u8]) -> ExifSummary {
    // Many writers break small rules of TIFF; what can be read past that is as good as any.
    let exif = Reader::new()
        .continue_on_error(true)
        .read_from_container(&mut Cursor::new(bytes))
        .or_else(|error| error.distill_partial_result(|_| ()));
    let Ok(exif) = exif else { return ExifSummary::default() };
    let mut fields = Fields { exif: &exif, warnings: Vec::new() };
    let sides = [Tag::PixelXDimension, Tag::PixelYDimension].map(|tag| fields.unsigned(tag));
    let per_mm = fields.positive(Tag::FocalPlaneXResolution).and_then(|resolution| {
        pixels_per_mm(resolution, fields.unsigned(Tag::FocalPlaneResolutionUnit))
    });
    ExifSummary {
        make: fields.text(Tag::Make),
        model: fields.text(Tag::Model),
        serial: fields.text(Tag::BodySerialNumber),
        focal_mm: fields.positive(Tag::FocalLength),
        focal_35mm: fields.positive(Tag::FocalLengthIn35mmFilm),
        focal_plane_pixels_per_mm: per_mm,
        recorded_max_side: sides.into_iter().flatten().max().filter(|&side| side > 0),
        orientation: Orientation::from_exif(fields.unsigned(Tag::Orientation).unwrap_or(1)),
        time_s: fields.time(),
        gps: fields.gps(),
        warnings: fields.warnings,
    }
}

/// ResolutionUnit: 2 inch (also the default), 3 centimeter; 4 millimeter and 5 micrometer are in
/// use though not in the standard.
fn pixels_per_mm(resolution: f64, unit: Option<u32>) -> Option<f64> {
    match unit.unwrap_or(2) {
        2 => Some(resolution / 25.4),
        3 => Some(resolution / 10.0),
        4 => Some(resolution),
        5 => Some(resolution * 1000.0),
        _ => None,
    }
}

struct Fields<'a> {
    exif: &'a Exif,
    warnings: Vec<String>,
}

impl Fields<'_> {
    fn value(&self, tag: Tag) -> Option<&Value> {
        self.exif.get_field(tag, In::PRIMARY).map(|field| &field.value)
    }

    fn unsigned(&self, tag: Tag) -> Option<u32> {
        self.value(tag)?.get_uint(0)
    }

    /// A finite positive number; anything else that is there is warned of.
    fn positive(&mut self, tag: Tag) -> Option<f64> {
        let number = real(self.value(tag)?, 0);
        match number {
            Some(number) if number.is_finite() && number > 0.0 => Some(number),
            _ => {
                let shown = number.map_or("no number".into(), |number| number.to_string());
                self.warnings.push(format!("EXIF: {tag} is {shown}, ignored"));
                None
            }
        }
    }

    fn text(&self, tag: Tag) -> Option<String> {
        let Value::Ascii(parts) = self.value(tag)? else { return None };
        let text: String = String::from_utf8_lossy(parts.first()?)
            .chars()
            .filter(|c| !c.is_control())
            .take(100)
            .collect();
        let text = text.trim();
        (!text.is_empty()).then(|| text.to_owned())
    }

    fn time(&self) -> Option<f64> {
        let Value::Ascii(date) = self.value(Tag::DateTimeOriginal)? else { return None };
        let mut date = exif::DateTime::from_ascii(date.first()?).ok()?;
        if let Some(Value::Ascii(fraction)) = self.value(Tag::SubSecTimeOriginal) {
            // A fraction that cannot be read is none.
            let _ = fraction.first().map(|digits| date.parse_subsec(digits));
        }
        seconds_since_1970(&date)
    }

    fn gps(&mut self) -> Option<GpsPosition> {
        let latitude = self.angle(Tag::GPSLatitude, Tag::GPSLatitudeRef, b'S');
        let longitude = self.angle(Tag::GPSLongitude, Tag::GPSLongitudeRef, b'W');
        let (latitude_deg, longitude_deg) = (latitude?, longitude?);
        if latitude_deg.abs() > 90.0 || longitude_deg.abs() > 180.0 {
            self.warnings.push("EXIF: GPS position is not on Earth, ignored".into());
            return None;
        }
        let below_sea = matches!(
            self.value(Tag::GPSAltitudeRef),
            Some(Value::Byte(bytes)) if bytes.first() == Some(&1)
        );
        let altitude_m = self
            .value(Tag::GPSAltitude)
            .and_then(|value| real(value, 0))
            .filter(|altitude| altitude.is_finite())
            .map(|altitude| if below_sea { -altitude } else { altitude });
        Some(GpsPosition { latitude_deg, longitude_deg, altitude_m })
    }

    /// Degrees, minutes, seconds; negative in the hemisphere `negative`.
    fn angle(&self, tag: Tag, reference: Tag, negative: u8) -> Option<f64> {
        let value = self.value(tag)?;
        let angle = real(value, 0)? + real(value, 1)? / 60.0 + real(value, 2)? / 3600.0;
        let is_negative = match self.value(reference) {
            Some(Value::Ascii(parts)) => {
                parts.first().is_some_and(|p| p.first() == Some(&negative))
            }
            _ => return None,
        };
        angle.is_finite().then_some(if is_negative { -angle } else { angle })
    }
}

/// Number `index` of a value of any numeric type; NaN or infinite for x/0.
fn real(value: &Value, index: usize) -> Option<f64> {
    match value {
        Value::Rational(v) => v.get(index).map(|r| r.to_f64()),
        Value::SRational(v) => v.get(index).map(|r| r.to_f64()),
        Value::Float(v) => v.get(index).map(|&f| f64::from(f)),
        Value::Double(v) => v.get(index).copied(),
        other => other.get_uint(index).map(f64::from),
    }
}

/// Days by Howard Hinnant's `days_from_civil` rule; `None` for dates that are none.
fn seconds_since_1970(date: &exif::DateTime) -> Option<f64> {
    let in_range = (1..=12).contains(&date.month)
        && (1..=31).contains(&date.day)
        && date.hour < 24
        && date.minute < 60
        && date.second <= 60
        && date.year >= 1970;
    if !in_range {
        return None;
    }
    let (month, day) = (i64::from(date.month), i64::from(date.day));
    // Years begin in March, so that the leap day is the last.
    let year = i64::from(date.year) - i64::from(month <= 2);
    let month_from_march = (month + 9) % 12;
    let day_of_year = (153 * month_from_march + 2) / 5 + day - 1;
    let days = 365 * year + year / 4 - year / 100 + year / 400 + day_of_year - 719_468;
    let (hours, minutes) = (i64::from(date.hour), i64::from(date.minute));
    let seconds = ((days * 24 + hours) * 60 + minutes) * 60 + i64::from(date.second);
    Some(seconds as f64 + f64::from(date.nanosecond.unwrap_or(0)) * 1e-9)
}

#[cfg(test)]
mod tests;
