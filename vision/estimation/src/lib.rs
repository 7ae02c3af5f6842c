//! Minimal solvers, robust estimation, bundle adjustment.

pub mod absolute_pose;
pub mod bundle_adjustment;
pub mod ransac;
pub mod similarity;
pub mod solvers;
pub mod two_view;

#[cfg(test)]
mod test_scene;

pub use absolute_pose::{
    AbsolutePose, AbsolutePoseError, AbsolutePoseOptions, RefinedPose, estimate_absolute_pose,
    estimate_absolute_pose_and_focal, refine_absolute_pose,
};
pub use bundle_adjustment::{
    BundleError, BundleOptions, BundleProblem, BundleReport, IntrinsicsRefinement, adjust_bundle,
    adjust_bundle_near_rotations,
};
pub use similarity::{
    EstimatedSimilarity, SimilarityError, SimilarityOptions, estimate_similarity,
};
pub use two_view::{TwoViewOptions, estimate_two_view_geometry};
