//! What any two maps say of each other.

use nalgebra::Similarity3;
use volery_api::{Registration, RegistrationMethod};
use volery_registration::{
    Constraint, CrossMatches, Link, Motion, Overlap, RegistrationError, agreeing_points,
    align_shared_points,
};
use volery_scene::{PointId, Progress, Stage};

use super::{part::Part, surfaces::align_surfaces};
use crate::{PipelineError, error::code};

/// Two maps by their places in the list, the later onto the earlier.
pub(super) struct Pair {
    pub(super) source: usize,
    pub(super) target: usize,
    pub(super) found: Result<Found, PipelineError>,
}

/// A transform between two maps and what speaks for it.
pub(super) struct Found {
    pub(super) target_from_source: Similarity3<f64>,
    pub(super) constraint: Constraint,
    /// Points that both maps know and that it brings together.
    pub(super) points: Vec<(PointId, PointId)>,
    /// Points that matches pair.
    pub(super) num_pairs: usize,
    /// Root mean square distance of what it brings together, units of the target.
    pub(super) rms: f64,
    /// If it was found by the surfaces: how they agree, and after how many steps.
    pub(super) surfaces: Option<(Overlap, usize)>,
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
    how: &Registration,
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
        let found = align(&parts[source], &parts[target], how, seed);
        pairs.push(Pair { source, target, found });
        progress.report(Stage::Matching, pairs.len(), all.len());
    }
    Ok(pairs)
}

fn align(
    source: &Part,
    target: &Part,
    how: &Registration,
    seed: u64,
) -> Result<Found, PipelineError> {
    let matches = source.matches_with(target);
    let by_surfaces =
        || align_surfaces(source, target).map(|found| with_points(found, source, target, &matches));
    if how.method == RegistrationMethod::Surfaces {
        return by_surfaces();
    }
    let motion = if how.with_scale { Motion::Similarity } else { Motion::Rigid };
    let refused =
        match align_shared_points(&source.map.model, &target.map.model, &matches, motion, seed) {
            Ok(found) => {
                return Ok(Found {
                    target_from_source: found.target_from_source,
                    constraint: found.constraint,
                    points: found.points,
                    num_pairs: found.num_pairs,
                    rms: found.rms,
                    surfaces: None,
                });
            }
            Err(error) => told(&error),
        };
    let has_surfaces = [source, target].iter().all(|part| part.has_surface());
    if how.method == RegistrationMethod::Points || !has_surfaces {
        return Err(refused);
    }
    by_surfaces().map_err(|error| {
        let detail = format!("by points: {refused}; by surfaces: {error}");
        PipelineError { detail, ..error }
    })
}

/// The points that both know, even if they are too few to tell the transform.
fn with_points(found: Found, source: &Part, target: &Part, matches: &[CrossMatches]) -> Found {
    let (from, onto) = (&source.map.model, &target.map.model);
    let points = agreeing_points(from, onto, matches, &found.target_from_source);
    let num_pairs = volery_registration::shared_points(from, onto, matches).len();
    Found { points, num_pairs, ..found }
}

/// As the pipeline says it.
pub(super) fn told(error: &RegistrationError) -> PipelineError {
    PipelineError::plain(error.code(), error.to_string())
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
    // One pair has one reason; many have in common that they do not overlap.
    let code = match pairs {
        [Pair { found: Err(error), .. }] => &error.code,
        _ => code::NO_OVERLAP,
    };
    PipelineError::new(
        code,
        told.join("; "),
        "take a few photos that show what both maps show, and extend one of the maps with them",
    )
}
