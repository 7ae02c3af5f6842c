//! Map folders, and photos, to one map folder.

mod contents;
mod extend;
mod newcomers;
mod page;
mod pairs;
mod part;
mod report;
mod surfaces;
mod whole;

use std::path::{Path, PathBuf};

use nalgebra::Similarity3;
use volery_api::Registration;
use volery_registration::{Link, solve_pose_graph};
use volery_scene::Progress;

use crate::{
    JobSpec, PipelineError, StageProgress, atomic::write_atomic, error::code, map_folder::file,
};
pub use extend::extend_map;
use pairs::{Pair, align_pairs, no_overlap};
use part::Part;
pub use report::{FoundBy, PhotoReport, RegisterReport};
use surfaces::surface_of_whole;
use whole::Whole;

/// A link that loops through it contradict more is not used.
const MIN_WEIGHT: f64 = 0.5;

/// A map to be joined with others.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MapSource {
    /// For the report, and for photos whose name is taken.
    pub name: String,
    /// Its folder.
    pub folder: PathBuf,
    /// Files of its photos, for the surface of what comes of it; others do no harm.
    pub photos: Vec<PathBuf>,
}

/// Joins maps that share a part, in the frame of the first, and writes a map folder.
///
/// Points that look the same give the transform between two maps; all such transforms together
/// give the poses of the maps; then every pose and every point is refined together. Maps that share
/// nothing with the others are left out and named. Where points are too few, the surfaces are laid
/// on each other as they are, if `how` lets them. Dense cloud and mesh are made anew from the photos
/// as far as the job says, with finished units in `work_dir`.
///
/// * `spec`: preset, stages and seed count.
///
/// # Errors
///
/// [`PipelineError`] with the code `no_overlap` where no map joins the first (of two maps, what
/// kept them apart), and for folders that cannot be read or written.
pub fn register_maps(
    sources: &[MapSource],
    how: &Registration,
    spec: &JobSpec,
    work_dir: &Path,
    out_dir: &Path,
    progress: &dyn StageProgress,
) -> Result<RegisterReport, PipelineError> {
    if sources.len() < 2 {
        let detail = format!("{} maps were given", sources.len());
        return Err(PipelineError::new(code::BAD_INPUT, detail, "name two or more maps"));
    }
    let parts: Vec<Part> = sources
        .iter()
        .map(|source| Part::open(&source.name, &source.folder))
        .collect::<Result<_, _>>()?;
    let mut found = Frame::of(&parts, how, spec.seed, progress)?;
    if found.poses.iter().flatten().count() < 2 {
        return Err(no_overlap(&parts, &found.pairs));
    }
    progress.check()?;
    let mut whole = Whole::of(&parts, &found.pairs, &found.used, &mut found.poses, spec.seed);
    whole.settle(progress)?;
    let photos: Vec<PathBuf> = sources.iter().flat_map(|s| &s.photos).cloned().collect();
    let report = found.report(&parts, &whole, Vec::new());
    finish(spec, report, whole, &photos, [work_dir, out_dir], progress)
}

/// Where maps lie in the frame of the first, and why.
struct Frame {
    pairs: Vec<Pair>,
    /// Of the pairs: whether the poses rest on it.
    used: Vec<bool>,
    /// Of the parts.
    poses: Vec<Option<Similarity3<f64>>>,
}

impl Frame {
    fn of(
        parts: &[Part],
        how: &Registration,
        seed: u64,
        progress: &dyn Progress,
    ) -> Result<Self, PipelineError> {
        let pairs = align_pairs(parts, how, seed, progress)?;
        let links: Vec<Link> = pairs.iter().filter_map(Pair::link).collect();
        let graph = solve_pose_graph(parts.len(), &links, 0);
        let mut weights = graph.weights.iter();
        let used = pairs
            .iter()
            .map(|pair| pair.found.is_ok() && weights.next().is_some_and(|w| *w >= MIN_WEIGHT))
            .collect();
        Ok(Self { pairs, used, poses: graph.frame_from_zone })
    }

    /// Without what follows from the merged model.
    fn report(&self, parts: &[Part], whole: &Whole, photos: Vec<PhotoReport>) -> RegisterReport {
        let maps = parts.iter().zip(&self.poses).map(|(part, p)| report::map_report(part, p));
        let pairs = self.pairs.iter().zip(&self.used);
        RegisterReport {
            maps: maps.collect(),
            pairs: pairs.map(|(pair, &used)| report::pair_report(parts, pair, used)).collect(),
            photos,
            num_shared_points: whole.num_shared,
            num_points: whole.model.points.len(),
            reprojection_px: whole.model.mean_reprojection_error_px(),
            quality: whole.info.quality.clone(),
            num_photos_gone: 0,
            dense: None,
            mesh: None,
        }
    }
}

/// Writes the map, then its surface, with the reports after each.
fn finish(
    spec: &JobSpec,
    mut report: RegisterReport,
    whole: Whole,
    photos: &[PathBuf],
    [work_dir, out_dir]: [&Path; 2],
    progress: &dyn StageProgress,
) -> Result<RegisterReport, PipelineError> {
    let (map, info) = whole.write(out_dir, progress)?;
    // What follows may end the process; the map and its report are there then.
    write_reports(&report, out_dir)?;
    let (surface, num_photos_gone) =
        surface_of_whole(spec, &map, &info, photos, [work_dir, out_dir], progress)?;
    report = RegisterReport { num_photos_gone, dense: surface.dense, mesh: surface.mesh, ..report };
    write_reports(&report, out_dir)?;
    Ok(report)
}

fn write_reports(report: &RegisterReport, out_dir: &Path) -> Result<(), PipelineError> {
    let json = serde_json::to_vec_pretty(report)
        .map_err(|e| PipelineError::plain(code::IO, e.to_string()))?;
    write_atomic(&out_dir.join(file::REPORT), &json)?;
    write_atomic(&out_dir.join(file::REPORT_HTML), page::page(report).as_bytes())
}
