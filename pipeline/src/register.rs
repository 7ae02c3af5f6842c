//! Map folders, and photos, to one map folder.

mod contents;
mod extend;
mod newcomers;
mod page;
mod pairs;
mod part;
mod report;
mod whole;

use std::path::{Path, PathBuf};

use nalgebra::Similarity3;
use volery_registration::{Link, solve_pose_graph};
use volery_scene::Progress;

use crate::{PipelineError, cache::write_atomic, error::code, map_folder::file};
pub use extend::extend_map;
use pairs::{Pair, align_pairs, no_overlap};
use part::Part;
pub use report::{PhotoReport, RegisterReport};
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
    let mut found = Frame::of(&parts, seed, progress)?;
    if found.poses.iter().flatten().count() < 2 {
        return Err(no_overlap(&parts, &found.pairs));
    }
    progress.check()?;
    let mut whole = Whole::of(&parts, &found.pairs, &found.used, &mut found.poses, seed);
    whole.settle(progress)?;
    finish(&parts, &found, whole, Vec::new(), out_dir, progress)
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
    fn of(parts: &[Part], seed: u64, progress: &dyn Progress) -> Result<Self, PipelineError> {
        let pairs = align_pairs(parts, seed, progress)?;
        let links: Vec<Link> = pairs.iter().filter_map(Pair::link).collect();
        let graph = solve_pose_graph(parts.len(), &links, 0);
        let mut weights = graph.weights.iter();
        let used = pairs
            .iter()
            .map(|pair| pair.found.is_ok() && weights.next().is_some_and(|w| *w >= MIN_WEIGHT))
            .collect();
        Ok(Self { pairs, used, poses: graph.frame_from_zone })
    }
}

/// Writes the map and its reports.
fn finish(
    parts: &[Part],
    found: &Frame,
    whole: Whole,
    photos: Vec<PhotoReport>,
    out_dir: &Path,
    progress: &dyn Progress,
) -> Result<RegisterReport, PipelineError> {
    let num_shared_points = whole.num_shared;
    let (map, _) = whole.write(out_dir, progress)?;
    let report = RegisterReport {
        maps: parts.iter().zip(&found.poses).map(|(part, p)| report::map_report(part, p)).collect(),
        pairs: found
            .pairs
            .iter()
            .zip(&found.used)
            .map(|(pair, &used)| report::pair_report(parts, pair, used))
            .collect(),
        photos,
        num_shared_points,
        num_points: map.model.points.len(),
        reprojection_px: map.model.mean_reprojection_error_px(),
        quality: map.quality,
    };
    let json = serde_json::to_vec_pretty(&report)
        .map_err(|e| PipelineError::plain(code::IO, e.to_string()))?;
    write_atomic(&out_dir.join(file::REPORT), &json)?;
    write_atomic(&out_dir.join(file::REPORT_HTML), page::page(&report).as_bytes())?;
    Ok(report)
}
