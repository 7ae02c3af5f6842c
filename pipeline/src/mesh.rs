//! The last stage: a dense cloud to a colored mesh.

use nalgebra::Point3;
use volery_formats::{GlbMap, read_ply_of_mesh, write_glb_of_textured_mesh, write_ply_of_mesh};
use volery_meshing::{
    MeshingError, PoissonOptions, SightVotes, TrimOptions, color_vertices, decimate,
    reconstruct_surface, statistical_inliers, texture_mesh, trim,
};
use volery_scene::{DepthMap, EnvironmentMap, Photos, PointCloud, Progress, Stage, TriangleMesh};

use crate::{
    cache::{Cache, Key, KeyMaker},
    error::{PipelineError, code},
    options::MeshOptions,
};

/// Steps that are told as progress.
pub(crate) const NUM_STEPS: usize = 6;
/// Of the texture.
const JPEG_QUALITY: u8 = 85;
/// Least depth of the octree that is tried.
const MIN_OCTREE_DEPTH: u32 = 6;
/// Neighbors by which outliers are told.
const NUM_NEIGHBORS: usize = 12;
/// Standard deviations of the mean distance to neighbors above which a point is an outlier.
const MAX_SIGMAS: f64 = 2.5;
/// Least density of samples relative to the median: lines of sight tell what is a surface, the
/// density what is founded at all.
const MIN_DENSITY_RATIO: f64 = 0.01;
/// Holes up to so many cells of the octree across are filled.
const MAX_HOLE_CELLS: f64 = 12.0;
/// Parts of less than so many cells across are crumbs.
const MIN_PART_CELLS: f64 = 12.0;

/// A mesh with its files.
pub(crate) struct Mesh {
    pub(crate) mesh: TriangleMesh,
    /// The content of `mesh.ply`.
    pub(crate) ply: Vec<u8>,
    /// Hash of what it was made from.
    pub(crate) key: Key,
    /// Whether it came from the cache.
    pub(crate) cached: bool,
}

/// The mesh of a cloud whose points are `spacing` apart, and of the depth maps it came from: they
/// are only asked for if the mesh is not in the cache.
pub(crate) fn mesh(
    cloud: &PointCloud,
    spacing: Option<f64>,
    cloud_key: &Key,
    depth_maps: impl Iterator<Item = DepthMap>,
    options: &MeshOptions,
    cache: &Cache,
    progress: &dyn Progress,
) -> Result<Mesh, PipelineError> {
    let key = KeyMaker::new("mesh").with(cloud_key.as_bytes()).with_debug(options).key();
    if let Some(ply) = cache.get(&key)
        && let Ok(mesh) = read_ply_of_mesh(&ply)
    {
        return Ok(Mesh { mesh, ply, key, cached: true });
    }
    let ply = write_ply_of_mesh(&surface(cloud, spacing, depth_maps, options, progress)?);
    cache.put(&key, &ply)?;
    // As it comes from the cache: positions in 32 bits.
    let mesh = read_ply_of_mesh(&ply)
        .map_err(|e| PipelineError::plain(code::MESH_FAILED, e.to_string()))?;
    Ok(Mesh { mesh, ply, key, cached: false })
}

/// The content of `map.glb`: the mesh painted with the photos.
pub(crate) fn textured_glb(
    made: &Mesh,
    map: &EnvironmentMap,
    map_id: &str,
    photos: &dyn Photos,
    options: &MeshOptions,
    cache: &Cache,
    progress: &dyn Progress,
) -> Result<Vec<u8>, PipelineError> {
    let key = KeyMaker::new("texture")
        .with(made.key.as_bytes())
        .with_debug(&(options.texture, JPEG_QUALITY, map.scale.metric, map_id, map.origin))
        .key();
    if let Some(glb) = cache.get(&key) {
        return Ok(glb);
    }
    let textured = texture_mesh(&made.mesh, &map.model, photos, &options.texture, progress);
    let textured = textured.map_err(|error| match error {
        MeshingError::Cancelled(cancelled) => cancelled.into(),
        _ => PipelineError::plain(code::TEXTURE_FAILED, error.to_string()),
    })?;
    let glb = write_glb_of_textured_mesh(&textured, &GlbMap::of(map, map_id), JPEG_QUALITY)
        .map_err(|e| PipelineError::plain(code::TEXTURE_FAILED, e.to_string()))?;
    cache.put(&key, &glb)?;
    Ok(glb)
}

