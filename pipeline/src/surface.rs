//! What comes after the sparse map: the dense cloud, then the mesh. What fails here is told in the
//! summary; the sparse map stays.

use std::path::Path;

use volery_scene::{EnvironmentMap, Photos, Stage};

use crate::{
    atomic::write_atomic,
    cache::Cache,
    clock::Stopwatch,
    dense::{Dense, dense, depth_maps},
    error::PipelineError,
    export::write_info,
    files::Files,
    free_space::{described, free_space},
    map_folder::{MapInfo, file},
    mesh::{NUM_STEPS, mesh, textured_glb},
    options::StageOptions,
    progress::StageProgress,
    report_surface::{SurfacePictures, draw_surface, plan},
    spec::{JobSpec, StageGroup},
    summary::{DenseSummary, MeshSummary, StageReport},
    view::Surface,
};

/// What was learned on the way.
#[derive(Default)]
pub(crate) struct SurfaceTrace {
    pub(crate) dense: Option<DenseSummary>,
    pub(crate) mesh: Option<MeshSummary>,
    pub(crate) stages: Vec<StageReport>,
    pub(crate) pictures: SurfacePictures,
}

/// Adds the dense cloud and the mesh to the map folder, as far as the job asks for them and they
/// can be made. Only a request to stop is an error.
pub(crate) fn add_surface(
    spec: &JobSpec,
    files: &Files,
    map: &EnvironmentMap,
    info: &MapInfo,
    options: &StageOptions,
    [work_dir, out_dir]: [&Path; 2],
    progress: &dyn StageProgress,
) -> Result<SurfaceTrace, PipelineError> {
    let mut trace = SurfaceTrace::default();
    if !spec.runs(StageGroup::Dense) {
        return Ok(trace);
    }
    let mut info = info.clone();
    let watch = Stopwatch::start();
    let made = Cache::open(work_dir, Stage::Fusion).and_then(|cache| {
        let units = Cache::open(work_dir, Stage::DepthMaps)?;
        let mut dense = dense(files, &map.model, options, [&cache, &units], progress)?;
        let maps = depth_maps(&map.model, options, &dense, &units);
        let grid = free_space(&dense, &map.model, maps, &cache, progress)?;
        let (bytes, free_space) = described(&grid);
        trace.pictures.plan = plan(&grid, &map.model);
        write_atomic(&out_dir.join(file::DENSE), &dense.ply)?;
        write_atomic(&out_dir.join(file::FREE_SPACE), &bytes)?;
        info.num_dense_points = Some(dense.cloud.points.len());
        info.free_space_voxel = Some(free_space.voxel);
        dense.summary.free_space = Some(free_space);
        write_info(&info, out_dir)?;
        Ok(dense)
    });
    let dense = match made {
        Ok(dense) => dense,
        Err(error) if error.is_cancelled() => return Err(error),
        Err(error) => {
            trace.dense = Some(DenseSummary { error: Some(error), ..DenseSummary::default() });
            return Ok(trace);
        }
    };
    let units = dense.summary.num_depth_maps;
    if dense.cached {
        found_finished(progress, Stage::DepthMaps, 2 * units);
        found_finished(progress, Stage::Fusion, units);
    }
    trace.stages.push(watch.stage("dense", units, usize::from(dense.cached) * units));
    trace.dense = Some(dense.summary.clone());
    trace.pictures.views.clone_from(&dense.pictures);
    if !spec.runs(StageGroup::Mesh) {
        return Ok(trace);
    }

    let watch = Stopwatch::start();
    let folders = [work_dir, out_dir];
    let made = add_mesh(&dense, map, &mut info, files, options, folders, progress);
    let (summary, cached) = match made {
        Ok(made) => {
            draw_surface(&mut trace.pictures.views, &Surface::open(out_dir)?, &map.model);
            made
        }
        Err(error) if error.is_cancelled() => return Err(error),
        Err(error) => (MeshSummary { error: Some(error), ..MeshSummary::default() }, false),
    };
    trace.stages.push(watch.stage("mesh", 1, usize::from(cached)));
    trace.mesh = Some(summary);
    Ok(trace)
}

/// Tells of a stage of which nothing was left to do.
fn found_finished(progress: &dyn StageProgress, stage: Stage, units: usize) {
    progress.report(stage, units, units);
    progress.reused(stage, units);
}

fn add_mesh(
    dense: &Dense,
    map: &EnvironmentMap,
    info: &mut MapInfo,
    photos: &dyn Photos,
    options: &StageOptions,
    [work_dir, out_dir]: [&Path; 2],
    progress: &dyn StageProgress,
) -> Result<(MeshSummary, bool), PipelineError> {
    let cache = Cache::open(work_dir, Stage::Meshing)?;
    let Dense { cloud, key, summary, .. } = dense;
    let units = Cache::open(work_dir, Stage::DepthMaps)?;
    let maps = depth_maps(&map.model, options, dense, &units);
    let made = mesh(cloud, summary.spacing, key, maps, &options.mesh, &cache, progress)?;
    if made.cached {
        found_finished(progress, Stage::Meshing, NUM_STEPS);
    }
    write_atomic(&out_dir.join(file::MESH), &made.ply)?;
    info.num_triangles = Some(made.mesh.triangles.len());
    write_info(info, out_dir)?;
    let mut summary = MeshSummary::of(&made.mesh);
    let cache = Cache::open(work_dir, Stage::Texturing)?;
    match textured_glb(&made, map, &info.content_id(), photos, &options.mesh, &cache, progress) {
        Ok(glb) => write_atomic(&out_dir.join(file::GLB), &glb)?,
        Err(error) if error.is_cancelled() => return Err(error),
        Err(error) => summary.error = Some(error),
    }
    Ok((summary, made.cached))
}
