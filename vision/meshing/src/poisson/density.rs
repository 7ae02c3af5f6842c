//! How densely the surface is sampled.

use super::octree::dilated;
use super::rows::Rows;
use super::samples::{Samples, cell_of};

/// Sample and query are each spread by quadratic B-splines of variance 1/4: across the surface
/// their product keeps 1/sqrt(2π (1/4 + 1/4)) of a sample per unit of length.
const KERNEL_AT_SURFACE: f32 = 0.564_19;

/// Sample counts on the grids of some depths, finest first.
#[derive(Debug)]
pub(super) struct Density {
    /// Samples that a cell should hold before its depth counts as supported.
    samples_per_cell: f32,
    grids: Vec<Grid>,
}

#[derive(Debug)]
struct Grid {
    depth: u32,
    cells: Rows,
    /// Per cell, the samples spread over it.
    counts: Vec<f32>,
}

impl Density {
    /// Estimates on the cells of `depth`, and on coarser ones where those hold too few samples.
    pub(super) fn estimate(samples: &Samples, depth: u32, samples_per_cell: f32) -> Self {
        let mut density = Self { samples_per_cell, grids: Vec::new() };
        for depth in (0..=depth).rev() {
            density.grids.push(Grid::count(samples, depth));
            let grid = &density.grids[density.grids.len() - 1];
            if samples.positions.iter().all(|&p| grid.per_cell(p) >= samples_per_cell) {
                break;
            }
        }
        density
    }

    /// Samples per area of the unit cube's faces.
    pub(super) fn per_area(&self, position: [f32; 3]) -> f32 {
        let mut found = 0.0;
        for grid in &self.grids {
            let per_cell = grid.per_cell(position);
            found = per_cell * (1u64 << (2 * grid.depth)) as f32;
            if per_cell >= self.samples_per_cell {
                break;
            }
        }
        found
    }

    /// Depth, as a fraction, whose cells hold `samples_per_cell` samples.
    pub(super) fn depth(&self, per_area: f32) -> f32 {
        0.5 * (per_area / self.samples_per_cell).log2()
    }
}

impl Grid {
    fn count(samples: &Samples, depth: u32) -> Self {
        let mut occupied: Vec<[u32; 3]> =
            samples.positions.iter().map(|&position| cell_of(position, depth).0).collect();
        occupied.dedup();
        let cells = dilated(&Rows::from_points(1 << depth, occupied.into_iter()));
        let mut counts = vec![0.0; cells.len()];
        for &position in &samples.positions {
            for_each_weight(&cells, depth, position, |cell, weight| counts[cell] += weight);
        }
        Self { depth, cells, counts }
    }

    /// Samples per area of a cell's face.
    fn per_cell(&self, position: [f32; 3]) -> f32 {
        let mut sum = 0.0;
        for_each_weight(&self.cells, self.depth, position, |cell, weight| {
            sum += weight * self.counts[cell];
        });
        sum / KERNEL_AT_SURFACE
    }
}

/// The 27 cells around a position that exist, with the quadratic B-splines centered on them.
fn for_each_weight(
    cells: &Rows,
    depth: u32,
    position: [f32; 3],
    mut visit: impl FnMut(usize, f32),
) {
    let ([x, y, z], inside) = cell_of(position, depth);
    let [wx, wy, wz] = inside.map(quadratic);
    for (k, wz) in wz.into_iter().enumerate() {
        for (j, wy) in wy.into_iter().enumerate() {
            let row = (y + j as u32, z + k as u32);
            // Row 0 of the loop is row -1 of the lattice: it wraps and is not found.
            let (row_y, row_z) = (row.0.wrapping_sub(1), row.1.wrapping_sub(1));
            for run in cells.row(row_y, row_z) {
                for (i, wx) in wx.into_iter().enumerate() {
                    let x = (x + i as u32).wrapping_sub(1);
                    if (run.begin..run.end).contains(&x) {
                        visit(run.index(x) as usize, wx * wy * wz);
                    }
                }
            }
        }
    }
}

/// Quadratic B-splines of the cells before, around and after a position inside of a cell.
fn quadratic(inside: f32) -> [f32; 3] {
    let (t, s) = (inside, 1.0 - inside);
    [0.5 * s * s, 0.5 + t * s, 0.5 * t * t]
}
