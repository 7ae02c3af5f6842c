//! Map folders to one map folder.

mod contents;
mod page;
mod part;
mod report;

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use nalgebra::Similarity3;
use volery_estimation::BundleError;
use volery_registration::{
    Link, PointOfPart, SharedAlignment, adjust_merged, align_shared_points, merge_models,
    solve_pose_graph,
};
use volery_scene::{EnvironmentMap, Progress, SparseModel, Stage};

use crate::{
    PipelineError,
    cache::write_atomic,
    error::code,
    export::{bounds, write_files},
    map_folder::{MapInfo, file},
};
use contents::{index, names_and_inputs, quality};
use part::Part;
pub use report::RegisterReport;
use report::{map_report, pair_report};

/// A link that loops through it contradict more is not used.
const MIN_WEIGHT: f64 = 0.5;

/// A map to be joined with others.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MapSource {
    /// For the report, and for photos whose name is taken.
    pub name: String,
    /// Its folder.
    pub folder: PathBuf,
}

/// Joins maps that share a part, in the frame of the first, and writes a map folder.
///
/// Points that look the same give the transform between two maps; all such transforms together
/// give the poses of the maps; then every pose and every point is refined together. Maps that share
/// nothing with the others are left out and named.
///
/// # Errors
///
/// [`PipelineError`] with the code `no_overlap` where no map joins the first, and for folders that
/// cannot be read or written.
pub fn register_maps(
    sources: &[MapSource],
    seed: u64,
    out_dir: &Path,
    progress: &dyn Progress,
) -> Result<RegisterReport, PipelineError> {
    if sources.len() < 2 {
        let detail = format!("{} maps were given", sources.len());
        return Err(PipelineError::new(code::BAD_INPUT, detail, "name two or more maps"));
    }
    let parts: Vec<Part> = sources
        .iter()
        .map(|source| Part::open(&source.name, &source.folder))
        .collect::<Result<_, _>>()?;
    let pairs = align_pairs(&parts, seed, progress)?;
    let links: Vec<Link> = pairs.iter().filter_map(Pair::link).collect();
    let graph = solve_pose_graph(parts.len(), &links, 0);
    if graph.frame_from_zone.iter().flatten().count() < 2 {
        return Err(no_overlap(&parts, &pairs));
    }
    let mut weights = graph.weights.iter();
    let used: Vec<bool> = pairs
        .iter()
        .map(|pair| pair.found.is_ok() && weights.next().is_some_and(|w| *w >= MIN_WEIGHT))
        .collect();
    progress.check()?;
    let merged = merge(&parts, &pairs, &used, &graph.frame_from_zone, progress)?;
    let report = write(&parts, &pairs, &used, merged, seed, out_dir, progress)?;
    let json = serde_json::to_vec_pretty(&report)
        .map_err(|e| PipelineError::plain(code::IO, e.to_string()))?;
    write_atomic(&out_dir.join(file::REPORT), &json)?;
    write_atomic(&out_dir.join(file::REPORT_HTML), page::page(&report).as_bytes())?;
    Ok(report)
}

/// Two maps by their places in the list, the later onto the earlier.
struct Pair {
    source: usize,
    target: usize,
    found: Result<SharedAlignment, PipelineError>,
}

impl Pair {
    fn link(&self) -> Option<Link> {
        let found = self.found.as_ref().ok()?;
        Some(Link::new(self.source, self.target, found.target_from_source, &found.constraint))
    }
}

fn align_pairs(
    parts: &[Part],
    seed: u64,
    progress: &dyn Progress,
) -> Result<Vec<Pair>, PipelineError> {
    let all: Vec<(usize, usize)> = (0..parts.len())
        .flat_map(|target| (target + 1..parts.len()).map(move |source| (source, target)))
        .collect();
    progress.report(Stage::Matching, 0, all.len());
    let mut pairs = Vec::new();
    for (source, target) in all.iter().copied() {
        progress.check()?;
        let (from, onto) = (&parts[source], &parts[target]);
        let matches = from.matches_with(onto);
        let found = align_shared_points(&from.map.model, &onto.map.model, &matches, seed);
        let found = found.map_err(|e| PipelineError::plain(e.code(), e.to_string()));
        pairs.push(Pair { source, target, found });
        progress.report(Stage::Matching, pairs.len(), all.len());
    }
    Ok(pairs)
}

