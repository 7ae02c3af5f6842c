//! Keypoints and descriptors.

use nalgebra::Point2;

/// Bytes of a SIFT descriptor.
pub const DESCRIPTOR_LEN: usize = 128;

/// RootSIFT in bytes of at most 127: a unit vector times 256, rounded, so that the norm is near 256.
pub type Descriptor = [u8; DESCRIPTOR_LEN];

/// A location with scale and orientation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Keypoint {
    /// Pixels, first pixel center (0.5, 0.5).
    pub x: f32,
    /// Pixels.
    pub y: f32,
    /// Gaussian scale sigma, pixels of the image.
    pub scale: f32,
    /// Radians, from image x towards image y.
    pub orientation: f32,
}

impl Keypoint {
    /// Location, pixels.
    pub fn pixel(&self) -> Point2<f64> {
        Point2::new(f64::from(self.x), f64::from(self.y))
    }
}

/// The features of one image: keypoint i has descriptor i.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Features {
    /// Locations.
    pub keypoints: Vec<Keypoint>,
    /// As many as keypoints.
    pub descriptors: Vec<Descriptor>,
}

impl Features {
    /// Number of features.
    pub fn len(&self) -> usize {
        self.keypoints.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.keypoints.is_empty()
    }
}
