//! Matches between two images and the geometry that explains them.

use nalgebra::{Isometry3, Matrix3};

use crate::ImageId;

/// A pair of feature indices.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct FeatureMatch {
    /// Index into the features of image 1.
    pub feature1: u32,
    /// Index into the features of image 2.
    pub feature2: u32,
}

/// What explains the matches of a pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum TwoViewKind {
    /// Translation and parallax over a scene with depth: E is well determined.
    General,
    /// One plane (or no measurable depth relief) under a moving camera: H explains all.
    Planar,
    /// The camera only turned: the rotation explains all, no translation can be had.
    RotationOnly,
    /// The focal length is a guess, so only F was estimated.
    Uncalibrated,
}

/// Verified matches of a pair with the geometry that explains them.
#[derive(Debug, Clone, PartialEq)]
pub struct TwoViewGeometry {
    /// First image; `image1 < image2`.
    pub image1: ImageId,
    /// Second image.
    pub image2: ImageId,
    /// Which model won.
    pub kind: TwoViewKind,
    /// Inliers only, one per feature of either image.
    pub matches: Vec<FeatureMatch>,
    /// Matches before verification.
    pub num_putative: usize,
    /// Relative pose; translation of unit length, zero for [`TwoViewKind::RotationOnly`]. `None`
    /// for [`TwoViewKind::Uncalibrated`] and for a turn of a camera whose focal length is a guess.
    pub cam2_from_cam1: Option<Isometry3<f64>>,
    /// `x₂ᵀ F x₁ = 0` in pixels (undistorted), where estimated.
    pub fundamental: Option<Matrix3<f64>>,
    /// `x₂ ~ H x₁` in pixels (undistorted), where it has support.
    pub homography: Option<Matrix3<f64>>,
    /// Median angle between the rays of the inliers once the rotation is taken out, radians.
    pub median_parallax: f64,
}

impl TwoViewGeometry {
    /// Number of verified matches.
    pub fn num_inliers(&self) -> usize {
        self.matches.len()
    }
}
