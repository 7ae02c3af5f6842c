//! Maps brought together by the shape of their surfaces, and the surface of what comes of it.

use std::{fs, path::PathBuf};

use volery_formats::read_ply_of_cloud;
use volery_registration::{NearbyOptions, Zone, register_anywhere};
use volery_scene::{EnvironmentMap, ImageId, RegisteredImage};

use super::{
    pairs::{Found, told},
    part::Part,
};
use crate::{
    JobSpec, PipelineError, StageGroup, StageProgress,
    error::code,
    files::Files,
    map_folder::{MapInfo, file},
    options::StageOptions,
    summary::DenseSummary,
    surface::{SurfaceTrace, add_surface},
};

/// Size of the detail that counts, meters.
const CELL: f64 = 0.05;

/// The transform between two maps by their dense clouds alone; both must be metric.
pub(super) fn align_surfaces(source: &Part, target: &Part) -> Result<Found, PipelineError> {
    let [source, target] = [zone(source)?, zone(target)?];
    let found = register_anywhere(&source, &target, &NearbyOptions::default());
    let found = found.map_err(|error| told(&error))?;
    Ok(Found {
        target_from_source: found.target_from_source,
        constraint: found.constraint,
        points: Vec::new(),
        num_pairs: 0,
        rms: found.overlap.rms,
        surfaces: Some((found.overlap, found.num_iterations)),
    })
}

fn zone(part: &Part) -> Result<Zone, PipelineError> {
    let lack = |code: &str, what: &str, hint: &str| {
        PipelineError::new(code, format!("{} has {what}", part.name), hint)
    };
    if part.info.num_dense_points.is_none() {
        let hint = "reconstruct it with the stage `dense`, or join it by points";
        return Err(lack("no_dense_cloud", "no dense cloud", hint));
    }
    if !part.info.scale.metric {
        let hint = "tell a known distance: surfaces alone do not tell the unit";
        return Err(lack("no_scale", "no metric scale", hint));
    }
    let path = part.folder.join(file::DENSE);
    let bytes = fs::read(&path).map_err(|e| PipelineError::io(&path, &e))?;
    let cloud = read_ply_of_cloud(&bytes)
        .map_err(|e| PipelineError::plain(code::BAD_MAP, format!("{}: {e}", path.display())))?;
    let viewpoints: Vec<_> = part.map.model.images.values().map(RegisteredImage::center).collect();
    Zone::new(&cloud, &viewpoints, CELL).map_err(|error| told(&error))
}

/// Dense cloud and mesh of a map that was joined, as far as the job asks for them, from those of its
/// photos that are among `photos`. Returns what was learned and the number of photos that are gone.
pub(super) fn surface_of_whole(
    spec: &JobSpec,
    map: &EnvironmentMap,
    info: &MapInfo,
    photos: &[PathBuf],
    folders: [&std::path::Path; 2],
    progress: &dyn StageProgress,
) -> Result<(SurfaceTrace, usize), PipelineError> {
    if !spec.runs(StageGroup::Dense) {
        return Ok((SurfaceTrace::default(), 0));
    }
    let files = Files::of_inputs(&map.model, &info.inputs, photos);
    let gone: Vec<ImageId> =
        map.model.images.keys().copied().filter(|id| files.get(*id).is_none()).collect();
    if gone.len() + 2 > map.model.images.len() {
        let detail = format!("{} of {} photos are gone", gone.len(), map.model.images.len());
        let error = Some(PipelineError::plain("no_photos", detail));
        let dense = Some(DenseSummary { error, ..DenseSummary::default() });
        return Ok((SurfaceTrace { dense, ..SurfaceTrace::default() }, gone.len()));
    }
    let mut seen = map.clone();
    gone.iter().for_each(|id| seen.model.remove_image(*id));
    let options = StageOptions::of(spec);
    let trace = add_surface(spec, &files, &seen, info, &options, folders, progress)?;
    Ok((trace, gone.len()))
}
