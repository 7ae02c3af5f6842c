//! What mapping starts from.

use std::sync::Arc;

use nalgebra::Point2;
use volery_estimation::IntrinsicsRefinement;
use volery_geometry::Camera;
use volery_scene::{CameraId, Features, ImageId, ImagePrior};

/// A camera as it is known before mapping.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SfmCamera {
    /// First intrinsics.
    pub camera: Camera,
    /// Which of them may move.
    pub refine: IntrinsicsRefinement,
    /// Whether the focal length is a guess (no EXIF, no calibration).
    pub focal_is_guess: bool,
}

impl SfmCamera {
    /// A camera with a calibration that is held.
    pub fn calibrated(camera: Camera) -> Self {
        Self { camera, refine: IntrinsicsRefinement::FIXED, focal_is_guess: false }
    }
}

/// An image as the mapper sees it. Position in the slice = order of capture.
#[derive(Debug, Clone, PartialEq)]
pub struct SfmImage {
    /// Id; equals its index in the slice.
    pub id: ImageId,
    /// File name.
    pub name: String,
    /// Its camera, an index into the cameras.
    pub camera: CameraId,
    /// Keypoints, pixels, as detected; `TwoViewGeometry` matches index into them.
    pub keypoints: Vec<Point2<f64>>,
    /// sRGB at the keypoints; as many.
    pub colors: Vec<[u8; 3]>,
    /// Scales and descriptors of the keypoints; empty if they are not at hand.
    pub features: Arc<Features>,
    /// What else is known.
    pub prior: ImagePrior,
}

impl SfmImage {
    /// The image at `index`, of the first camera, gray, named by its index, with nothing else known.
    pub fn from_keypoints(index: usize, keypoints: Vec<Point2<f64>>) -> Self {
        Self {
            id: ImageId(index as u32),
            name: format!("{index:04}"),
            camera: CameraId(0),
            colors: vec![[128; 3]; keypoints.len()],
            keypoints,
            features: Arc::default(),
            prior: ImagePrior::default(),
        }
    }

    /// The same with the scales and descriptors of its keypoints.
    pub fn from_features(index: usize, features: Arc<Features>) -> Self {
        let keypoints = features.keypoints.iter().map(|k| k.pixel()).collect();
        Self { features, ..Self::from_keypoints(index, keypoints) }
    }
}

/// Options of [`reconstruct`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapperOptions {
    /// Seed of all random choices.
    pub seed: u64,
    /// Least triangulation angle of a point, radians.
    pub min_angle: f64,
    /// Greatest reprojection error of an observation, pixels.
    pub max_error_px: f64,
    /// Images stand where their priors' poses say, and only points are computed.
    pub poses_are_given: bool,
}

impl Default for MapperOptions {
    fn default() -> Self {
        Self { seed: 0, min_angle: 1.5_f64.to_radians(), max_error_px: 4.0, poses_are_given: false }
    }
}
