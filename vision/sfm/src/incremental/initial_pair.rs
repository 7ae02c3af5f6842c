//! The two images a model starts from.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector2};
use volery_estimation::BundleOptions;
use volery_geometry::epipolar::poses_from_essential;
use volery_geometry::median;
use volery_geometry::triangulation::{camera_center, triangulation_angle};
use volery_scene::{Cancelled, Progress, TwoViewGeometry, TwoViewKind};

use super::working::WorkingModel;

/// Demands on the two-view model after its adjustment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct InitialDemands {
    pub(crate) min_points: usize,
    pub(crate) min_median_angle_deg: f64,
}

impl InitialDemands {
    /// Tried in this order. Walks indoors seldom have pairs with many matches and a wide angle.
    pub(crate) const LADDER: [Self; 3] = [
        Self { min_points: 100, min_median_angle_deg: 4.0 },
        Self { min_points: 50, min_median_angle_deg: 2.5 },
        Self { min_points: 25, min_median_angle_deg: 1.8 },
    ];
}

/// Angle from which more parallax makes a pair no better.
const ENOUGH_ANGLE_DEG: f64 = 10.0;
/// Greatest cosine between the baseline and the view: forward motion hides the depth.
const MAX_FORWARD_MOTION: f64 = 0.97;
/// Points of the two-view model among its matches.
const MIN_POINT_RATIO: f64 = 0.5;

/// Pairs that a model of the usable images could start from, best first.
pub(crate) fn rank_initial_pairs(model: &WorkingModel<'_>) -> Vec<usize> {
    let mut ranked: Vec<(f64, usize)> = model
        .input
        .pairs
        .iter()
        .enumerate()
        .filter(|(_, pair)| {
            let usable = |id: u32| model.usable.get(id as usize).copied().unwrap_or(false);
            usable(pair.image1.0) && usable(pair.image2.0)
        })
        .filter_map(|(index, pair)| {
            let (angle, trust) = match pair.kind {
                TwoViewKind::General => (pair.median_parallax.to_degrees(), 1.0),
                // A plane leaves two decompositions; only when there is nothing better.
                TwoViewKind::Planar => (pair.median_parallax.to_degrees(), 0.2),
                TwoViewKind::Uncalibrated => (uncalibrated_angle_deg(model, pair)?, 1.0),
                TwoViewKind::RotationOnly => return None,
            };
            let gain = (angle / ENOUGH_ANGLE_DEG).min(1.0);
            (gain > 0.0).then(|| (trust * gain * pair.num_inliers() as f64, index))
        })
        .collect();
    ranked.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    ranked.into_iter().map(|(_, index)| index).collect()
}

/// Median parallax of a pair whose pose has to be had from its fundamental matrix.
fn uncalibrated_angle_deg(model: &WorkingModel<'_>, pair: &TwoViewGeometry) -> Option<f64> {
    let pose = relative_pose(model, pair)?;
    let mut angles: Vec<f64> = pair
        .matches
        .iter()
        .filter_map(|m| {
            let xy1 = ray(model, pair.image1.0, m.feature1)?;
            let xy2 = ray(model, pair.image2.0, m.feature2)?;
            let ray2_in_cam1 = pose.rotation.inverse_transform_vector(&xy2.push(1.0));
            Some(xy1.push(1.0).angle(&ray2_in_cam1))
        })
        .collect();
    median(&mut angles).map(f64::to_degrees)
}

fn ray(model: &WorkingModel<'_>, image: u32, keypoint: u32) -> Option<Vector2<f64>> {
    *model.rays.get(image as usize)?.get(keypoint as usize)?
}

