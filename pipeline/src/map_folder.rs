//! A map folder: what [`crate::reconstruct`] writes and localization reads.

use std::{fs, path::Path};

use serde::{Deserialize, Serialize};
use volery_formats::{ColmapFiles, colmap::read_colmap_text};
use volery_geometry::Camera;
use volery_localization::{
    LocalizationAnswer, LocalizationIndex, LocalizationPrior, LocalizeOptions, StepTimings,
};
use volery_scene::{EnvironmentMap, Gravity, GrayImage, OriginRule, Quality, Scale, SparseModel};

use crate::{
    cameras::scaled_to,
    error::{PipelineError, code},
    heading::NorthInMap,
    moved::MovedBy,
    spec::CameraSpec,
};

/// Layout of the folder that this software writes and reads.
pub const MAP_FORMAT: u32 = 1;

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
    /// Oriented points of the surfaces, with confidence.
    pub const DENSE: &str = "dense.ply";
    /// The surface.
    pub const MESH: &str = "mesh.ply";
    /// The surface as glTF; points and cameras while there is none.
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
    /// Points of the dense cloud, if it was made.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub num_dense_points: Option<usize>,
    /// Triangles of the mesh, if it was made.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub num_triangles: Option<usize>,
    /// Corners of the box around the points, without the outermost percent.
    pub bounds: Option<[[f64; 3]; 2]>,
    /// How the compass of the flight lies in the map, if it had one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub north: Option<NorthInMap>,
    /// The map was moved after the localization index was made; `None` if it was not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map_from_index: Option<MovedBy>,
    /// Seed of the run.
    pub seed: u64,
    /// Everything that went in.
    pub inputs: Vec<MapInput>,
}

impl MapInfo {
    /// A name of the map by its content: equal inputs and options give equal ids.
    pub fn content_id(&self) -> String {
        let mut hasher = blake3::Hasher::new();
        hasher.update(self.software.as_bytes()).update(&self.seed.to_le_bytes());
        for input in &self.inputs {
            hasher.update(input.name.as_bytes()).update(input.blake3.as_bytes());
        }
        hasher.finalize().to_hex()[..32].to_owned()
    }
}

/// An open map folder.
pub struct MapFolder {
    info: MapInfo,
    cameras: Vec<Camera>,
    index: LocalizationIndex,
}

impl MapFolder {
    /// Reads `map.json` and the localization index.
    pub fn open(folder: &Path) -> Result<Self, PipelineError> {
        let info = read_info(folder)?;
        let path = folder.join(file::LOCALIZATION);
        let bytes = fs::read(&path).map_err(|e| PipelineError::io(&path, &e))?;
        let index = LocalizationIndex::from_bytes(&bytes).map_err(|e| bad_map(&path, e))?;
        let cameras = info.cameras.iter().map(CameraSpec::camera).collect::<Result<_, _>>();
        let cameras = cameras.map_err(|e| bad_map(&folder.join(file::MAP), e))?;
        Ok(Self { info, cameras, index })
    }

    /// Facts of the map.
    pub fn info(&self) -> &MapInfo {
        &self.info
    }

    /// What localization reads.
    pub fn index(&self) -> &LocalizationIndex {
        &self.index
    }

    /// The camera of a query of this size when none is given: the map's first camera of the same
    /// aspect ratio, scaled; `None` when there is none.
    pub fn camera_for(&self, width: u32, height: u32) -> Option<Camera> {
        self.cameras.iter().find_map(|camera| scaled_to(camera, width, height))
    }

    /// The pose of an image in the map, with the time of its steps.
    pub fn localize(
        &self,
        image: &GrayImage,
        camera: &Camera,
        prior: &LocalizationPrior,
        options: &LocalizeOptions,
    ) -> (LocalizationAnswer, StepTimings) {
        let start = std::time::Instant::now();
        let clock = move || start.elapsed().as_secs_f64();
        let index = &self.index;
        match &self.info.map_from_index {
            None => volery_localization::localize(image, camera, index, prior, options, &clock),
            Some(moved) => {
                let prior = moved.prior_in_index(prior);
                let (mut answer, timings) =
                    volery_localization::localize(image, camera, index, &prior, options, &clock);
                moved.move_answer(&mut answer);
                (answer, timings)
            }
        }
    }
}

/// Reads `map.json`.
pub fn read_info(folder: &Path) -> Result<MapInfo, PipelineError> {
    let path = folder.join(file::MAP);
    let bytes = fs::read(&path).map_err(|e| {
        PipelineError::new(
            code::BAD_MAP,
            format!("{}: {e}", path.display()),
            "name a folder that `volery reconstruct` has finished",
        )
    })?;
    let info: MapInfo = serde_json::from_slice(&bytes).map_err(|e| bad_map(&path, e))?;
    if info.format != MAP_FORMAT {
        return Err(bad_map(&path, format!("format {} is not {MAP_FORMAT}", info.format)));
    }
    Ok(info)
}

/// Reads the model and the facts of a map folder; zones and unplaced images are not in it.
pub fn read_map(folder: &Path) -> Result<(MapInfo, EnvironmentMap), PipelineError> {
    let info = read_info(folder)?;
    let read = |name: &str| {
        let path = folder.join(file::COLMAP).join(name);
        fs::read(&path).map_err(|e| PipelineError::io(&path, &e))
    };
    let files = ColmapFiles {
        cameras: read("cameras.txt")?,
        images: read("images.txt")?,
        points: read("points3D.txt")?,
    };
    let model: SparseModel =
        read_colmap_text(&files).map_err(|e| bad_map(&folder.join(file::COLMAP), e))?;
    let map = EnvironmentMap {
        model,
        zones: Vec::new(),
        unplaced: Vec::new(),
        scale: info.scale,
        gravity: info.gravity,
        origin: info.origin,
        quality: info.quality.clone(),
    };
    Ok((info, map))
}

fn bad_map(path: &Path, error: impl std::fmt::Display) -> PipelineError {
    PipelineError::new(
        code::BAD_MAP,
        format!("{}: {error}", path.display()),
        "reconstruct the map again",
    )
}
