//! Registration of two zones, with proof.

use nalgebra::{Point3, Similarity3};

use crate::RegistrationError;
use crate::consistency::{Correspondence, consistent_motions};
use crate::constraint::{Constraint, Contact};
use crate::icp::Icp;
use crate::landmarks::match_landmarks;
use crate::nearby::{NearbyOptions, register_nearby};
use crate::overlap::Overlap;
use crate::surfels::Surfels;
use crate::zone::Zone;

/// Errors of the places of landmarks, cells: they lie on a grid of 2.4.
const SLACK: f64 = 3.5;
/// A first alignment by landmarks is off by up to this, in slacks.
const REACH: f64 = 2.0;
/// First alignments that are followed up.
const MAX_FOLLOWED: usize = 6;
/// A first alignment blurs what agrees: half the overlap and twice the contradiction are let pass.
const FIRST_FRACTION: f64 = 0.05;
const FIRST_CONTRADICTION: f64 = 0.15;
/// A second transform with this share of the overlap of the best one is as good, ...
const RIVAL: f64 = 0.85;
/// ... unless the surfaces are farther apart by this factor: the search got stuck beside the best.
const STUCK: f64 = 1.3;
/// Transforms that differ by more are two: cells, radians.
const DIFFERENT: (f64, f64) = (4.0, 0.05);

/// A transform between two zones that is proved.
#[derive(Debug, Clone, PartialEq)]
pub struct Registration {
    /// The transform.
    pub target_from_source: Similarity3<f64>,
    /// How the zones agree under it.
    pub overlap: Overlap,
    /// How well it is known.
    pub constraint: Constraint,
    /// Rounds of the last search.
    pub num_iterations: usize,
}

/// Moves `source` onto `target` from a start that is right within `options.reach`, and proves it.
///
/// # Errors
///
/// As [`register_nearby`], and [`RegistrationError::NoOverlap`] where the zones agree too little
/// or one saw through what the other holds to be solid.
pub fn register_from(
    source: &Zone,
    target: &Zone,
    start: &Similarity3<f64>,
    options: &NearbyOptions,
) -> Result<Registration, RegistrationError> {
    let icp = register_nearby(source.surfels(), target.surfels(), start, options)?;
    let overlap = Overlap::new(source, target, &icp.target_from_source);
    if !overlap.is_proof() {
        return Err(no_overlap(&overlap));
    }
    let Icp { target_from_source, costs, constraint, .. } = icp;
    Ok(Registration { target_from_source, overlap, constraint, num_iterations: costs.len() })
}

/// Finds where `source` lies on `target` from their geometry alone; both have one scale.
///
/// Unusual places are matched by their surroundings; motions on which many matches agree are tried
/// in the order of what the zones say about them, and the best is refined and proved.
///
/// # Errors
///
/// [`RegistrationError::Underconstrained`] for zones that would slide or turn on themselves (a bare
/// plane, a corridor) and for such overlaps, [`RegistrationError::NoOverlap`] where no motion is
/// proved, [`RegistrationError::Ambiguous`] where two are.
pub fn register_anywhere(
    source: &Zone,
    target: &Zone,
    options: &NearbyOptions,
) -> Result<Registration, RegistrationError> {
    for zone in [source, target] {
        let free = own_constraint(zone.surfels()).free;
        if !free.is_empty() {
            return Err(RegistrationError::Underconstrained { directions: free });
        }
    }
    let starts = first_alignments(source, target);
    let mut refusal = no_overlap(&starts.first().map_or(NOTHING, |start| start.1));
    let mut proved: Vec<Registration> = Vec::new();
    let reach = REACH * slack(source, target);
    let options = NearbyOptions { reach, ..*options };
    let promising = starts.iter().filter(|(_, overlap)| {
        overlap.fraction >= FIRST_FRACTION && overlap.contradiction <= FIRST_CONTRADICTION
    });
    for (start, _) in promising.take(MAX_FOLLOWED) {
        match register_from(source, target, start, &options) {
            Ok(found) if proved.iter().any(|other| !differ(other, &found, source)) => {}
            Ok(found) => proved.push(found),
            Err(error @ RegistrationError::Underconstrained { .. }) => refusal = error,
            Err(_) => {}
        }
    }
    let fit = |found: &Registration| found.overlap.fraction / found.overlap.rms;
    proved.sort_by(|a, b| fit(b).total_cmp(&fit(a)));
    let mut proved = proved.into_iter();
    let best = proved.next().ok_or(refusal)?;
    match proved.next() {
        Some(second) if is_rival(&second.overlap, &best.overlap) => {
            let (distance, angle) = difference(&best, &second, &source.surfels().center());
            Err(RegistrationError::Ambiguous { distance, angle_deg: angle.to_degrees() })
        }
        _ => Ok(best),
    }
}

fn is_rival(second: &Overlap, best: &Overlap) -> bool {
    second.fraction > RIVAL * best.fraction && second.rms < STUCK * best.rms
}

const NOTHING: Overlap = Overlap { fraction: 0.0, rms: 0.0, contradiction: 0.0 };

fn no_overlap(overlap: &Overlap) -> RegistrationError {
    let Overlap { fraction, contradiction, .. } = *overlap;
    RegistrationError::NoOverlap { overlap: fraction, contradiction }
}

/// What a zone would determine that lies on itself.
fn own_constraint(surfels: &Surfels) -> Constraint {
    let contacts: Vec<Contact> = surfels
        .pieces()
        .iter()
        .step_by(8)
        .map(|piece| Contact { position: piece.position, normal: piece.normal, residual: 0.0 })
        .collect();
    Constraint::new(&contacts, false)
}

fn slack(source: &Zone, target: &Zone) -> f64 {
    SLACK * source.surfels().cell().max(target.surfels().cell())
}

/// Motions from matched landmarks and what the zones say about them, best first.
fn first_alignments(source: &Zone, target: &Zone) -> Vec<(Similarity3<f64>, Overlap)> {
    let matched: Vec<Correspondence> = match_landmarks(source.landmarks(), target.landmarks())
        .into_iter()
        .map(|(s, t)| {
            (source.landmarks().places[s as usize], target.landmarks().places[t as usize])
        })
        .collect();
    let slack = slack(source, target);
    let mut starts: Vec<(Similarity3<f64>, Overlap)> = consistent_motions(&matched, slack)
        .into_iter()
        .map(|hypothesis| {
            let start = Similarity3::from_isometry(hypothesis.target_from_source, 1.0);
            (start, Overlap::glance(source, target, &start, slack))
        })
        .collect();
    let merit =
        |overlap: &Overlap| overlap.fraction * (1.0 - overlap.contradiction / FIRST_CONTRADICTION);
    starts.sort_by(|a, b| merit(&b.1).total_cmp(&merit(&a.1)));
    starts
}

fn difference(a: &Registration, b: &Registration, at: &Point3<f64>) -> (f64, f64) {
    let (a, b) = (&a.target_from_source, &b.target_from_source);
    ((a * at - b * at).norm(), a.isometry.rotation.angle_to(&b.isometry.rotation))
}

fn differ(a: &Registration, b: &Registration, source: &Zone) -> bool {
    let (distance, angle) = difference(a, b, &source.surfels().center());
    distance > DIFFERENT.0 * source.surfels().cell() || angle > DIFFERENT.1
}

#[cfg(test)]
mod tests;
