//! How far a model may be trusted.
//!
//! A structure-from-motion model can be wrong and look well: small residuals, many points, every
//! image placed. What gives it away is evidence it did not use: verified pairs whose geometry
//! disagrees with the poses, parts that hang together by a thread, drift that nothing held back,
//! cameras no one builds. Each measure is a file; this one weighs them.

mod absence;
pub mod calibration;
pub mod drift;
mod intrinsics;
pub mod merged;
mod ties;
pub mod witnesses;

use std::collections::BTreeSet;

use volery_scene::{
    CameraId, ImageId, Quality, QualityReason, SparseModel, TwoViewGeometry, Verdict,
};

use crate::SfmCamera;
pub(crate) use absence::no_map;
use calibration::CalibrationShift;
use drift::Drift;
use intrinsics::absurd_cameras;
use merged::Strangers;
use ties::{MIN_SCALE_POINTS, MIN_TIE_POINTS, weakest_scale_tie, weakest_tie};
use witnesses::Witnesses;

/// Code of a map of next to nothing.
pub(crate) const FEW_POINTS: &str = "few_points";
/// Code of a map that many of its images hardly hang in.
pub(crate) const WEAK_SUPPORT: &str = "weak_support";
/// Part of the matches in contradicting pairs that makes a map suspect.
const MAX_CONTRADICTION: f64 = 0.1;
/// The same over the pairs across one place of the sequence, where two parts may be joined wrongly.
const MAX_CUT_CONTRADICTION: f64 = 0.5;
/// Part of the images in verified pairs that a map should hold.
const MIN_PLACED: f64 = 0.4;
/// Relative standard deviation of a self-calibrated focal length.
const MAX_FOCAL_SIGMA: f64 = 0.02;
/// Points an image should see.
const MIN_IMAGE_POINTS: usize = 30;
/// Part of the images that may see fewer.
const MAX_WEAK_IMAGES: f64 = 0.3;
/// Points of a map.
const MIN_POINTS: usize = 100;
/// Mean reprojection error, pixels.
const MAX_MEAN_ERROR_PX: f64 = 1.6;
/// Part of the images that may look unlike their nearest view: a fold concerns at least every other.
const MAX_STRANGERS: f64 = 0.3;
/// Standard deviations from which photos contradict a calibration: with eight values free chance
/// gets as far twice in a thousand sets.
const MIN_SHIFT_SIGMAS: f64 = 5.0;
/// What a good map promises: positions to so many parts of the distance of what is seen.
const MAX_POSITION_DRIFT: f64 = 0.005;
/// And rotations, radians.
const MAX_ROTATION_DRIFT: f64 = 0.5 * std::f64::consts::PI / 180.0;

/// What speaks for and against a model.
#[derive(Debug, Clone, PartialEq)]
pub struct Evidence {
    /// What the verified pairs say.
    pub witnesses: Witnesses,
    /// Fewest points that two parts of the map share, with the size of the smaller part.
    pub weakest_tie: Option<(usize, usize)>,
    /// The same, counting only points in three or more images: those that tie the scales of the
    /// parts.
    pub weakest_scale_tie: Option<(usize, usize)>,
    /// Images that look unlike those in the same place.
    pub strangers: Strangers,
    /// How far the map may have drifted.
    pub drift: Drift,
    /// Images in verified pairs.
    pub num_paired: usize,
    /// Relative standard deviation of guessed focal lengths that were refined, by camera; from
    /// [`focal_sigma`](calibration::focal_sigma).
    pub focal_sigmas: Vec<(CameraId, f64)>,
    /// What the photos say against intrinsics that were held as given, by camera; from
    /// [`calibration_shift`](calibration::calibration_shift).
    pub calibration_shifts: Vec<(CameraId, CalibrationShift)>,
}

impl Evidence {
    /// Gathers all but what is known of the intrinsics.
    pub fn of(model: &SparseModel, pairs: &[TwoViewGeometry]) -> Self {
        let paired: BTreeSet<ImageId> = pairs.iter().flat_map(|p| [p.image1, p.image2]).collect();
        Self {
            witnesses: Witnesses::of(model, pairs),
            weakest_tie: weakest_tie(model),
            weakest_scale_tie: weakest_scale_tie(model),
            strangers: Strangers::of(model),
            drift: Drift::of(model),
            num_paired: paired.len(),
            focal_sigmas: Vec::new(),
            calibration_shifts: Vec::new(),
        }
    }

    /// The verdict over `model`; `cameras` are the intrinsics as given.
    pub fn verdict(&self, model: &SparseModel, cameras: &[SfmCamera]) -> Quality {
        let absurd = absurd_cameras(model, cameras);
        let reasons: Vec<QualityReason> = [
            (FEW_POINTS, few_points(model)),
            ("contradicting_rotations", self.contradiction()),
            ("loop_disagreement", self.torn_sequence()),
            ("merged_places", self.merged_places()),
            ("few_images", self.few_images(model)),
            ("weakly_tied", self.weak_tie()),
            ("drift", self.too_much_drift()),
            (WEAK_SUPPORT, weak_support(model)),
            ("high_reprojection_error", high_error(model)),
        ]
        .into_iter()
        .chain(self.wrong_calibrations().map(|detail| ("wrong_calibration", Some(detail))))
        .chain(self.uncertain_focals().map(|detail| ("absurd_intrinsics", Some(detail))))
        .chain(absurd.into_iter().map(|detail| ("absurd_intrinsics", Some(detail))))
        .filter_map(|(code, detail)| Some(QualityReason { code: code.to_owned(), detail: detail? }))
        .collect();
        let failed = model.images.len() < 2 || model.points.len() < MIN_POINTS / 4;
        let verdict = match (failed, reasons.is_empty()) {
            (true, _) => Verdict::Failed,
            (false, false) => Verdict::Suspect,
            (false, true) => Verdict::Good,
        };
        Quality { verdict, reasons }
    }

