//! The pose of an image by features and PnP, or the reason why there is none.

use nalgebra::{Isometry3, Matrix6, Point3};
use volery_geometry::Camera;
use volery_scene::GrayImage;

use crate::LocalizationIndex;

/// What is known before.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LocalizationPrior {
    /// Position in the map with its sigma, meters.
    pub position: Option<(Point3<f64>, f64)>,
    /// Yaw in the map (rotation about +z of the camera's forward axis from map x), with sigma,
    /// radians.
    pub yaw: Option<(f64, f64)>,
}

/// Options of [`localize`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalizeOptions {
    /// Most features taken from the image.
    pub max_features: usize,
    /// Map images compared in detail.
    pub num_retrieved: usize,
    /// Seed of the random choices.
    pub seed: u64,
}

impl Default for LocalizeOptions {
    fn default() -> Self {
        Self { max_features: 2000, num_retrieved: 10, seed: 0 }
    }
}

/// Milliseconds per step; the caller measures decoding.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StepTimings {
    /// SIFT.
    pub features_ms: f64,
    /// Retrieval and matching.
    pub match_ms: f64,
    /// RANSAC and refinement.
    pub solve_ms: f64,
}

/// A pose with its proof.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseEstimate {
    /// Camera in the map.
    pub map_from_camera: Isometry3<f64>,
    /// Order: position x, y, z in the map (m), then rotation about map x, y, z (rad).
    pub covariance: Matrix6<f64>,
    /// Inliers of the pose.
    pub num_inliers: usize,
    /// Inliers over correspondences.
    pub inlier_ratio: f64,
    /// Root mean square reprojection error, pixels.
    pub reprojection_px: f64,
}

/// Why an image was not found. The names are stable codes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NotFoundReason {
    /// Too few features in the image.
    TooFewFeatures,
    /// Too few matches to the map.
    TooFewMatches,
    /// No pose has enough support.
    TooFewInliers,
    /// The support is bunched in a small part of the image.
    PoorSpread,
    /// The pose's covariance is too large.
    Uncertain,
}

impl NotFoundReason {
    /// The stable code.
    pub fn code(self) -> &'static str {
        match self {
            Self::TooFewFeatures => "too_few_features",
            Self::TooFewMatches => "too_few_matches",
            Self::TooFewInliers => "too_few_inliers",
            Self::PoorSpread => "poor_spread",
            Self::Uncertain => "uncertain",
        }
    }
}

/// Whether there is a pose.
#[derive(Debug, Clone, PartialEq)]
pub enum Status {
    /// One pose stands out.
    Ok(PoseEstimate),
    /// Several poses are about as good; best first.
    Ambiguous(Vec<PoseEstimate>),
    /// None.
    NotFound(NotFoundReason),
}

/// The answer to one image.
#[derive(Debug, Clone, PartialEq)]
pub struct LocalizationAnswer {
    /// Whether there is a pose.
    pub status: Status,
    /// Features in the image.
    pub num_features: usize,
    /// 2D–3D correspondences.
    pub num_correspondences: usize,
}

/// The pose of `image` in the map of `index` (P60, P61). Deterministic. `clock` gives seconds
/// from any start, for the timings.
pub fn localize(
    image: &GrayImage,
    camera: &Camera,
    index: &LocalizationIndex,
    prior: &LocalizationPrior,
    options: &LocalizeOptions,
    clock: &dyn Fn() -> f64,
) -> (LocalizationAnswer, StepTimings) {
    let _ = (image, camera, index, prior, options, clock);
    todo!()
}
