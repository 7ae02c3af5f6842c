//! What two zones in one frame say about each other.

use nalgebra::Similarity3;

use crate::zone::Zone;

/// Pieces of each zone that are asked for a proof.
const ASKED: usize = 2500;
/// Pieces that tell whether a transform is worth a closer look.
const GLANCED: usize = 500;
/// A piece agrees with one of the other zone that is as near as this, cells, ...
const NEAR: f64 = 1.5;
/// ... and whose normal is turned by less than 45°.
const MIN_NORMAL_COSINE: f64 = std::f64::consts::FRAC_1_SQRT_2;
/// A piece speaks against the transform if the other zone saw a surface this far behind it, cells.
const BEHIND: f64 = 4.0;

/// How two zones agree under a transform.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Overlap {
    /// Share of the surface of one zone that lies on the other, 0..1, of the zone for which it is
    /// larger.
    pub fraction: f64,
    /// Root mean square distance across the surface where they agree.
    pub rms: f64,
    /// Of all pieces on which the other zone has an opinion, the share that it saw through.
    pub contradiction: f64,
}

impl Overlap {
    /// Of `source`, moved by `target_from_source`, with `target`.
    pub fn new(source: &Zone, target: &Zone, target_from_source: &Similarity3<f64>) -> Self {
        Self::of_some(source, target, target_from_source, 0.0, ASKED)
    }

    /// The same from few pieces, with a transform that is off by up to `slack`, units of the
    /// target.
    pub(crate) fn glance(
        source: &Zone,
        target: &Zone,
        target_from_source: &Similarity3<f64>,
        slack: f64,
    ) -> Self {
        Self::of_some(source, target, target_from_source, slack, GLANCED)
    }

    fn of_some(
        source: &Zone,
        target: &Zone,
        target_from_source: &Similarity3<f64>,
        slack: f64,
        num: usize,
    ) -> Self {
        let scale = target_from_source.scaling();
        let there = ask(source, target, target_from_source, slack, num);
        let back = ask(target, source, &target_from_source.inverse(), slack / scale, num);
        let share = |count: &Count| count.agree as f64 / count.asked.max(1) as f64;
        let agree = there.agree + back.agree;
        let contradict = there.contradict + back.contradict;
        // Squared distances of the way back are in units of the source.
        let squared = there.squared + back.squared * scale * scale;
        Self {
            fraction: share(&there).max(share(&back)),
            rms: (squared / agree.max(1) as f64).sqrt(),
            contradiction: contradict as f64 / (agree + contradict).max(1) as f64,
        }
    }
}

/// Least share of one of the zones that proves an overlap.
const MIN_FRACTION: f64 = 0.1;
/// Most contradiction of a proved overlap. True ones of noisy scans have up to 0.02; wrong ones
/// that agree in floor, ceiling and two walls have more than 0.2.
const MAX_CONTRADICTION: f64 = 0.06;

impl Overlap {
    /// Whether it is no accident.
    pub fn is_proof(&self) -> bool {
        self.fraction >= MIN_FRACTION && !self.is_contradicted()
    }

    /// Whether the zones cannot lie like this.
    pub fn is_contradicted(&self) -> bool {
        self.contradiction > MAX_CONTRADICTION
    }
}

struct Count {
    asked: usize,
    agree: usize,
    contradict: usize,
    /// Sum of the squared distances of those that agree.
    squared: f64,
}

/// What `num` pieces of a zone meet in the other one.
fn ask(
    asked: &Zone,
    other: &Zone,
    other_from_asked: &Similarity3<f64>,
    slack: f64,
    num: usize,
) -> Count {
    let mut count = Count { asked: 0, agree: 0, contradict: 0, squared: 0.0 };
    let surfels = other.surfels();
    let (near, behind) = (NEAR * surfels.cell() + slack, BEHIND * surfels.cell() + slack);
    let pieces = asked.surfels().pieces();
    for piece in pieces.iter().step_by(pieces.len().div_ceil(num).max(1)) {
        count.asked += 1;
        let at = other_from_asked * piece.position;
        let normal = other_from_asked.isometry.rotation * piece.normal;
        let found = surfels.tree().nearest_within(&at, near);
        let found = found.map(|n| &surfels.pieces()[n.index as usize]);
        match found {
            Some(found) if found.normal.dot(&normal) > MIN_NORMAL_COSINE => {
                count.agree += 1;
                count.squared += found.normal.dot(&(at - found.position)).powi(2);
            }
            // Near an edge the normals differ and the surfaces still agree.
            Some(_) => {}
            None if other.seen().is_seen_through(&at, behind) => count.contradict += 1,
            None => {}
        }
    }
    count
}
