//! Which keypoints stay when there are too many.

use super::Candidate;

/// Cells of the grid along the longer side of the image.
const CELLS_PER_SIDE: usize = 16;

/// How much more of the limit an octave gets than the next coarser one: fine keypoints are the
/// exact ones, coarse ones survive changes of scale.
const SHARE_RATIO: f64 = 3.0;

/// Indices of at most `limit` candidates, most wanted first.
///
/// Every octave is a stratum; a stratum's share of the limit is [`SHARE_RATIO`] times that of the
/// next coarser one, and what it cannot fill goes to the others. Within a stratum
/// the strongest of each cell of a grid come first, then the second strongest, and so on.
pub(super) fn select(candidates: &[Candidate], size: [f32; 2], limit: usize) -> Vec<usize> {
    let num_octaves = candidates.iter().map(|c| c.octave + 1).max().unwrap_or(0);
    let mut strata = vec![Vec::new(); num_octaves];
    for (index, candidate) in candidates.iter().enumerate() {
        strata[candidate.octave].push(index);
    }
    let quotas = fill(&strata.iter().map(Vec::len).collect::<Vec<_>>(), limit);
    let cell_side = (size[0].max(size[1]) / CELLS_PER_SIDE as f32).max(1.0);
    // (part of the quota used before it, index): thinning goes through all strata alike.
    let mut wanted = Vec::new();
    for (stratum, &quota) in strata.iter().zip(&quotas) {
        let order = spread(stratum, candidates, cell_side);
        let is_thinned = quota < order.len();
        wanted.extend(order.into_iter().take(quota).enumerate().map(|(position, index)| {
            (if is_thinned { position as f32 / quota as f32 } else { 0.0 }, index)
        }));
    }
    wanted.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    wanted.into_iter().map(|(_, index)| index).collect()
}

/// Shares of `limit` for strata of `sizes`, finest first; none exceeds what its stratum holds.
fn fill(sizes: &[usize], limit: usize) -> Vec<usize> {
    let weight = |i: usize| SHARE_RATIO.powi(-(i as i32));
    // Those that fill up first come first; the rest share what they leave.
    let mut order: Vec<usize> = (0..sizes.len()).collect();
    let fullness = |i: usize| sizes[i] as f64 / weight(i);
    order.sort_by(|&a, &b| fullness(a).total_cmp(&fullness(b)).then(a.cmp(&b)));
    let mut quotas = vec![0; sizes.len()];
    let mut rest = limit;
    for (position, &i) in order.iter().enumerate() {
        let open: f64 = order[position..].iter().map(|&j| weight(j)).sum();
        quotas[i] = sizes[i].min((rest as f64 * weight(i) / open).round() as usize).min(rest);
        rest -= quotas[i];
    }
    quotas
}

/// The stratum ordered by rank within its grid cell, then by strength.
fn spread(stratum: &[usize], candidates: &[Candidate], cell_side: f32) -> Vec<usize> {
    let cell_of = |index: usize| {
        let c = &candidates[index];
        ((c.y / cell_side) as u32, (c.x / cell_side) as u32)
    };
    let strength = |index: usize| candidates[index].response.abs();
    let mut order = stratum.to_vec();
    order.sort_by(|&a, &b| {
        cell_of(a).cmp(&cell_of(b)).then(strength(b).total_cmp(&strength(a))).then(a.cmp(&b))
    });
    let mut ranked = Vec::with_capacity(order.len());
    for cell in order.chunk_by(|&a, &b| cell_of(a) == cell_of(b)) {
        ranked.extend(cell.iter().copied().enumerate());
    }
    ranked.sort_by(|&(rank_a, a), &(rank_b, b)| {
        rank_a.cmp(&rank_b).then(strength(b).total_cmp(&strength(a))).then(a.cmp(&b))
    });
    ranked.into_iter().map(|(_, index)| index).collect()
}