fn no_overlap(parts: &[Part], pairs: &[Pair]) -> PipelineError {
    let told: Vec<String> = pairs
        .iter()
        .filter_map(|pair| {
            let error = pair.found.as_ref().err()?;
            Some(format!("{} and {}: {error}", parts[pair.target].name, parts[pair.source].name))
        })
        .collect();
    PipelineError::new(
        code::NO_OVERLAP,
        told.join("; "),
        "take a few photos that show what both maps show, and extend one of the maps with them",
    )
}

/// The merged model and where the parts lie in it.
struct Merged {
    model: SparseModel,
    poses: Vec<Option<Similarity3<f64>>>,
    num_shared: usize,
}

fn merge(
    parts: &[Part],
    pairs: &[Pair],
    used: &[bool],
    poses: &[Option<Similarity3<f64>>],
    progress: &dyn Progress,
) -> Result<Merged, PipelineError> {
    progress.report(Stage::Mapping, 0, 1);
    let joined: Vec<usize> = (0..parts.len()).filter(|&i| poses[i].is_some()).collect();
    let place: BTreeMap<usize, usize> = joined.iter().copied().zip(0..).collect();
    let models: Vec<(&SparseModel, Similarity3<f64>)> = joined
        .iter()
        .map(|&i| (&parts[i].map.model, poses[i].unwrap_or_else(Similarity3::identity)))
        .collect();
    let mut shared: Vec<(PointOfPart, PointOfPart)> = Vec::new();
    for (pair, _) in pairs.iter().zip(used).filter(|(_, used)| **used) {
        let (Some(&s), Some(&t)) = (place.get(&pair.source), place.get(&pair.target)) else {
            continue;
        };
        let found = pair.found.iter().flat_map(|found| &found.points);
        shared.extend(found.map(|&(source, target)| ((t, target), (s, source))));
    }
    let mut model = merge_models(&models, &shared);
    adjust_merged(&mut model, parts[joined[0]].num_images(), progress).map_err(
        |error| match error {
            BundleError::Cancelled(cancelled) => cancelled.into(),
            other => PipelineError::plain(code::NO_MODEL, other.to_string()),
        },
    )?;
    progress.report(Stage::Mapping, 1, 1);
    Ok(Merged { model, poses: poses.to_vec(), num_shared: shared.len() })
}

fn write(
    parts: &[Part],
    pairs: &[Pair],
    used: &[bool],
    merged: Merged,
    seed: u64,
    out_dir: &Path,
    progress: &dyn Progress,
) -> Result<RegisterReport, PipelineError> {
    let Merged { mut model, mut poses, num_shared } = merged;
    let first = &parts[0];
    // A map without a unit takes that of the first one that has it.
    let joined = |i: &usize| poses[*i].is_some();
    let unit = (0..parts.len()).filter(joined).find(|&i| parts[i].info.scale.metric);
    let scale = unit.map_or(first.info.scale, |i| parts[i].info.scale);
    if let Some(frame_from_unit) = unit.and_then(|i| poses[i]).filter(|_| !first.info.scale.metric)
    {
        let change = Similarity3::from_scaling(1.0 / frame_from_unit.scaling());
        model.transform(&change);
        poses.iter_mut().flatten().for_each(|pose| *pose = change * *pose);
    }
    let (names, inputs) = names_and_inputs(parts, &poses);
    model.images.values_mut().zip(names).for_each(|(image, name)| image.name = name);
    let info = MapInfo {
        scale,
        quality: quality(parts, &poses),
        cameras: model.cameras.values().map(Into::into).collect(),
        num_images: model.images.len(),
        num_points: model.points.len(),
        num_dense_points: None,
        num_triangles: None,
        bounds: bounds(&model),
        map_from_index: None,
        seed,
        inputs,
        ..first.info.clone()
    };
    let map = EnvironmentMap {
        model,
        zones: Vec::new(),
        unplaced: Vec::new(),
        scale: info.scale,
        gravity: info.gravity,
        origin: info.origin,
        quality: info.quality.clone(),
    };
    fs::create_dir_all(out_dir).map_err(|e| PipelineError::io(out_dir, &e))?;
    let index = index(parts, &poses, &map.model).to_bytes();
    write_files(&map, &info, &index, out_dir, progress)?;
    Ok(RegisterReport {
        maps: parts.iter().zip(&poses).map(|(part, pose)| map_report(part, pose)).collect(),
        pairs: pairs.iter().zip(used).map(|(pair, &used)| pair_report(parts, pair, used)).collect(),
        num_shared_points: num_shared,
        num_points: map.model.points.len(),
        reprojection_px: map.model.mean_reprojection_error_px(),
        quality: map.quality,
    })
}
