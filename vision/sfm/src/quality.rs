//! How far a model may be trusted.
//!
//! A structure-from-motion model can be wrong and look well: small residuals, many points, every
//! image placed. What gives it away is evidence it did not use: verified pairs whose geometry
//! disagrees with the poses, parts that hang together by a thread, cameras no one builds.

mod ties;

use std::collections::{BTreeMap, BTreeSet};

use volery_geometry::epipolar::{essential_from_pose, squared_sampson_error};
use volery_scene::{
    CameraId, ImageId, Quality, QualityReason, RegisteredImage, SparseModel, TwoViewGeometry,
    TwoViewKind, UnplacedImage, UnplacedReason, Verdict,
};

use crate::SfmCamera;
use crate::incremental::{FOV_RANGE_DEG, MAX_DISTORTION};
use ties::{MIN_PART_IMAGES, MIN_SCALE_POINTS, MIN_TIE_POINTS, weakest_scale_tie, weakest_tie};

/// Inliers from which a pair's word counts.
const MIN_WITNESS_INLIERS: usize = 25;
/// Sampson error, pixels, up to which a match agrees with the poses.
const MAX_SAMPSON_PX: f64 = 6.0;
/// A pair contradicts if fewer of its matches agree with the poses.
const MIN_AGREEING_MATCHES: f64 = 0.5;
/// Matches that see points, from which a pair is asked whether they see the same ones.
const MIN_SEEING: usize = 15;
/// A pair is torn if fewer of these matches share their point.
const MIN_SHARING: f64 = 0.3;
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

/// What the verified pairs say about a model.
#[derive(Debug, Clone, PartialEq)]
pub struct Evidence {
    /// Pairs of posed images that could be asked.
    pub num_witnesses: usize,
    /// Those that disagree with the poses.
    pub num_contradicting: usize,
    /// Part of the witnesses' matches that are in contradicting pairs.
    pub contradiction: f64,
    /// Worst contradicting pair by number of inliers, with its rotation residual in degrees where
    /// it has one.
    pub worst: Option<(ImageId, ImageId, usize, Option<f64>)>,
    /// Of the pairs with one image up to this one and the other after it, the greatest part of
    /// matches in contradicting pairs.
    pub worst_cut: Option<(ImageId, f64)>,
    /// Fewest points that two parts of the map share, with the size of the smaller part.
    pub weakest_tie: Option<(usize, usize)>,
    /// The same, counting only points in three or more images: those that tie the scales of the
    /// parts.
    pub weakest_scale_tie: Option<(usize, usize)>,
    /// Images in verified pairs.
    pub num_paired: usize,
    /// Relative standard deviation of guessed focal lengths that were refined, by camera; from
    /// [`focal_sigma`](crate::self_calibration::focal_sigma).
    pub focal_sigmas: Vec<(CameraId, f64)>,
}

impl Evidence {
    /// Asks every verified pair whose images both have a pose.
    pub fn of(model: &SparseModel, pairs: &[TwoViewGeometry]) -> Self {
        let (mut num_witnesses, mut num_contradicting) = (0, 0);
        let (mut all, mut against) = (0usize, 0usize);
        let mut worst: Option<(ImageId, ImageId, usize, Option<f64>)> = None;
        let mut cuts: BTreeMap<ImageId, (isize, isize)> = BTreeMap::new();
        let paired: BTreeSet<ImageId> = pairs.iter().flat_map(|p| [p.image1, p.image2]).collect();
        for pair in pairs.iter().filter(|pair| pair.num_inliers() >= MIN_WITNESS_INLIERS) {
            let Some(testimony) = Testimony::of(model, pair) else { continue };
            num_witnesses += 1;
            all += pair.num_inliers();
            let matches = pair.num_inliers() as isize;
            let held_against = if testimony.contradicts() { matches } else { 0 };
            for (id, sign) in [(pair.image1, 1), (pair.image2, -1)] {
                let cut = cuts.entry(id).or_default();
                *cut = (cut.0 + sign * matches, cut.1 + sign * held_against);
            }
            if testimony.contradicts() {
                num_contradicting += 1;
                against += pair.num_inliers();
                if worst.is_none_or(|(_, _, most, _)| pair.num_inliers() > most) {
                    worst = Some((
                        pair.image1,
                        pair.image2,
                        pair.num_inliers(),
                        testimony.rotation_residual_deg,
                    ));
                }
            }
        }
        Self {
            num_witnesses,
            num_contradicting,
            contradiction: if all > 0 { against as f64 / all as f64 } else { 0.0 },
            worst,
            worst_cut: worst_cut(&cuts),
            weakest_tie: weakest_tie(model),
            weakest_scale_tie: weakest_scale_tie(model),
            num_paired: paired.len(),
            focal_sigmas: Vec::new(),
        }
    }

