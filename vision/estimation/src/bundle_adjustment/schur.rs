//! The reduced matrix `S = U − Y Yᵀ`, one row of blocks after another.
//!
//! A row gathers its blocks in a small dense scratch (the products of one row touch nothing else),
//! then writes them out as columns of the lower triangle. Rows are independent, so the sums do not
//! depend on the number of threads.

use std::ops::Range;

use arrayvec::ArrayVec;
use volery_geometry::SimdLevel;

use super::layout::{LANES, Layout, MAX_CHUNKS, POSE_DIM};
use super::linearize::{Factor, Sums};
use super::minimize::run_tasks;
use super::simd;

/// A block diagonal entry that is zero (nothing is known of the unknown) is damped as if it were
/// this.
pub(super) const MIN_DIAGONAL: f64 = 1e-12;

/// Below this part of full the reduced matrix is factored as a sparse one.
const MAX_SPARSE_DENSITY: f64 = 0.35;

/// Up to so many unknowns a dense factorization is the faster one however empty the matrix is.
const MAX_DENSE_UNKNOWNS: usize = 300;

/// Which blocks of the upper triangle of S are not zero, and the rows dealt out to tasks.
#[derive(Debug)]
pub(super) struct Pattern {
    /// Column blocks of row b, `≥ b`, sorted: `columns[starts[b]..starts[b + 1]]`.
    pub(super) columns: Vec<u32>,
    pub(super) starts: Vec<usize>,
    pub(super) is_dense: bool,
    groups: Vec<RowGroup>,
}

/// Rows that one task computes, with its scratch.
#[derive(Debug)]
struct RowGroup {
    rows: Range<usize>,
    scratch: Vec<[f64; LANES]>,
}

impl Pattern {
    pub(super) fn new(layout: &Layout) -> Self {
        if layout.num_unknowns() <= MAX_DENSE_UNKNOWNS {
            return Self::dense(layout);
        }
        let mut pattern =
            Self { columns: Vec::new(), starts: vec![0], is_dense: false, groups: Vec::new() };
        pattern.find_columns(layout);
        let num_blocks = layout.num_blocks();
        let full = (num_blocks * (num_blocks + 1) / 2) as f64;
        if pattern.columns.len() as f64 > MAX_SPARSE_DENSITY * full {
            return Self::dense(layout);
        }
        pattern.deal_rows(layout);
        pattern
    }

    /// The full upper triangle.
    pub(super) fn dense(layout: &Layout) -> Self {
        let mut pattern =
            Self { columns: Vec::new(), starts: vec![0], is_dense: true, groups: Vec::new() };
        for row in 0..layout.num_blocks() as u32 {
            pattern.columns.extend(row..layout.num_blocks() as u32);
            pattern.starts.push(pattern.columns.len());
        }
        pattern.deal_rows(layout);
        pattern
    }

    /// Column blocks of a row.
    pub(super) fn columns_of(&self, row: usize) -> &[u32] {
        &self.columns[self.starts[row]..self.starts[row + 1]]
    }

    fn find_columns(&mut self, layout: &Layout) {
        let mut last_row = vec![u32::MAX; layout.num_blocks()];
        for row in 0..layout.num_blocks() {
            let start = self.columns.len();
            let mut meet = |column: u32| {
                if last_row[column as usize] != row as u32 {
                    last_row[column as usize] = row as u32;
                    self.columns.push(column);
                }
            };
            meet(row as u32);
            for &factor in block_factors(layout, row) {
                let end = layout.factor_ends[factor as usize] as usize;
                layout.factor_blocks[factor as usize..end].iter().for_each(|&c| meet(c));
            }
            for &(_, column) in couplings(layout, row) {
                meet(column);
            }
            self.columns[start..].sort_unstable();
            self.starts.push(self.columns.len());
        }
    }

    /// Contiguous groups of rows of about equal work, as many for any number of threads.
    fn deal_rows(&mut self, layout: &Layout) {
        let work_of = |row: usize| -> usize {
            let products: usize = block_factors(layout, row)
                .iter()
                .map(|&factor| (layout.factor_ends[factor as usize] - factor) as usize)
                .sum();
            products + self.columns_of(row).len()
        };
        let work: Vec<usize> = (0..layout.num_blocks()).map(work_of).collect();
        let total: usize = work.iter().sum();
        let num_groups = layout.chunks.len().clamp(1, MAX_CHUNKS);
        let (mut start, mut done) = (0, 0);
        for (row, work) in work.into_iter().enumerate() {
            done += work;
            let is_last = row + 1 == layout.num_blocks();
            if is_last || done * num_groups >= total * (self.groups.len() + 1) {
                let scratch = vec![[0.0; LANES]; layout.num_blocks() * LANES];
                self.groups.push(RowGroup { rows: start..row + 1, scratch });
                start = row + 1;
            }
        }
    }

