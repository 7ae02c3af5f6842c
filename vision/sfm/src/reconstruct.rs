//! Verified pairs to sparse models: the incremental and the global mapper, validated, the better
//! one kept.

use nalgebra::Point2;
use volery_estimation::IntrinsicsRefinement;
use volery_geometry::Camera;
use volery_scene::{
    CameraId, Cancelled, ImageId, ImagePrior, Progress, Quality, SparseModel, TwoViewGeometry,
    UnplacedImage,
};

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
    /// What else is known.
    pub prior: ImagePrior,
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
}

impl Default for MapperOptions {
    fn default() -> Self {
        Self { seed: 0, min_angle: 1.5_f64.to_radians(), max_error_px: 4.0 }
    }
}

/// What came of the pairs. Models are in arbitrary frames (no scale, no gravity).
#[derive(Debug, Clone, PartialEq)]
pub struct Reconstruction {
    /// Largest first; the first is the map, the others are zones. Empty if nothing could be built.
    pub models: Vec<SparseModel>,
    /// Images without a pose in `models[0]`.
    pub unplaced: Vec<UnplacedImage>,
    /// Verdict over `models[0]`.
    pub quality: Quality,
    /// `incremental` or `global`: whose model was kept.
    pub mapper: &'static str,
}

/// Why there is nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum ReconstructError {
    /// Asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// Two images are the least.
    #[error("a reconstruction needs at least 2 images, got {got}")]
    TooFewImages {
        /// What came.
        got: usize,
    },
}

/// Sparse models of the images that the verified `pairs` tie together.
pub fn reconstruct(
    images: &[SfmImage],
    cameras: &[SfmCamera],
    pairs: &[TwoViewGeometry],
    options: &MapperOptions,
    progress: &dyn Progress,
) -> Result<Reconstruction, ReconstructError> {
    let _ = (images, cameras, pairs, options, progress);
    todo!()
}
