//! What came of a reconstruction: the content of `report.json`.

use serde::{Deserialize, Serialize};
pub use volery_api::Warning;
use volery_scene::{Gravity, OriginRule, Quality, Scale, TriangleMesh, UnplacedReason, Verdict};

use crate::{error::PipelineError, spec::CameraSpec};

/// Whether and why an image has its pose.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ImageReport {
    /// As given.
    pub name: String,
    /// Whether it has a pose in the map.
    pub registered: bool,
    /// Why not.
    pub reason: Option<UnplacedReason>,
    /// For people, e.g. what is wrong with its bytes.
    pub detail: Option<String>,
    /// Name of the image whose bytes it repeats.
    pub duplicate_of: Option<String>,
    /// Features found.
    pub num_features: usize,
    /// Features that see a point of the map.
    pub num_observations: usize,
    /// Mean reprojection error of the points it sees, pixels.
    pub reprojection_px: Option<f64>,
}

/// Where a camera's first intrinsics came from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CameraSource {
    /// A calibration; kept fixed.
    Given,
    /// EXIF; refined.
    Exif,
    /// 1.2 times the longer side; refined.
    Guess,
}

/// A camera of the map.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CameraReport {
    /// Where it started.
    pub source: CameraSource,
    /// Focal length at the start, pixels of the original image.
    pub initial_focal_px: f64,
    /// As it ended.
    pub camera: CameraSpec,
    /// Number of images taken with it.
    pub num_images: usize,
}

/// Time of one stage.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StageReport {
    /// Name of the stage.
    pub name: String,
    /// Wall-clock seconds.
    pub wall_s: f64,
    /// CPU seconds of the process.
    pub cpu_s: f64,
    /// Units of work: images, pairs, ...
    pub units: usize,
    /// Units that came from the cache.
    pub cached: usize,
    /// Largest resident set of the process so far, MiB.
    #[serde(default)]
    pub peak_rss_mib: Option<f64>,
}

/// What came of the dense reconstruction.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct DenseSummary {
    /// Images with a depth map.
    pub num_depth_maps: usize,
    /// Pixels of all depth maps.
    pub num_pixels: usize,
    /// Pixels with a depth.
    pub num_known: usize,
    /// Points of the cloud.
    pub num_points: usize,
    /// Points that were concluded from their surroundings and not seen.
    pub num_inferred: usize,
    /// Least distance between points, in units of the map; finer detail is averaged.
    pub spacing: Option<f64>,
    /// Where there is air.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub free_space: Option<FreeSpaceSummary>,
    /// Why there is no cloud.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<PipelineError>,
}

/// What is known of the space between the surfaces. Volumes in cubic units of the map.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct FreeSpaceSummary {
    /// Edge of a voxel.
    pub voxel: f64,
    /// Voxels along x, y and z.
    pub size: [usize; 3],
    /// Volume that cameras saw through.
    pub free: f64,
    /// Volume of the voxels with a surface in them.
    pub occupied: f64,
    /// Volume that nobody saw, also behind walls.
    pub unseen: f64,
    /// Where free space ends without a surface, the largest first.
    pub unseen_areas: Vec<UnseenAreaSummary>,
}

/// A part of the border between free space and what nobody saw.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct UnseenAreaSummary {
    /// In the report.
    pub name: String,
    /// Its middle, in the map.
    pub center: [f64; 3],
    /// Sides of the box around it.
    pub size: [f64; 3],
    /// In square units of the map.
    pub area: f64,
}

/// What came of the meshing.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct MeshSummary {
    /// Corners of triangles.
    pub num_vertices: usize,
    /// Triangles.
    pub num_triangles: usize,
    /// In square units of the map.
    pub area: f64,
    /// Why there is no mesh, or no texture on it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<PipelineError>,
}

impl MeshSummary {
    /// Of a mesh.
    pub(crate) fn of(mesh: &TriangleMesh) -> Self {
        let area = |triangle: &[u32; 3]| {
            let [a, b, c] = triangle.map(|v| mesh.vertices[v as usize]);
            0.5 * (b - a).cross(&(c - a)).norm()
        };
        Self {
            num_vertices: mesh.vertices.len(),
            num_triangles: mesh.triangles.len(),
            area: mesh.triangles.iter().map(area).sum(),
            error: None,
        }
    }
}

/// What came of a reconstruction.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Of this software.
    pub version: String,
    /// Photos given.
    pub num_images: usize,
    /// Photos with a pose in the map.
    pub num_registered: usize,
    /// Points of the map.
    pub num_points: usize,
    /// Sightings of points.
    pub num_observations: usize,
    /// Mean over the observations, pixels.
    pub mean_reprojection_px: Option<f64>,
    /// Mean number of images that see a point.
    pub mean_track_length: Option<f64>,
    /// Image pairs with a verified geometry.
    pub num_verified_pairs: usize,
    /// Smaller parts that could not be tied to the map.
    pub num_zones: usize,
    /// Whose model was kept: `incremental` or `global`.
    pub mapper: String,
    /// Metric scale with its proof.
    pub scale: Scale,
    /// Gravity with its proof.
    pub gravity: Gravity,
    /// Rule of the origin.
    pub origin: OriginRule,
    /// How far to trust the map.
    pub quality: Quality,
    /// Cameras in the order of their ids.
    pub cameras: Vec<CameraReport>,
    /// Photos in the order given.
    pub images: Vec<ImageReport>,
    /// Of the dense cloud, if one was asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dense: Option<DenseSummary>,
    /// Of the mesh, if one was asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mesh: Option<MeshSummary>,
    /// In the order they ran.
    pub stages: Vec<StageReport>,
    /// What the user should know.
    pub warnings: Vec<Warning>,
    /// What would make the next capture better.
    pub advice: Vec<String>,
    /// Why there is no map.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<PipelineError>,
    /// Whole run, seconds.
    pub wall_s: f64,
    /// Whole run, seconds over all cores.
    pub cpu_s: f64,
    /// Largest resident set of the process so far, MiB.
    pub peak_rss_mib: Option<f64>,
}

impl Summary {
    /// Whether the map is good, holds nearly all photos and everything that was asked for.
    pub fn is_complete(&self) -> bool {
        self.quality.verdict == Verdict::Good
            && self.num_registered * 10 >= self.num_images * 9
            && self.surface_error().is_none()
    }

    /// Why there is no dense cloud or no mesh although they were asked for.
    pub fn surface_error(&self) -> Option<&PipelineError> {
        let dense = self.dense.as_ref().and_then(|dense| dense.error.as_ref());
        dense.or_else(|| self.mesh.as_ref()?.error.as_ref())
    }
}