/// `cam2_from_cam1` of a pair: as verified, or from its fundamental matrix (of a turn, its
/// homography) and the current focal lengths.
pub(crate) fn relative_pose(
    model: &WorkingModel<'_>,
    pair: &TwoViewGeometry,
) -> Option<Isometry3<f64>> {
    if pair.cam2_from_cam1.is_some() {
        return pair.cam2_from_cam1;
    }
    let k1 = model.camera(pair.image1.0 as usize).calibration_matrix();
    let k2 = model.camera(pair.image2.0 as usize).calibration_matrix();
    if pair.kind == TwoViewKind::RotationOnly {
        let turn = k2.try_inverse()? * pair.homography? * k1;
        let turn = UnitQuaternion::from_matrix(&(turn / turn.determinant().cbrt()));
        return Some(Isometry3::from_parts(Translation3::identity(), turn));
    }
    let essential = k2.transpose() * pair.fundamental? * k1;
    let stride = pair.matches.len().div_ceil(200).max(1);
    let num_in_front = |pose: &Isometry3<f64>| {
        pair.matches
            .iter()
            .step_by(stride)
            .filter(|m| {
                let (Some(xy1), Some(xy2)) =
                    (ray(model, pair.image1.0, m.feature1), ray(model, pair.image2.0, m.feature2))
                else {
                    return false;
                };
                is_in_front(pose, &xy1, &xy2)
            })
            .count()
    };
    poses_from_essential(&essential)?
        .into_iter()
        .map(|pose| (num_in_front(&pose), pose))
        // The first of equals, so that the result does not depend on anything else.
        .reduce(|best, next| if next.0 > best.0 { next } else { best })
        .map(|(_, pose)| pose)
}

/// Whether the two rays meet in front of both cameras.
fn is_in_front(pose: &Isometry3<f64>, xy1: &Vector2<f64>, xy2: &Vector2<f64>) -> bool {
    // z₂ x₂ = z₁ R x₁ + t, solved for the depths by the normal equations.
    let a = pose.rotation * xy1.push(1.0);
    let b = xy2.push(1.0);
    let t = pose.translation.vector;
    let (aa, ab, bb, at, bt) =
        (a.norm_squared(), a.dot(&b), b.norm_squared(), a.dot(&t), b.dot(&t));
    let determinant = aa * bb - ab * ab;
    let z1 = (ab * bt - bb * at) / determinant;
    let z2 = (aa * bt - ab * at) / determinant;
    z1 > 0.0 && z2 > 0.0
}

impl WorkingModel<'_> {
    /// Starts the model with a pair; `false` (and an empty model) if it does not meet the demands.
    pub(crate) fn initialize(
        &mut self,
        pair: usize,
        demands: InitialDemands,
        progress: &dyn Progress,
    ) -> Result<bool, Cancelled> {
        let pair = &self.input.pairs[pair];
        let (i, j) = (pair.image1.0 as usize, pair.image2.0 as usize);
        let Some(mut pose) = relative_pose(self, pair) else { return Ok(false) };
        let baseline = pose.translation.vector.norm();
        if baseline <= 0.0 || !baseline.is_finite() {
            return Ok(false);
        }
        pose.translation.vector /= baseline;
        self.poses[i] = Some(Isometry3::identity());
        self.poses[j] = Some(pose);
        self.triangulate_image(i);
        let options = BundleOptions { max_iterations: 20, ..BundleOptions::default() };
        for _ in 0..2 {
            self.adjust_all(&options, progress)?;
            self.filter_points_of(&[i]);
            self.triangulate_image(i);
        }
        let accepted = self.meets(i, j, demands, pair.num_inliers());
        if !accepted {
            self.remove_image(i);
            self.remove_image(j);
        }
        Ok(accepted)
    }

    fn meets(&self, i: usize, j: usize, demands: InitialDemands, num_matches: usize) -> bool {
        let (Some(pose1), Some(pose2)) = (self.poses[i], self.poses[j]) else { return false };
        let (center1, center2) = (camera_center(&pose1), camera_center(&pose2));
        let forward = (pose1.rotation * (center2 - center1).normalize()).z.abs();
        let mut angles: Vec<f64> = self.image_tracks[i]
            .iter()
            .filter_map(|&(track, _)| self.tracks[track as usize].position)
            .map(|point| triangulation_angle(&center1, &center2, &point).to_degrees())
            .collect();
        let num_points = angles.len();
        num_points >= demands.min_points
            && num_points as f64 >= MIN_POINT_RATIO * num_matches as f64
            && forward <= MAX_FORWARD_MOTION
            && median(&mut angles).is_some_and(|angle| angle >= demands.min_median_angle_deg)
    }
}
