//! Between the vertices of a level and those of the next finer one.
//!
//! A coarse tent is the sum of 27 fine ones with the weights 1, 1/2, 1/4, 1/8: `P` interpolates,
//! `Pᵀ` sums.

use rayon::prelude::*;

use super::rows::{Rows, Run};

/// The parts of `values` that belong to the planes of a set.
pub(super) fn split_planes<'a, T>(set: &Rows, values: &'a mut [T]) -> Vec<&'a mut [T]> {
    let mut rest = values;
    set.planes()
        .windows(2)
        .map(|ends| {
            let (plane, after) =
                std::mem::take(&mut rest).split_at_mut((ends[1] - ends[0]) as usize);
            rest = after;
            plane
        })
        .collect()
}

/// Lattice coordinates of the one or two coarse rows around a fine one, with their weight.
fn coarse_of(fine: u32) -> (u32, u32, f32) {
    if fine.is_multiple_of(2) { (fine / 2, fine / 2, 1.0) } else { (fine / 2, fine / 2 + 1, 0.5) }
}

/// Index of the coarse vertex below the begin of a fine run, in the coarse row (y, z).
///
/// Fine runs begin and end at corners of coarse cells that exist.
fn coarse_base(coarse: &Rows, run: Run, y: u32, z: u32) -> usize {
    coarse.find([run.begin / 2, y, z]).expect("families are whole") as usize
}

/// `P`: values at the fine vertices.
pub(super) fn prolong(coarse: &Rows, fine: &Rows, values: &[f32]) -> Vec<f32> {
    let mut result = vec![0.0; fine.len()];
    split_planes(fine, &mut result).into_par_iter().enumerate().for_each(|(z, plane)| {
        let z = z as u32;
        let start = fine.planes()[z as usize];
        let (z0, z1, weight_z) = coarse_of(z);
        for (y, run) in fine.iter_plane(z) {
            let (y0, y1, weight_y) = coarse_of(y);
            let target =
                &mut plane[(run.base - start) as usize..][..(run.end - run.begin) as usize];
            for z in z0..=z1 {
                for y in y0..=y1 {
                    let row = &values[coarse_base(coarse, run, y, z)..];
                    interpolate(weight_y * weight_z, row, target);
                }
            }
        }
    });
    result
}

/// Adds a coarse row to a fine one that begins and ends at the same vertices.
fn interpolate(weight: f32, coarse: &[f32], fine: &mut [f32]) {
    let half = 0.5 * weight;
    for (pair, c) in fine.chunks_exact_mut(2).zip(coarse.windows(2)) {
        pair[0] += weight * c[0];
        pair[1] += half * c[0] + half * c[1];
    }
    fine[fine.len() - 1] += weight * coarse[fine.len() / 2];
}

/// Adds `scale Pᵀ values` to `sums` at the coarse vertices.
pub(super) fn restrict_onto(
    coarse: &Rows,
    fine: &Rows,
    values: &[f32],
    scale: f32,
    sums: &mut [f32],
) {
    split_planes(coarse, sums).into_par_iter().enumerate().for_each(|(z, plane)| {
        let z = z as u32;
        let start = coarse.planes()[z as usize] as usize;
        for (fine_z, weight_z) in [((2 * z).wrapping_sub(1), 0.5), (2 * z, 1.0), (2 * z + 1, 0.5)] {
            for (fine_y, run) in fine.iter_plane(fine_z) {
                let source = &values[run.base as usize..][..(run.end - run.begin) as usize];
                let (y0, y1, weight_y) = coarse_of(fine_y);
                for y in y0..=y1 {
                    let base = coarse_base(coarse, run, y, z) - start;
                    let target = &mut plane[base..][..source.len() / 2 + 1];
                    gather(scale * weight_y * weight_z, source, target);
                }
            }
        }
    });
}

/// Adds a fine row to a coarse one that begins and ends at the same vertices.
fn gather(weight: f32, fine: &[f32], coarse: &mut [f32]) {
    let half = 0.5 * weight;
    for (i, pair) in fine.chunks_exact(2).enumerate() {
        coarse[i] += weight * pair[0] + half * pair[1];
        coarse[i + 1] += half * pair[1];
    }
    coarse[fine.len() / 2] += weight * fine[fine.len() - 1];
}
