//! A map folder: what [`crate::reconstruct`] writes and localization reads.

use std::{
    fs,
    path::{Path, PathBuf},
    sync::OnceLock,
};

use serde::{Deserialize, Serialize};
use volery_api::LocalizeMethod;
use volery_formats::{ColmapFiles, colmap::read_colmap_text};
use volery_geometry::Camera;
use volery_localization::{
    LocalizationAnswer, LocalizationIndex, LocalizationPrior, LocalizeOptions, RenderScore, Status,
    StepTimings, TemplateOptions, localize_by_template, render_score, template::Light,
};
use volery_rendering::DrawableMesh;
use volery_scene::{EnvironmentMap, Gravity, GrayImage, OriginRule, Quality, Scale, SparseModel};

use crate::{
    cameras::scaled_to,
    error::{PipelineError, code},
    heading::NorthInMap,
    moved::MovedBy,
    spec::CameraSpec,
    view::Surface,
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
    /// Where there is air, surface, or nothing known: a grid of voxels.
    pub const FREE_SPACE: &str = "freespace.bin";
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
    /// Map folders of the parts that nothing ties to the map, `1` the largest.
    pub const ZONES: &str = "zones";
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
    /// Edge of the voxels of the free space, if it was made.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub free_space_voxel: Option<f64>,
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
    /// The map that these are the facts of; zones and unplaced images are not in it.
    pub(crate) fn map(&self, model: SparseModel) -> EnvironmentMap {
        EnvironmentMap {
            model,
            zones: Vec::new(),
            unplaced: Vec::new(),
            scale: self.scale,
            gravity: self.gravity,
            origin: self.origin,
            quality: self.quality.clone(),
        }
    }

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
    folder: PathBuf,
    /// Read when it is first asked for.
    surface: OnceLock<Result<Surface, PipelineError>>,
}

/// The answer to a photo.
#[derive(Debug, Clone, PartialEq)]
pub struct Located {
    /// The pose, or why there is none.
    pub answer: LocalizationAnswer,
    /// Which way answered.
    pub method: LocalizeMethod,
    /// The mesh, drawn from the pose, against the photo.
    pub score: Option<RenderScore>,
    /// Light and sharpness, if they were measured.
    pub light: Option<Light>,
    /// Of the steps.
    pub timings: StepTimings,
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
        let (folder, surface) = (folder.to_owned(), OnceLock::new());
        Ok(Self { info, cameras, index, folder, surface })
    }

    /// Facts of the map.
    pub fn info(&self) -> &MapInfo {
        &self.info
    }

    /// What a virtual camera can draw of the map.
    pub fn surface(&self) -> Result<&Surface, PipelineError> {
        self.surface.get_or_init(|| Surface::open(&self.folder)).as_ref().map_err(Clone::clone)
    }

    /// The first camera of the map.
    pub fn first_camera(&self) -> Option<&Camera> {
        self.cameras.first()
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

    /// The pose of an image in the map, one way or the other (P61): by features, and if they match
    /// nothing and the map has a mesh, by comparing the image with views of it.
    ///
    /// # Errors
    ///
    /// A mesh that cannot be read, and for [`LocalizeMethod::Template`] a map without one.
    pub fn locate(
        &self,
        image: &GrayImage,
        camera: &Camera,
        prior: &LocalizationPrior,
        options: &LocalizeOptions,
        method: LocalizeMethod,
    ) -> Result<Located, PipelineError> {
        if method == LocalizeMethod::Template {
            let mesh = self.surface()?.mesh().ok_or_else(|| {
                PipelineError::new(
                    "no_mesh",
                    "the map has no mesh to compare the photo with",
                    "reconstruct it with the stage `mesh`, or ask with the method `pnp`",
                )
            })?;
            return Ok(by_template(image, camera, mesh, prior));
        }
        let (answer, timings) = self.localize(image, camera, prior, options);
        let method_used = LocalizeMethod::Pnp;
        let mut located =
            Located { answer, method: method_used, score: None, light: None, timings };
        if method == LocalizeMethod::Pnp {
            return Ok(located);
        }
        let Some(mesh) = self.surface()?.mesh() else { return Ok(located) };
        match &located.answer.status {
            Status::Ok(estimate) => {
                let pose = estimate.map_from_camera.inverse();
                located.score = render_score(image, camera, mesh, &pose);
            }
            Status::NotFound(_) if prior.position.is_some() && prior.yaw.is_some() => {
                let mut other = by_template(image, camera, mesh, prior);
                if !matches!(other.answer.status, Status::NotFound(_)) {
                    other.timings.features_ms = timings.features_ms;
                    other.timings.match_ms = timings.match_ms;
                    other.timings.solve_ms += timings.solve_ms;
                    return Ok(other);
                }
            }
            _ => {}
        }
        Ok(located)
    }

    /// The pose of an image in the map by features, with the time of its steps.
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

/// Places are searched as far as this many deviations of the prior's position.
const SEARCHED_SIGMAS: f64 = 2.0;

fn by_template(
    image: &GrayImage,
    camera: &Camera,
    mesh: &DrawableMesh,
    prior: &LocalizationPrior,
) -> Located {
    let start = std::time::Instant::now();
    let mut options = TemplateOptions::default();
    if let Some((_, sigma)) = prior.position {
        options.radius = SEARCHED_SIGMAS * sigma;
    }
    let found = localize_by_template(image, camera, mesh, prior, &options);
    let solve_ms = start.elapsed().as_secs_f64() * 1e3;
    Located {
        answer: LocalizationAnswer {
            status: found.status,
            num_features: 0,
            num_correspondences: 0,
        },
        method: LocalizeMethod::Template,
        score: found.proof.map(|proof| proof.score),
        light: found.proof.map(|proof| proof.light),
        timings: StepTimings { solve_ms, ..StepTimings::default() },
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
    let map = info.map(model);
    Ok((info, map))
}

fn bad_map(path: &Path, error: impl std::fmt::Display) -> PipelineError {
    PipelineError::new(
        code::BAD_MAP,
        format!("{}: {error}", path.display()),
        "reconstruct the map again",
    )
}
