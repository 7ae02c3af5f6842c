//! A map folder: what [`crate::reconstruct`] writes and localization reads.

use std::path::Path;

use serde::{Deserialize, Serialize};
use volery_geometry::Camera;
use volery_localization::{
    LocalizationAnswer, LocalizationIndex, LocalizationPrior, LocalizeOptions, StepTimings,
};
use volery_scene::{Gravity, GrayImage, OriginRule, Quality, Scale};

use crate::{error::PipelineError, spec::CameraSpec};

/// Names of the files in a map folder.
pub mod file {
    /// Facts of the map: [`super::MapInfo`].
    pub const MAP: &str = "map.json";
    /// Camera-to-world poses.
    pub const POSES: &str = "poses.csv";
    /// Folder of COLMAP's text files.
    pub const COLMAP: &str = "colmap";
    /// Points.
    pub const SPARSE: &str = "sparse.ply";
    /// Points and cameras as glTF.
    pub const GLB: &str = "map.glb";
    /// For nerfstudio.
    pub const TRANSFORMS: &str = "transforms.json";
    /// What localization reads.
    pub const LOCALIZATION: &str = "localization.bin";
    /// What came of the run: [`crate::Summary`].
    pub const REPORT: &str = "report.json";
    /// The same for people.
    pub const REPORT_HTML: &str = "report.html";
}

/// An image that went into a map.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct MapInput {
    /// As given.
    pub name: String,
    /// BLAKE3 of its bytes, hex.
    pub blake3: String,
}

/// Facts of a map: the content of `map.json`. No time of day: equal runs give equal bytes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MapInfo {
    /// Of the folder's layout.
    pub format: u32,
    /// Of the software that made it.
    pub software: String,
    /// Metric scale with its proof.
    pub scale: Scale,
    /// Gravity with its proof.
    pub gravity: Gravity,
    /// Rule of the origin.
    pub origin: OriginRule,
    /// How far to trust it.
    pub quality: Quality,
    /// Cameras in the order of their ids.
    pub cameras: Vec<CameraSpec>,
    /// Images with a pose.
    pub num_images: usize,
    /// Points.
    pub num_points: usize,
    /// Corners of the box around the points, without the outermost percent.
    pub bounds: Option<[[f64; 3]; 2]>,
    /// Seed of the run.
    pub seed: u64,
    /// Everything that went in.
    pub inputs: Vec<MapInput>,
}

/// An open map folder.
pub struct MapFolder {
    info: MapInfo,
    index: LocalizationIndex,
}

impl MapFolder {
    /// Reads `map.json` and the localization index.
    pub fn open(folder: &Path) -> Result<Self, PipelineError> {
        let _ = folder;
        todo!()
    }

    /// Facts of the map.
    pub fn info(&self) -> &MapInfo {
        &self.info
    }

    /// What localization reads.
    pub fn index(&self) -> &LocalizationIndex {
        &self.index
    }

    /// The camera of a query of this size when none is given: the map's camera of the same aspect
    /// ratio, scaled; `None` when there is none.
    pub fn camera_for(&self, width: u32, height: u32) -> Option<Camera> {
        let _ = (width, height);
        todo!()
    }

    /// The pose of an image in the map. `Instant` measures the steps.
    pub fn localize(
        &self,
        image: &GrayImage,
        camera: &Camera,
        prior: &LocalizationPrior,
        options: &LocalizeOptions,
    ) -> (LocalizationAnswer, StepTimings) {
        let start = std::time::Instant::now();
        let clock = move || start.elapsed().as_secs_f64();
        volery_localization::localize(image, camera, &self.index, prior, options, &clock)
    }
}
