//! What a reconstruction is asked to do.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};
pub use volery_api::{JobOptions, PoseSource, Preset, StageGroup};
use volery_geometry::{Camera, CameraError, CameraModel};
use volery_scene::{ImagePrior, KnownDistance, OriginRule};

/// Intrinsics in a file: COLMAP's model name and parameter order, first pixel center (0.5, 0.5).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraSpec {
    /// COLMAP's name.
    pub model: CameraModel,
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// COLMAP's order.
    pub params: Vec<f64>,
}

impl CameraSpec {
    /// The checked camera.
    pub fn camera(&self) -> Result<Camera, CameraError> {
        Camera::new(self.model, self.width, self.height, &self.params)
    }
}

impl From<&Camera> for CameraSpec {
    fn from(camera: &Camera) -> Self {
        Self {
            model: camera.model,
            width: camera.width,
            height: camera.height,
            params: camera.params().to_vec(),
        }
    }
}

/// One photo of a job.
#[derive(Debug, Clone, PartialEq)]
pub struct ImageInput {
    /// Unique name; the order of the images is the order of capture.
    pub name: String,
    /// Its bytes.
    pub path: PathBuf,
    /// Its calibration; kept fixed. Otherwise [`JobSpec::camera`], EXIF or a guess.
    pub camera: Option<CameraSpec>,
    /// Images without calibration share a camera only within a group.
    pub camera_group: Option<String>,
    /// What else is known of it.
    pub prior: ImagePrior,
}

impl ImageInput {
    /// A photo of which nothing is known.
    pub fn new(name: impl Into<String>, path: impl Into<PathBuf>) -> Self {
        Self {
            name: name.into(),
            path: path.into(),
            camera: None,
            camera_group: None,
            prior: ImagePrior::default(),
        }
    }
}

/// A reconstruction.
#[derive(Debug, Clone, PartialEq)]
pub struct JobSpec {
    /// Photos in the order of capture.
    pub images: Vec<ImageInput>,
    /// Calibration of all photos that have none of their own; kept fixed.
    pub camera: Option<CameraSpec>,
    /// Measured distances between cameras.
    pub known_distances: Vec<KnownDistance>,
    /// Effort.
    pub preset: Preset,
    /// Of all random choices.
    pub seed: u64,
    /// Which point becomes the origin; `None` keeps the frame of position priors if there are
    /// any and else takes the last camera.
    pub origin: Option<OriginRule>,
    /// Where the poses of the photos come from.
    pub poses: PoseSource,
    /// Numbers that differ from those of the preset.
    pub options: JobOptions,
    /// How far to go: to the last one named, with all before it; where the preset ends when empty.
    pub stages: Vec<StageGroup>,
}

impl JobSpec {
    /// A job over `images` with every option at its default.
    pub fn new(images: Vec<ImageInput>) -> Self {
        Self {
            images,
            camera: None,
            known_distances: Vec::new(),
            preset: Preset::default(),
            seed: 0,
            origin: None,
            poses: PoseSource::default(),
            options: JobOptions::default(),
            stages: Vec::new(),
        }
    }

    /// Whether the job runs this part of the way.
    pub fn runs(&self, stage: StageGroup) -> bool {
        stage <= self.preset.last_stage(&self.stages)
    }
}
