//! The pose of one more image.

use nalgebra::{Isometry3, Point2, Point3};
use volery_estimation::{AbsolutePoseOptions, estimate_absolute_pose};
use volery_geometry::epipolar::{essential_from_pose, squared_sampson_error};

use super::working::WorkingModel;

/// How much support a pose needs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Support {
    /// Inliers.
    pub(crate) min_inliers: usize,
    /// Inliers among the visible points.
    pub(crate) min_ratio: f64,
}

impl Support {
    /// For the first attempts.
    pub(crate) const STRICT: Self = Self { min_inliers: 30, min_ratio: 0.35 };
    /// When nothing else joins any more.
    pub(crate) const RELAXED: Self = Self { min_inliers: 15, min_ratio: 0.25 };
}

/// Inlier threshold of resection, pixels of an image 1000 wide; wider than that of the points
/// since the map around a new image has not been adjusted to it.
const MAX_ERROR_PX: f64 = 8.0;
/// Sampson error, pixels, up to which a verified match agrees with a new pose.
const MAX_SAMPSON_PX: f64 = 12.0;
/// Inliers from which a pair's word counts.
const MIN_WITNESS_INLIERS: usize = 25;

impl WorkingModel<'_> {
    /// Pose of `image` from the points its tracks see, checked against its verified pairs. `None` if the support is too small or the pairs contradict.
    pub(crate) fn resect(&self, image: usize, support: Support) -> Option<Isometry3<f64>> {
        let mut pixels: Vec<Point2<f64>> = Vec::new();
        let mut points: Vec<Point3<f64>> = Vec::new();
        for &(track, slot) in &self.image_tracks[image] {
            let track = &self.tracks[track as usize];
            if let Some(position) = track.position {
                pixels.push(self.pixel(&track.sightings[slot as usize]));
                points.push(position);
            }
        }
        let camera = self.camera(image);
        let max_error_px = MAX_ERROR_PX * (f64::from(camera.width) / 1000.0).max(1.0);
        let options = AbsolutePoseOptions {
            max_error_px,
            min_inliers: support.min_inliers,
            ..AbsolutePoseOptions::default()
        };
        let seed = self.input.options.seed ^ (image as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let pose = estimate_absolute_pose(&pixels, &points, camera, &options, seed).ok()?;
        let enough = (pose.num_inliers as f64) >= support.min_ratio * pixels.len() as f64;
        (enough && !self.is_contradicted(image, &pose.cam_from_world))
            .then_some(pose.cam_from_world)
    }

    /// Whether most verified matches of `image` with posed images violate the epipolar geometry
    /// of the poses.
    pub(crate) fn is_contradicted(&self, image: usize, cam_from_world: &Isometry3<f64>) -> bool {
        let (mut agree, mut disagree) = (0usize, 0usize);
        for pair in self.input.pairs {
            let (i, j) = (pair.image1.0 as usize, pair.image2.0 as usize);
            if (i != image && j != image) || pair.num_inliers() < MIN_WITNESS_INLIERS {
                continue;
            }
            let pose_of = |k: usize| if k == image { Some(*cam_from_world) } else { self.poses[k] };
            let (Some(pose1), Some(pose2)) = (pose_of(i), pose_of(j)) else { continue };
            let essential = essential_from_pose(&(pose2 * pose1.inverse()));
            let focal = 0.5 * (self.camera(i).mean_focal() + self.camera(j).mean_focal());
            let limit = (MAX_SAMPSON_PX / focal).powi(2);
            for m in &pair.matches {
                let (Some(Some(xy1)), Some(Some(xy2))) =
                    (self.rays[i].get(m.feature1 as usize), self.rays[j].get(m.feature2 as usize))
                else {
                    continue;
                };
                let error =
                    squared_sampson_error(&essential, &Point2::from(*xy1), &Point2::from(*xy2));
                if error <= limit {
                    agree += 1;
                } else {
                    disagree += 1;
                }
            }
        }
        disagree > agree
    }
}
