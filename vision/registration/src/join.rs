//! Many zones to as few frames as they prove.

use nalgebra::Similarity3;
use volery_scene::{Progress, Stage};

use crate::RegistrationError;
use crate::global::{Registration, register_anywhere, register_from};
use crate::nearby::NearbyOptions;
use crate::overlap::Overlap;
use crate::pose_graph::{Link, solve_pose_graph};
use crate::zone::Zone;

/// A link of less weight is contradicted by the loops through it.
const MIN_WEIGHT: f64 = 0.5;
/// Errors of poses before loops are closed, cells.
const SLACK: f64 = 4.0;
/// Zones whose poses agree in less are not worth a closer look.
const MIN_EXPECTED_OVERLAP: f64 = 0.05;

/// Where a zone lies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// Its frame is that of this zone, the first of those that are tied to it.
    pub reference: usize,
    /// Pose in that frame.
    pub frame_from_zone: Similarity3<f64>,
}

/// What was found out about two zones.
#[derive(Debug, Clone, PartialEq)]
pub struct PairReport {
    /// Which zone was moved.
    pub source: usize,
    /// Onto which.
    pub target: usize,
    /// The transform, or why there is none.
    pub result: Result<Registration, RegistrationError>,
    /// Whether the final poses rest on it.
    pub is_used: bool,
}

/// Zones in common frames.
#[derive(Debug, Clone, PartialEq)]
pub struct JoinedZones {
    /// Per zone.
    pub placements: Vec<Placement>,
    /// Every pair that was looked at.
    pub pairs: Vec<PairReport>,
}

/// A first guess of the transform between two zones, e.g. from shared points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Guess {
    /// Which zone moves.
    pub source: usize,
    /// Which stays.
    pub target: usize,
    /// The guess.
    pub target_from_source: Similarity3<f64>,
}

/// Joins zones (P52): first by the guesses, then from geometry alone where zones are not tied yet,
/// then every pair that the poses so found let overlap; the poses are those that agree best with
/// all of it. No zones are joined that contradict each other.
///
/// # Errors
///
/// [`RegistrationError::Cancelled`].
pub fn join_zones(
    zones: &[Zone],
    guesses: &[Guess],
    options: &NearbyOptions,
    progress: &dyn Progress,
) -> Result<JoinedZones, RegistrationError> {
    let num_pairs = zones.len() * zones.len().saturating_sub(1) / 2;
    let mut pairs: Vec<PairReport> = Vec::new();
    for guess in guesses.iter().filter(|g| g.source.max(g.target) < zones.len()) {
        progress.check()?;
        let Guess { source, target, target_from_source } = *guess;
        let result = register_from(&zones[source], &zones[target], &target_from_source, options);
        pairs.push(PairReport { source, target, is_used: result.is_ok(), result });
    }
    let mut groups = Groups::new(zones.len(), &pairs);
    for (done, (target, source)) in all_pairs(zones.len()).enumerate() {
        progress.check()?;
        progress.report(Stage::Align, done, num_pairs);
        if groups.of(source) == groups.of(target) {
            continue;
        }
        let result = register_anywhere(&zones[source], &zones[target], options);
        pairs.push(PairReport { source, target, is_used: result.is_ok(), result });
        groups = Groups::new(zones.len(), &pairs);
    }
    close_loops(zones, &mut pairs, options, progress)?;
    let placements = settle(zones, &mut pairs);
    progress.report(Stage::Align, num_pairs, num_pairs);
    Ok(JoinedZones { placements, pairs })
}

fn all_pairs(n: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..n).flat_map(move |target| (target + 1..n).map(move |source| (target, source)))
}

