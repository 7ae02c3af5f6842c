//! Two-view geometry of putative matches.

mod correspondences;
mod estimators;
mod outcome;
mod poses;
mod refinement;
mod search;
mod selection;
mod turn;
mod verification;

use nalgebra::Point2;
use volery_geometry::Camera;
use volery_scene::{FeatureMatch, ImageId, TwoViewGeometry};

use verification::Verification;

/// Options of [`estimate_two_view_geometry`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TwoViewOptions {
    /// Inlier threshold, pixels (Sampson for E and F, transfer for H and R).
    pub max_error_px: f64,
    /// Fewest inliers of a verified pair.
    pub min_inliers: usize,
    /// Whether the focal lengths are known well enough for E; otherwise F is estimated.
    pub calibrated: bool,
}

impl Default for TwoViewOptions {
    fn default() -> Self {
        Self { max_error_px: 4.0, min_inliers: 15, calibrated: true }
    }
}

/// Which geometry explains the putative matches of a pair (P20–P25), by LO-RANSAC over E (or F),
/// H and pure rotation and a model choice among them.
///
/// * `pixels1`, `pixels2`: keypoints of each image as detected (distorted), pixels.
/// * Returns `None` when no model has `min_inliers`.
/// * Deterministic for equal arguments.
#[allow(clippy::too_many_arguments)]
pub fn estimate_two_view_geometry(
    image1: ImageId,
    camera1: &Camera,
    pixels1: &[Point2<f64>],
    image2: ImageId,
    camera2: &Camera,
    pixels2: &[Point2<f64>],
    matches: &[FeatureMatch],
    options: &TwoViewOptions,
    seed: u64,
) -> Option<TwoViewGeometry> {
    let verification = Verification::new((camera1, pixels1), (camera2, pixels2), matches, options)?;
    let mut geometry = if options.calibrated {
        verification.calibrated(seed)?
    } else {
        verification.uncalibrated(seed)?
    };
    (geometry.image1, geometry.image2) = (image1, image2);
    Some(geometry)
}

#[cfg(test)]
mod tests;
