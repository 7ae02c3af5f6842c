//! What any two maps say of each other.

use volery_registration::{Link, SharedAlignment, align_shared_points};
use volery_scene::{Progress, Stage};

use super::part::Part;
use crate::{PipelineError, error::code};

/// Two maps by their places in the list, the later onto the earlier.
pub(super) struct Pair {
    pub(super) source: usize,
    pub(super) target: usize,
    pub(super) found: Result<SharedAlignment, PipelineError>,
}

impl Pair {
    /// For the pose graph.
    pub(super) fn link(&self) -> Option<Link> {
        let found = self.found.as_ref().ok()?;
        Some(Link::new(self.source, self.target, found.target_from_source, &found.constraint))
    }
}

/// Every pair of maps.
pub(super) fn align_pairs(
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

/// No map joins the first.
pub(super) fn no_overlap(parts: &[Part], pairs: &[Pair]) -> PipelineError {
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
