//! The pose of an image when it is nearly known already: between frames of a flight.

use nalgebra::{Isometry3, Point2};
use volery_geometry::{Camera, linearize, median};
use volery_scene::Features;

use crate::acceptance::{Evidence, MIN_CONFIRMED, covariance_in_map, judge};
use crate::correspondences::Pair;
use crate::localize::{LocalizeOptions, NotFoundReason, PoseEstimate, Status};
use crate::map_share::map_share;
use crate::refine::{Sight, WeightedPose, refine_weighted};
use crate::solve::{PoseSolver, relative_sigma};
use crate::{Correspondence, LocalizationIndex};

/// Whitened errors, squared, beyond which a point does not support a pose: one of 250 good ones.
const MAX_SQUARED_ERROR: f64 = 11.0;

/// A point of the map where an image shows it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeenPoint {
    /// Where, pixels.
    pub pixel: Point2<f64>,
    /// Which point of the index.
    pub point: u32,
    /// Noise of the pixel relative to that of others.
    pub relative_sigma: f64,
}

/// A pose by points of the map.
#[derive(Debug, Clone, PartialEq)]
pub struct SeenPose {
    /// The pose.
    pub estimate: PoseEstimate,
    /// The points that it rests on.
    pub seen: Vec<SeenPoint>,
}

impl SeenPoint {
    fn of(sight: &Sight) -> Self {
        let Sight { pixel, point_index: point, relative_sigma, .. } = *sight;
        Self { pixel, point, relative_sigma }
    }

    /// A point where a feature shows it.
    pub fn of_feature(features: &Features, sighting: &Correspondence) -> Option<Self> {
        let keypoint = features.keypoints.get(sighting.keypoint as usize)?;
        let relative_sigma = relative_sigma(keypoint);
        Some(Self { pixel: keypoint.pixel(), point: sighting.point, relative_sigma })
    }

    fn sight(&self, index: &LocalizationIndex) -> Option<Sight> {
        let point = index.points.get(self.point as usize)?;
        Some(Sight {
            pixel: self.pixel,
            relative_sigma: self.relative_sigma,
            point: point.position,
            point_index: self.point,
            covariance: point.covariance.map(f64::from),
        })
    }
}

/// The pose of an image that was taken near `cam_from_world`, from where the points `seen` are in
/// view: as [`crate::localize`], without retrieval, RANSAC and the search for rivals. The pose
/// given must be right within a hundredth or so of the image's width.
pub fn localize_near(
    features: &Features,
    camera: &Camera,
    index: &LocalizationIndex,
    cam_from_world: &Isometry3<f64>,
    seen: &[SeenPoint],
) -> Status {
    let solver = PoseSolver::new(index, features, camera, &LocalizeOptions::default());
    let known = seen.iter().filter(|seen| (seen.point as usize) < index.points.len());
    let seeds = known.map(|seen| Pair { keypoint: 0, point: seen.point }).collect();
    solver.solve_near(cam_from_world, seeds)
}

/// The pose from which an image shows the points `seen`, outliers among them, close to `initial`.
/// `num_tried`: points that were looked for.
///
/// # Errors
///
/// Why no pose is believed.
pub fn pose_from_points(
    seen: &[SeenPoint],
    num_tried: usize,
    camera: &Camera,
    index: &LocalizationIndex,
    initial: &Isometry3<f64>,
) -> Result<SeenPose, NotFoundReason> {
    let mut sights: Vec<Sight> = seen.iter().filter_map(|seen| seen.sight(index)).collect();
    // Sights that the first pose has behind the camera leave it undetermined.
    sights.retain(|sight| (initial * sight.point).z > 0.0);
    let pose = refine_weighted(&sights, camera, initial).ok_or(NotFoundReason::TooFewInliers)?;
    let cam_from_world = pose.cam_from_world;
    sights.retain(|sight| {
        squared_error(sight, camera, &pose).is_some_and(|error| error < MAX_SQUARED_ERROR)
    });
    let from_map = map_share(index, &sights, camera, &pose);
    let covariance = covariance_in_map(&cam_from_world, &(pose.covariance + from_map));
    let pixels: Vec<Point2<f64>> = sights.iter().map(|sight| sight.pixel).collect();
    let mut depths: Vec<f64> = sights.iter().map(|s| (cam_from_world * s.point).z).collect();
    let median_depth = median(&mut depths).unwrap_or(0.0);
    let evidence = Evidence {
        inliers: &pixels,
        num_visible: num_tried,
        min_confirmed: MIN_CONFIRMED,
        median_depth,
        covariance: &covariance,
    };
    judge(&evidence, camera)?;
    let squares: f64 = sights.iter().filter_map(|s| offset(s, camera, &cam_from_world)).sum();
    let estimate = PoseEstimate {
        map_from_camera: cam_from_world.inverse(),
        covariance,
        num_inliers: sights.len(),
        num_correspondences: num_tried,
        reprojection_px: (squares / sights.len().max(1) as f64).sqrt(),
        sightings: Vec::new(),
    };
    Ok(SeenPose { estimate, seen: sights.iter().map(SeenPoint::of).collect() })
}

/// rᵀ S⁻¹ r
fn squared_error(sight: &Sight, camera: &Camera, pose: &WeightedPose) -> Option<f64> {
    let at = linearize(camera, &pose.cam_from_world, &sight.point)?;
    let noise = sight.noise(&at.by_point, pose.squared_sigma);
    let r = at.pixel - sight.pixel;
    Some(r.dot(&noise.cholesky()?.solve(&r)))
}

/// Square of the reprojection error, pixels².
fn offset(sight: &Sight, camera: &Camera, cam_from_world: &Isometry3<f64>) -> Option<f64> {
    Some((camera.project(&(cam_from_world * sight.point))? - sight.pixel).norm_squared())
}