    /// The verdict over `model`; `cameras` are the intrinsics as given.
    pub fn verdict(&self, model: &SparseModel, cameras: &[SfmCamera]) -> Quality {
        let mut reasons = Vec::new();
        let mut add = |code: &str, detail: String| {
            reasons.push(QualityReason { code: code.to_owned(), detail });
        };
        let failed = model.images.len() < 2 || model.points.len() < MIN_POINTS / 4;
        if model.points.len() < MIN_POINTS {
            add(
                "few_points",
                format!("only {} points: take more images of textured places", model.points.len()),
            );
        }
        if self.contradiction > MAX_CONTRADICTION {
            let worst = self.worst.map_or(String::new(), |(a, b, n, degrees)| {
                let turn = degrees.map_or(String::new(), |d| format!(" by {d:.0} degrees"));
                format!("; images {} and {} with {n} matches disagree most{turn}", a.0, b.0)
            });
            add(
                "contradicting_rotations",
                format!(
                    "{} of {} verified image pairs ({:.0} % of the matches) disagree with the map{worst}",
                    self.num_contradicting,
                    self.num_witnesses,
                    100.0 * self.contradiction
                ),
            );
        }
        if let Some((image, part)) = self.worst_cut
            && part > MAX_CUT_CONTRADICTION
        {
            add(
                "loop_disagreement",
                format!(
                    "{:.0} % of the matches between the images up to {} and those after it disagree \
                     with the map: the two parts may be joined wrongly",
                    100.0 * part,
                    image.0
                ),
            );
        }
        if (model.images.len() as f64) < MIN_PLACED * self.num_paired as f64 {
            add(
                "few_images",
                format!(
                    "only {} of {} images that match others have a place",
                    model.images.len(),
                    self.num_paired
                ),
            );
        }
        for (camera, sigma) in &self.focal_sigmas {
            if *sigma > MAX_FOCAL_SIGMA {
                add(
                    "absurd_intrinsics",
                    format!(
                        "the focal length of camera {} is uncertain by {:.0} %: give the camera's \
                         intrinsics, or take images that move sideways",
                        camera.0,
                        100.0 * sigma
                    ),
                );
            }
        }
        if let Some((points, part)) = self.weakest_tie
            && points < MIN_TIE_POINTS
        {
            add(
                "weakly_tied",
                format!(
                    "a part of {part} images shares only {points} points with the rest: its place and \
                     scale are uncertain; take images that show both parts"
                ),
            );
        } else if let Some((points, part)) = self.weakest_scale_tie
            && points < MIN_SCALE_POINTS
        {
            add(
                "weakly_tied",
                format!(
                    "only {points} points in three or more images tie the scale of a part of {part} \
                     images to the rest: turn in smaller steps, so that three images in a row see \
                     the same places"
                ),
            );
        }
        for (detail, _) in absurd_cameras(model, cameras) {
            add("absurd_intrinsics", detail);
        }
        let num_weak = model
            .images
            .values()
            .filter(|image| image.points.iter().flatten().count() < MIN_IMAGE_POINTS)
            .count();
        if num_weak as f64 > MAX_WEAK_IMAGES * model.images.len() as f64 {
            add(
                "weak_support",
                format!("{num_weak} of {} images see few points", model.images.len()),
            );
        }
        if let Some(error) = model.mean_reprojection_error_px()
            && error > MAX_MEAN_ERROR_PX
        {
            add("high_reprojection_error", format!("mean reprojection error {error:.2} pixels"));
        }
        let verdict = match (failed, reasons.is_empty()) {
            (true, _) => Verdict::Failed,
            (false, false) => Verdict::Suspect,
            (false, true) => Verdict::Good,
        };
        Quality { verdict, reasons }
    }
}

/// From what begins (+) and ends (−) at each image: matches across the place after it, and those
/// of contradicting pairs.
fn worst_cut(changes: &BTreeMap<ImageId, (isize, isize)>) -> Option<(ImageId, f64)> {
    let (mut across, mut against) = (0, 0);
    let mut worst: Option<(ImageId, f64)> = None;
    for (index, (&image, change)) in changes.iter().enumerate() {
        across += change.0;
        against += change.1;
        // A cut near an end has few witnesses.
        let smaller = (index + 1).min(changes.len() - 1 - index);
        if across <= 0 || smaller < MIN_PART_IMAGES {
            continue;
        }
        let part = against as f64 / across as f64;
        if worst.is_none_or(|(_, most)| part > most) {
            worst = Some((image, part));
        }
    }
    worst
}

/// What one pair says about the poses of its images.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Testimony {
    rotation_residual_deg: Option<f64>,
    /// Part of the matches that obey the epipolar geometry of the poses.
    agreeing_matches: f64,
    /// Matches of which a keypoint sees a point, and those whose keypoints see the same one.
    num_seeing: usize,
    num_sharing: usize,
}