    fn contradiction(&self) -> Option<String> {
        let found = &self.witnesses;
        (found.contradiction > MAX_CONTRADICTION).then(|| {
            let worst = found.worst.map_or(String::new(), |worst| {
                let turn = worst
                    .rotation_residual_deg
                    .map_or(String::new(), |degrees| format!(" by {degrees:.0} degrees"));
                let (a, b) = worst.images;
                format!(
                    "; images {} and {} with {} matches disagree most{turn}",
                    a.0, b.0, worst.num_inliers
                )
            });
            format!(
                "{} of {} verified image pairs ({:.0} % of the matches) disagree with the map{worst}",
                found.num_contradicting,
                found.num_asked,
                100.0 * found.contradiction
            )
        })
    }

    fn torn_sequence(&self) -> Option<String> {
        let (image, part) = self.witnesses.worst_cut?;
        (part > MAX_CUT_CONTRADICTION).then(|| {
            format!(
                "{:.0} % of the matches between the images up to {} and those after it disagree \
                 with the map: the two parts may be joined wrongly",
                100.0 * part,
                image.0
            )
        })
    }

    fn merged_places(&self) -> Option<String> {
        let Strangers { num_compared, num_strangers } = self.strangers;
        (self.strangers.fraction() > MAX_STRANGERS).then(|| {
            format!(
                "{num_strangers} of {num_compared} images do not show what the image nearest to \
                 them shows: places that look alike may have been merged; give telemetry or \
                 positions, or make the places look different"
            )
        })
    }

    fn few_images(&self, model: &SparseModel) -> Option<String> {
        let num_placed = model.images.len();
        ((num_placed as f64) < MIN_PLACED * self.num_paired as f64).then(|| {
            format!(
                "only {num_placed} of {} images that match others have a place",
                self.num_paired
            )
        })
    }

    fn weak_tie(&self) -> Option<String> {
        if let Some((points, part)) = self.weakest_tie
            && points < MIN_TIE_POINTS
        {
            return Some(format!(
                "a part of {part} images shares only {points} points with the rest: its place and \
                 scale are uncertain; take images that show both parts"
            ));
        }
        let (points, part) = self.weakest_scale_tie?;
        (points < MIN_SCALE_POINTS).then(|| {
            format!(
                "only {points} points in three or more images tie the scale of a part of {part} \
                 images to the rest: turn in smaller steps, so that three images in a row see the \
                 same places"
            )
        })
    }

    fn too_much_drift(&self) -> Option<String> {
        let Drift { position, rotation } = self.drift;
        (position > MAX_POSITION_DRIFT || rotation > MAX_ROTATION_DRIFT).then(|| {
            format!(
                "errors may add up to {:.1} % of the distance to the scene and {:.1} degrees: \
                 match images far apart in the sequence, come back to places seen before, or \
                 overlap more",
                (100.0 * position).min(999.0),
                rotation.to_degrees()
            )
        })
    }

    fn wrong_calibrations(&self) -> impl Iterator<Item = String> {
        let is_wrong = |shift: &CalibrationShift| {
            shift.num_sigmas > MIN_SHIFT_SIGMAS
                && (breaks(MAX_POSITION_DRIFT, shift.position, self.drift.position)
                    || breaks(MAX_ROTATION_DRIFT, shift.rotation, self.drift.rotation))
        };
        let wrong = self.calibration_shifts.iter().filter(move |(_, shift)| is_wrong(shift));
        wrong.map(|(camera, shift)| {
            format!(
                "the photos contradict the calibration of camera {}: with one that fits them the \
                 map changes by {:.1} % of the distance to the scene and {:.1} degrees",
                camera.0,
                100.0 * shift.position,
                shift.rotation.to_degrees()
            )
        })
    }

    fn uncertain_focals(&self) -> impl Iterator<Item = String> {
        let uncertain = self.focal_sigmas.iter().filter(|(_, sigma)| *sigma > MAX_FOCAL_SIGMA);
        uncertain.map(|(camera, sigma)| {
            format!(
                "the focal length of camera {} is uncertain by {:.0} %: give the camera's \
                 intrinsics, or take images that move sideways",
                camera.0,
                100.0 * sigma
            )
        })
    }
}

/// Whether a bend is more than a map may promise, alone or together with a drift that is no doubt
/// by itself: the two are independent.
fn breaks(promise: f64, bend: f64, drift: f64) -> bool {
    bend > promise || (drift <= promise && bend.hypot(drift) > promise)
}

fn few_points(model: &SparseModel) -> Option<String> {
    let num_points = model.points.len();
    (num_points < MIN_POINTS)
        .then(|| format!("only {num_points} points: take more images of textured places"))
}

fn weak_support(model: &SparseModel) -> Option<String> {
    let num_images = model.images.len();
    let is_weak = |points: usize| points < MIN_IMAGE_POINTS;
    let num_weak = model
        .images
        .values()
        .filter(|image| is_weak(image.points.iter().flatten().count()))
        .count();
    (num_weak as f64 > MAX_WEAK_IMAGES * num_images as f64)
        .then(|| format!("{num_weak} of {num_images} images see few points"))
}

fn high_error(model: &SparseModel) -> Option<String> {
    let error = model.mean_reprojection_error_px()?;
    (error > MAX_MEAN_ERROR_PX).then(|| format!("mean reprojection error {error:.2} pixels"))
}
