//! What the verified pairs say about the poses of a model.

use std::collections::BTreeMap;

use volery_geometry::epipolar::{essential_from_pose, squared_sampson_error};
use volery_scene::{ImageId, RegisteredImage, SparseModel, TwoViewGeometry, TwoViewKind};

use super::ties::MIN_PART_IMAGES;

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
/// Matches of a pair that are asked.
const MAX_ASKED: usize = 100;

/// The contradicting pair that weighs most.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contradiction {
    /// Its images.
    pub images: (ImageId, ImageId),
    /// Its matches.
    pub num_inliers: usize,
    /// By how much its rotation differs, degrees, where it has one.
    pub rotation_residual_deg: Option<f64>,
}

/// Verified pairs of posed images.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Witnesses {
    /// Pairs that could be asked.
    pub num_asked: usize,
    /// Those that disagree with the poses.
    pub num_contradicting: usize,
    /// Part of the matches of all that are in contradicting pairs.
    pub contradiction: f64,
    /// Worst contradicting pair.
    pub worst: Option<Contradiction>,
    /// Of the pairs with one image up to this one and the other after it, the greatest part of
    /// matches in contradicting pairs.
    pub worst_cut: Option<(ImageId, f64)>,
}

impl Witnesses {
    /// Asks every verified pair whose images both have a pose.
    pub fn of(model: &SparseModel, pairs: &[TwoViewGeometry]) -> Self {
        let mut found = Self::default();
        let (mut all, mut against) = (0usize, 0usize);
        let mut cuts: BTreeMap<ImageId, (isize, isize)> = BTreeMap::new();
        for pair in pairs.iter().filter(|pair| pair.num_inliers() >= MIN_WITNESS_INLIERS) {
            let Some(testimony) = Testimony::of(model, pair) else { continue };
            let num_inliers = pair.num_inliers();
            let held_against = if testimony.contradicts() { num_inliers } else { 0 };
            found.num_asked += 1;
            all += num_inliers;
            against += held_against;
            for (id, sign) in [(pair.image1, 1), (pair.image2, -1)] {
                let cut = cuts.entry(id).or_default();
                cut.0 += sign * num_inliers as isize;
                cut.1 += sign * held_against as isize;
            }
            if held_against > 0 {
                found.num_contradicting += 1;
                if found.worst.is_none_or(|worst| num_inliers > worst.num_inliers) {
                    found.worst = Some(Contradiction {
                        images: (pair.image1, pair.image2),
                        num_inliers,
                        rotation_residual_deg: testimony.rotation_residual_deg,
                    });
                }
            }
        }
        found.contradiction = if all > 0 { against as f64 / all as f64 } else { 0.0 };
        found.worst_cut = worst_cut(&cuts);
        found
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
        let point_of = |image: &RegisteredImage, keypoint: u32| {
            image.points.get(keypoint as usize).copied().flatten()
        };
        let stride = pair.matches.len().div_ceil(MAX_ASKED).max(1);
        let (mut asked, mut agreeing) = (0usize, 0usize);
        let (mut num_seeing, mut num_sharing) = (0, 0);
        for (index, m) in pair.matches.iter().enumerate() {
            let (a, b) = (point_of(image1, m.feature1), point_of(image2, m.feature2));
            let shares = a.is_some() && a == b;
            num_seeing += usize::from(a.is_some() || b.is_some());
            num_sharing += usize::from(shares);
            if index % stride != 0 {
                continue;
            }
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
            // Images from one place have no epipolar lines; to share a point says more anyway.
            agreeing += usize::from(shares || error <= limit);
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