/// Registers the pairs that the poses found so far let overlap.
fn close_loops(
    zones: &[Zone],
    pairs: &mut Vec<PairReport>,
    options: &NearbyOptions,
    progress: &dyn Progress,
) -> Result<(), RegistrationError> {
    let placements = place(zones.len(), pairs);
    for (target, source) in all_pairs(zones.len()) {
        progress.check()?;
        let (a, b) = (&placements[target], &placements[source]);
        let is_linked = |pair: &&PairReport| {
            pair.is_used
                && [(source, target), (target, source)].contains(&(pair.source, pair.target))
        };
        if a.reference != b.reference || pairs.iter().any(|pair| is_linked(&pair)) {
            continue;
        }
        let start = a.frame_from_zone.inverse() * b.frame_from_zone;
        let slack = SLACK * zones[target].surfels().cell();
        let expected = Overlap::glance(&zones[source], &zones[target], &start, slack);
        if expected.fraction < MIN_EXPECTED_OVERLAP {
            continue;
        }
        let options = NearbyOptions { reach: options.reach.min(2.0 * slack), ..*options };
        let result = register_from(&zones[source], &zones[target], &start, &options);
        pairs.retain(|pair| (pair.source, pair.target) != (source, target));
        pairs.push(PairReport { source, target, is_used: result.is_ok(), result });
    }
    Ok(())
}

/// Final poses. While zones of one frame contradict each other, the link that proves least goes.
fn settle(zones: &[Zone], pairs: &mut [PairReport]) -> Vec<Placement> {
    loop {
        let placements = place(zones.len(), pairs);
        let contradicted = all_pairs(zones.len()).find(|&(target, source)| {
            let (a, b) = (&placements[target], &placements[source]);
            let slack = SLACK * zones[target].surfels().cell();
            a.reference == b.reference && {
                let motion = a.frame_from_zone.inverse() * b.frame_from_zone;
                let overlap = Overlap::glance(&zones[source], &zones[target], &motion, slack);
                // Little overlap has little to say.
                overlap.is_contradicted() && overlap.fraction > MIN_EXPECTED_OVERLAP
            }
        });
        let Some((target, _)) = contradicted else { return placements };
        let reference = placements[target].reference;
        let fraction = |pair: &PairReport| pair.result.as_ref().map_or(0.0, |r| r.overlap.fraction);
        let weakest = pairs
            .iter_mut()
            .filter(|pair| pair.is_used && placements[pair.source].reference == reference)
            .min_by(|a, b| fraction(a).total_cmp(&fraction(b)));
        let Some(weakest) = weakest else { return placements };
        weakest.is_used = false;
    }
}

/// Poses from the links in use; links that loops contradict are taken out of use.
fn place(num_zones: usize, pairs: &mut [PairReport]) -> Vec<Placement> {
    loop {
        let groups = Groups::new(num_zones, pairs);
        let (used, links): (Vec<usize>, Vec<Link>) = pairs
            .iter()
            .enumerate()
            .filter(|(_, pair)| pair.is_used)
            .filter_map(|(index, pair)| {
                let found = pair.result.as_ref().ok()?;
                let motion = found.target_from_source;
                Some((index, Link::new(pair.source, pair.target, motion, &found.constraint)))
            })
            .unzip();
        let mut placements = Vec::new();
        let mut worst: Option<(f64, usize)> = None;
        for reference in (0..num_zones).filter(|&zone| groups.of(zone) == zone) {
            let graph = solve_pose_graph(num_zones, &links, reference);
            for (zone, pose) in graph.frame_from_zone.iter().enumerate() {
                if let Some(frame_from_zone) = *pose {
                    placements.push((zone, Placement { reference, frame_from_zone }));
                }
            }
            for (&index, &weight) in used.iter().zip(&graph.weights) {
                let is_here = groups.of(pairs[index].source) == reference;
                if is_here && weight < worst.map_or(MIN_WEIGHT, |w| w.0) {
                    worst = Some((weight, index));
                }
            }
        }
        match worst {
            Some((_, index)) => pairs[index].is_used = false,
            None => {
                placements.sort_by_key(|placement| placement.0);
                return placements.into_iter().map(|placement| placement.1).collect();
            }
        }
    }
}

/// Which zones are tied to each other.
struct Groups {
    first: Vec<usize>,
}

impl Groups {
    fn new(num_zones: usize, pairs: &[PairReport]) -> Self {
        let mut first: Vec<usize> = (0..num_zones).collect();
        for pair in pairs.iter().filter(|pair| pair.is_used) {
            let (a, b) = (first[pair.source], first[pair.target]);
            let (keep, drop) = (a.min(b), a.max(b));
            first.iter_mut().filter(|zone| **zone == drop).for_each(|zone| *zone = keep);
        }
        Self { first }
    }

    fn of(&self, zone: usize) -> usize {
        self.first[zone]
    }
}

#[cfg(test)]
pub(crate) mod tests;