impl Testimony {
    fn of(model: &SparseModel, pair: &TwoViewGeometry) -> Option<Self> {
        let (image1, image2) = (model.images.get(&pair.image1)?, model.images.get(&pair.image2)?);
        let (camera1, camera2) =
            (model.cameras.get(&image1.camera)?, model.cameras.get(&image2.camera)?);
        let cam2_from_cam1 = image2.cam_from_world * image1.cam_from_world.inverse();
        // A plane leaves two decompositions, so its rotation is no evidence.
        let rotation_residual_deg = match pair.kind {
            TwoViewKind::General | TwoViewKind::RotationOnly => pair
                .cam2_from_cam1
                .map(|measured| cam2_from_cam1.rotation.angle_to(&measured.rotation).to_degrees()),
            TwoViewKind::Planar | TwoViewKind::Uncalibrated => None,
        };
        let essential = essential_from_pose(&cam2_from_cam1);
        let limit =
            (MAX_SAMPSON_PX / (0.5 * (camera1.mean_focal() + camera2.mean_focal()))).powi(2);
        let stride = pair.matches.len().div_ceil(100).max(1);
        let (mut asked, mut agreeing) = (0usize, 0usize);
        for m in pair.matches.iter().step_by(stride) {
            let (Some(pixel1), Some(pixel2)) = (
                image1.keypoints.get(m.feature1 as usize),
                image2.keypoints.get(m.feature2 as usize),
            ) else {
                continue;
            };
            let (Some(xy1), Some(xy2)) = (camera1.unproject(pixel1), camera2.unproject(pixel2))
            else {
                continue;
            };
            asked += 1;
            let error = squared_sampson_error(&essential, &xy1.into(), &xy2.into());
            agreeing += usize::from(error <= limit);
        }
        let point_of = |image: &RegisteredImage, keypoint: u32| {
            image.points.get(keypoint as usize).copied().flatten()
        };
        let (mut num_seeing, mut num_sharing) = (0, 0);
        for m in &pair.matches {
            let (a, b) = (point_of(image1, m.feature1), point_of(image2, m.feature2));
            num_seeing += usize::from(a.is_some() || b.is_some());
            num_sharing += usize::from(a.is_some() && a == b);
        }
        (asked > 0).then(|| Self {
            rotation_residual_deg,
            agreeing_matches: agreeing as f64 / asked as f64,
            num_seeing,
            num_sharing,
        })
    }

    fn contradicts(&self) -> bool {
        // Epipolar lines are blind along themselves: two copies of a scene slid along each other
        // obey them, but then the keypoints of a match see different points.
        let is_torn = self.num_seeing >= MIN_SEEING
            && (self.num_sharing as f64) < MIN_SHARING * self.num_seeing as f64;
        is_torn || self.agreeing_matches < MIN_AGREEING_MATCHES
    }
}

/// Cameras outside what is built, with what is wrong.
fn absurd_cameras(model: &SparseModel, cameras: &[SfmCamera]) -> Vec<(String, u32)> {
    let mut absurd = Vec::new();
    for (id, camera) in &model.cameras {
        let fov = camera.horizontal_fov().to_degrees();
        if !(FOV_RANGE_DEG.0..=FOV_RANGE_DEG.1).contains(&fov) {
            absurd.push((format!("camera {} has a field of view of {fov:.0} degrees", id.0), id.0));
        }
        let distortion = &camera.params()[camera.model.distortion_start()..];
        if let Some(k) = distortion.iter().take(2).find(|k| k.abs() > MAX_DISTORTION) {
            absurd.push((format!("camera {} has a distortion coefficient of {k:.1}", id.0), id.0));
        }
        if let Some(first) = cameras.get(id.0 as usize)
            && !first.focal_is_guess
        {
            let change = camera.mean_focal() / first.camera.mean_focal();
            if !(0.7..=1.4).contains(&change) {
                absurd.push((
                    format!(
                        "camera {}: refined focal length is {change:.2} times the given one",
                        id.0
                    ),
                    id.0,
                ));
            }
        }
    }
    absurd
}

/// The verdict when there is no map: why most images have no place.
pub(crate) fn no_map(unplaced: &[UnplacedImage]) -> Quality {
    let count = |reason| unplaced.iter().filter(|image| image.reason == reason).count();
    let (turned, alone) = (count(UnplacedReason::NoParallax), count(UnplacedReason::NoOverlap));
    let reason = if turned > 0 && turned >= alone {
        QualityReason {
            code: UnplacedReason::NoParallax.code().to_owned(),
            detail: format!(
                "the camera only turned between {turned} images: move it sideways by at least a \
                 tenth of the distance to the scene"
            ),
        }
    } else if alone > 0 {
        QualityReason {
            code: UnplacedReason::NoOverlap.code().to_owned(),
            detail: format!(
                "{alone} images share nothing with any other: let neighbors overlap by half"
            ),
        }
    } else {
        QualityReason {
            code: UnplacedReason::Ambiguous.code().to_owned(),
            detail: "the matches fit no single scene".to_owned(),
        }
    };
    Quality { verdict: Verdict::Failed, reasons: vec![reason] }
}