fn surface(
    cloud: &PointCloud,
    spacing: Option<f64>,
    depth_maps: impl Iterator<Item = DepthMap>,
    options: &MeshOptions,
    progress: &dyn Progress,
) -> Result<TriangleMesh, PipelineError> {
    let steps = Steps(progress);
    steps.finished(0)?;
    let points: Vec<Point3<f64>> = cloud.points.iter().map(|p| p.position.cast()).collect();
    let inliers = statistical_inliers(&points, NUM_NEIGHBORS, MAX_SIGMAS).map_err(failure)?;
    drop(points);
    let kept = cloud.points.iter().zip(&inliers).filter(|(_, inlier)| **inlier);
    let cleaned = PointCloud { points: kept.map(|(point, _)| *point).collect() };
    steps.finished(1)?;
    let extent = extent(&cleaned);
    let depth = octree_depth(extent, spacing, options.max_octree_depth);
    let cell = extent / f64::from(1_u32 << depth);
    let poisson = PoissonOptions { depth, ..PoissonOptions::default() };
    let mut surface = reconstruct_surface(&cleaned, &poisson, &steps).map_err(failure)?;
    steps.finished(2)?;
    let mut votes = SightVotes::new(surface.mesh.vertices.len());
    for map in depth_maps {
        progress.check()?;
        votes.add(&surface.mesh.vertices, &map);
    }
    votes.discredit_unseen(&mut surface);
    drop(votes);
    steps.finished(3)?;
    let trimming = TrimOptions {
        min_density_ratio: MIN_DENSITY_RATIO,
        max_hole_area: (MAX_HOLE_CELLS * cell).powi(2),
        min_component_area: (MIN_PART_CELLS * cell).powi(2),
    };
    let trimmed = trim(&surface, &trimming).mesh;
    drop(surface);
    steps.finished(4)?;
    let mut mesh = decimate(&trimmed, options.max_triangles, &steps)?;
    drop(trimmed);
    steps.finished(5)?;
    color_vertices(&mut mesh, &cleaned);
    if mesh.triangles.is_empty() {
        return Err(PipelineError::new(
            code::EMPTY_MESH,
            format!("{} points support no surface", cleaned.points.len()),
            "show more of the surfaces, from several places",
        ));
    }
    steps.finished(NUM_STEPS)?;
    Ok(mesh)
}

/// The depth at which the finest cells are about as large as the distance between the points.
fn octree_depth(extent: f64, spacing: Option<f64>, max_depth: u32) -> u32 {
    let cells = extent / spacing.unwrap_or(0.0);
    let depth =
        if cells.is_finite() && cells > 1.0 { cells.log2().ceil() as u32 } else { max_depth };
    depth.clamp(MIN_OCTREE_DEPTH.min(max_depth), max_depth)
}

/// Longest side of the box around the points.
fn extent(cloud: &PointCloud) -> f64 {
    let positions = || cloud.points.iter().map(|point| point.position.cast::<f64>());
    let low = positions().fold(Point3::from([f64::INFINITY; 3]), |low, p| low.inf(&p));
    let high = positions().fold(Point3::from([f64::NEG_INFINITY; 3]), |high, p| high.sup(&p));
    if cloud.points.is_empty() { 0.0 } else { (high - low).max() }
}

fn failure(error: MeshingError) -> PipelineError {
    match error {
        MeshingError::Cancelled(cancelled) => cancelled.into(),
        MeshingError::TooFewPoints { .. } | MeshingError::SamePlace => PipelineError::new(
            code::TOO_FEW_POINTS,
            error.to_string(),
            "show more of the surfaces, from several places",
        ),
        _ => PipelineError::plain(code::MESH_FAILED, error.to_string()),
    }
}

/// Tells the steps of the stage; those inside of a step are not told.
struct Steps<'a>(&'a dyn Progress);

impl Steps<'_> {
    fn finished(&self, step: usize) -> Result<(), PipelineError> {
        self.0.report(Stage::Meshing, step, NUM_STEPS);
        Ok(self.0.check()?)
    }
}

impl Progress for Steps<'_> {
    fn report(&self, _stage: Stage, _done: usize, _total: usize) {}

    fn is_cancelled(&self) -> bool {
        self.0.is_cancelled()
    }
}