    /// Writes the damped lower triangle of S by columns: dense with `num_unknowns` rows each, or
    /// packed to the pattern. `column_starts` has one entry per scalar column and the end.
    #[allow(clippy::too_many_arguments)]
    pub(super) fn reduce(
        &mut self,
        level: SimdLevel,
        layout: &Layout,
        sums: &Sums,
        factors: &[Factor],
        damping: f64,
        column_starts: &[usize],
        values: &mut [f64],
    ) {
        let mut tasks: ArrayVec<_, { MAX_CHUNKS + 1 }> = ArrayVec::new();
        let mut rest = values;
        for group in &mut self.groups {
            let first = layout.block_offsets[group.rows.start];
            let end = layout.block_offsets[group.rows.end];
            let (of_group, tail) = rest.split_at_mut(column_starts[end] - column_starts[first]);
            tasks.push((group, of_group));
            rest = tail;
        }
        let (columns, starts, is_dense) = (&self.columns, &self.starts, self.is_dense);
        let run = |(group, values): &mut (&mut RowGroup, &mut [f64])| {
            let first_value = column_starts[layout.block_offsets[group.rows.start]];
            for row in group.rows.clone() {
                let columns = &columns[starts[row]..starts[row + 1]];
                let dim = layout.block_dims[row];
                fill_row(level, layout, sums, factors, damping, row, columns, &mut group.scratch);
                for r in 0..dim {
                    let start = column_starts[layout.block_offsets[row] + r] - first_value;
                    let mut packed = start;
                    for &column in columns {
                        let column = column as usize;
                        let skip = if column == row { r } else { 0 };
                        let source = &group.scratch[column * dim + r];
                        let source = &source[skip..layout.block_dims[column]];
                        let at = if is_dense {
                            start + layout.block_offsets[column] + skip
                        } else {
                            packed
                        };
                        values[at..at + source.len()].copy_from_slice(source);
                        packed += source.len();
                    }
                }
            }
        };
        run_tasks(tasks, run);
    }
}

/// Factors of a block.
fn block_factors(layout: &Layout, block: usize) -> &[u32] {
    &layout.block_factors[layout.block_starts[block]..layout.block_starts[block + 1]]
}

/// Couplings of a row.
fn couplings(layout: &Layout, row: usize) -> &[(u32, u32)] {
    &layout.couplings[layout.coupling_starts[row]..layout.coupling_starts[row + 1]]
}

/// One row of S: block of column c in rows `c * dim..(c + 1) * dim` of the scratch.
#[allow(clippy::too_many_arguments)]
fn fill_row(
    level: SimdLevel,
    layout: &Layout,
    sums: &Sums,
    factors: &[Factor],
    damping: f64,
    row: usize,
    columns: &[u32],
    scratch: &mut [[f64; LANES]],
) {
    let dim = layout.block_dims[row];
    for &column in columns {
        scratch[column as usize * dim..][..dim].fill([0.0; LANES]);
    }
    let diagonal = &mut scratch[row * dim..][..dim];
    diagonal.copy_from_slice(&sums.blocks[row].hessian[..dim]);
    for (r, lanes) in diagonal.iter_mut().enumerate() {
        lanes[r] += damping * lanes[r].max(MIN_DIAGONAL);
    }
    let start = layout.coupling_starts[row];
    for (index, &(_, column)) in couplings(layout, row).iter().enumerate() {
        scratch[column as usize * dim..][..dim]
            .copy_from_slice(&sums.couplings[start + index][..dim]);
    }
    simd::subtract_products(level, layout, factors, row, scratch);
}

/// Subtracts `Yᵢ Yⱼᵀ` for every point that block i = `row` and blocks j ≥ i share.
#[inline(always)]
pub(super) fn subtract_products<const FMA: bool>(
    layout: &Layout,
    factors: &[Factor],
    row: usize,
    blocks: &mut [[f64; LANES]],
) {
    match layout.block_dims[row] {
        POSE_DIM => subtract_rows::<FMA, POSE_DIM>(layout, factors, row, blocks),
        1 => subtract_rows::<FMA, 1>(layout, factors, row, blocks),
        2 => subtract_rows::<FMA, 2>(layout, factors, row, blocks),
        3 => subtract_rows::<FMA, 3>(layout, factors, row, blocks),
        4 => subtract_rows::<FMA, 4>(layout, factors, row, blocks),
        5 => subtract_rows::<FMA, 5>(layout, factors, row, blocks),
        7 => subtract_rows::<FMA, 7>(layout, factors, row, blocks),
        _ => subtract_rows::<FMA, LANES>(layout, factors, row, blocks),
    }
}

#[inline(always)]
fn subtract_rows<const FMA: bool, const DIM: usize>(
    layout: &Layout,
    factors: &[Factor],
    row: usize,
    blocks: &mut [[f64; LANES]],
) {
    use super::lens::fma;
    let (blocks, _) = blocks.as_chunks_mut::<DIM>();
    for &first in block_factors(layout, row) {
        let range = first as usize..layout.factor_ends[first as usize] as usize;
        let y_i = &factors[range.start];
        let minus: [[f64; DIM]; 3] = std::array::from_fn(|k| std::array::from_fn(|r| -y_i[k][r]));
        for (y_j, &column) in factors[range.clone()].iter().zip(&layout.factor_blocks[range]) {
            let block = &mut blocks[column as usize];
            for (r, lanes) in block.iter_mut().enumerate() {
                // One value of all lanes: compilers that look for loops take the rows for the vector.
                *lanes = (0..3).fold(*lanes, |sum, k| {
                    std::array::from_fn(|lane| fma::<FMA>(minus[k][r], y_j[k][lane], sum[lane]))
                });
            }
        }
    }
}
