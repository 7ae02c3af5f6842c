//! Focal length in pixels from what EXIF says.

use super::ExifSummary;
use super::sensors::sensor_width_mm;

/// Width of the 35 mm film frame, to which FocalLengthIn35mmFilm refers.
const FILM_WIDTH_MM: f64 = 36.0;

/// Fields of view along the longer side that a lens without fisheye projection can have.
const FIELD_OF_VIEW_DEG: std::ops::RangeInclusive<f64> = 15.0..=140.0;

/// Focal length over the longer side where nothing is known: a field of view of 45 degrees, that
/// of a usual lens.
const GUESS_PER_MAX_SIDE: f64 = 1.2;

/// What a focal length rests on, best first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum FocalSource {
    /// FocalLengthIn35mmFilm on the 36 mm width of the film frame.
    Exif35mm,
    /// FocalLength times FocalPlaneXResolution.
    FocalPlane,
    /// FocalLength over the sensor width of a known camera.
    SensorTable,
    /// 1.2 times the longer side: nothing is known.
    Guess,
}

impl FocalSource {
    /// The stable code.
    pub fn code(self) -> &'static str {
        match self {
            Self::Exif35mm => "exif_35mm",
            Self::FocalPlane => "exif_focal_plane",
            Self::SensorTable => "sensor_table",
            Self::Guess => "guess",
        }
    }
}

/// A focal length with its source.
#[derive(Debug, Clone, PartialEq)]
pub struct FocalGuess {
    /// Pixels.
    pub px: f64,
    /// What says so.
    pub source: FocalSource,
    /// Sources that were ignored, and why.
    pub warnings: Vec<String>,
}

/// Focal length in pixels of an image of `width` x `height`: the first of these that gives a
/// field of view of 15 to 140 degrees along the longer side:
///
/// ```text
/// f = f₃₅ / 36 mm · max(width, height)                        (the frame's width, not its diagonal)
/// f = f_mm · pixels per mm · max(width, height) / recorded max side
/// f = f_mm / sensor width · max(width, height)
/// f = 1.2 · max(width, height)                                (a guess)
/// ```
pub fn guess_focal(exif: &ExifSummary, width: u32, height: u32) -> FocalGuess {
    let max_side = f64::from(width.max(height));
    let film = exif.focal_35mm.map(|f| f / FILM_WIDTH_MM);
    let plane = exif
        .focal_mm
        .zip(exif.focal_plane_pixels_per_mm)
        .map(|(f, per_mm)| f * per_mm / exif.recorded_max_side.map_or(max_side, f64::from));
    let table = exif.focal_mm.zip(sensor_width_mm(exif.model.as_deref())).map(|(f, w)| f / w);

    let mut warnings = Vec::new();
    let candidates = [
        (film, FocalSource::Exif35mm),
        (plane, FocalSource::FocalPlane),
        (table, FocalSource::SensorTable),
    ];
    for (per_max_side, source) in candidates {
        let Some(per_max_side) = per_max_side else { continue };
        let field_of_view_deg = (2.0 * (0.5 / per_max_side).atan()).to_degrees();
        if FIELD_OF_VIEW_DEG.contains(&field_of_view_deg) {
            return FocalGuess { px: per_max_side * max_side, source, warnings };
        }
        warnings.push(format!(
            "{} gives a field of view of {field_of_view_deg:.1} degrees, ignored",
            source.code()
        ));
    }
    FocalGuess { px: GUESS_PER_MAX_SIDE * max_side, source: FocalSource::Guess, warnings }
}
