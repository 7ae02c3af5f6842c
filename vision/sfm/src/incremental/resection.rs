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
    /// The same where the verified pairs endorse the pose.
    pub(crate) min_endorsed_ratio: f64,
}

impl Support {
    /// For the first attempts.
    pub(crate) const STRICT: Self =
        Self { min_inliers: 30, min_ratio: 0.35, min_endorsed_ratio: 0.35 };
    /// When nothing else joins any more.
    pub(crate) const RELAXED: Self =
        Self { min_inliers: 15, min_ratio: 0.25, min_endorsed_ratio: 0.15 };
}

/// Inlier threshold of resection, pixels of an image 1000 wide; wider than that of the points
/// since the map around a new image has not been adjusted to it.
const MAX_ERROR_PX: f64 = 8.0;
/// Sampson error, pixels, up to which a verified match agrees with a new pose.
const MAX_SAMPSON_PX: f64 = 12.0;
/// Inliers from which a pair's word counts.
const MIN_WITNESS_INLIERS: usize = 25;
/// Part of the verified matches that must obey a pose to endorse it, and their least number.
const MIN_ENDORSEMENT: f64 = 0.75;
const MIN_ENDORSING_MATCHES: usize = 100;

impl WorkingModel<'_> {
    /// Pose of `image` from the points its tracks see, checked against its verified pairs. `None`
    /// if the support is too small or the pairs contradict.
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
        let ratio = pose.num_inliers as f64 / pixels.len() as f64;
        let (agree, disagree) = self.testimony(image, &pose.cam_from_world);
        // A crowd of wrong points outvotes right ones, but not the verified pairs as well.
        let is_endorsed = pose.num_inliers >= Support::STRICT.min_inliers
            && ratio >= support.min_endorsed_ratio
            && agree as f64 >= MIN_ENDORSEMENT * (agree + disagree) as f64
            && agree >= MIN_ENDORSING_MATCHES;
        let is_supported = ratio >= support.min_ratio && agree >= disagree;
        (is_supported || is_endorsed).then_some(pose.cam_from_world)
    }

    /// How many verified matches of `image` with posed images obey the epipolar geometry of the
    /// poses, and how many violate it.
    fn testimony(&self, image: usize, cam_from_world: &Isometry3<f64>) -> (usize, usize) {
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
        (agree, disagree)
    }
}
