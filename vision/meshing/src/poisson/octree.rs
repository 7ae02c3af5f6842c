//! The adaptive octree, level by level.

use super::rows::Rows;

/// Depth whose cells fill the whole cube. Coarser levels exist only to sum samples.
pub(super) const BASE_DEPTH: u32 = 4;

/// One depth of the tree.
#[derive(Debug, Default)]
pub(super) struct Level {
    /// Cells, in units of their side.
    pub(super) cells: Rows,
    /// Cells with eight children.
    pub(super) refined: Rows,
    /// Corners of the cells.
    pub(super) vertices: Rows,
}

/// A linear octree over the unit cube.
///
/// Cells come in families of eight, and the 26 neighbors of a cell with grandchildren have
/// children: sides of neighbors differ at most by a factor of two.
#[derive(Debug)]
pub(super) struct Octree {
    /// From [`BASE_DEPTH`] on.
    levels: Vec<Level>,
}

impl Octree {
    /// The smallest tree in which every sample has, at its own depth, the 125 cells around it: as
    /// far as it reaches.
    ///
    /// `sample_cells[d]` holds the cells at depth `d` of the samples whose depth is `d`.
    pub(super) fn around(sample_cells: &[Rows]) -> Self {
        let depth = sample_cells.len() as u32 - 1;
        let mut refined = vec![Rows::default(); depth as usize + 1];
        for d in (BASE_DEPTH + 1..=depth).rev() {
            let wanted = wanted_cells(&sample_cells[d as usize], &refined[d as usize], 1 << d);
            refined[d as usize - 1] = parents_of(&wanted);
        }
        let mut levels = Vec::new();
        for (d, refined_here) in refined.iter().enumerate().skip(BASE_DEPTH as usize) {
            let cells = if d == BASE_DEPTH as usize {
                Rows::full(1 << d)
            } else {
                children_of(&refined[d - 1])
            };
            let vertices = corners_of(&cells);
            levels.push(Level { cells, refined: refined_here.clone(), vertices });
        }
        Self { levels }
    }

    /// Depth of the finest level.
    pub(super) fn depth(&self) -> u32 {
        BASE_DEPTH + self.levels.len() as u32 - 1
    }

    /// The level of a depth from [`BASE_DEPTH`] to [`Octree::depth`].
    pub(super) fn level(&self, depth: u32) -> &Level {
        &self.levels[(depth - BASE_DEPTH) as usize]
    }
}

/// The 125 cells around those of the samples, and the refined cells with their 26 neighbors.
fn wanted_cells(sample_cells: &Rows, refined: &Rows, side: u32) -> Rows {
    Rows::union(side, |y, z, row| {
        for z in z.saturating_sub(2)..=z + 2 {
            for y in y.saturating_sub(2)..=y + 2 {
                row.extend(
                    sample_cells
                        .row(y, z)
                        .iter()
                        .map(|run| [run.begin.saturating_sub(2), (run.end + 2).min(side)]),
                );
            }
        }
        push_dilated(refined, y, z, row);
    })
}

/// The cells and their 26 neighbors.
pub(super) fn dilated(cells: &Rows) -> Rows {
    Rows::union(cells.side(), |y, z, row| push_dilated(cells, y, z, row))
}

fn push_dilated(cells: &Rows, y: u32, z: u32, row: &mut Vec<[u32; 2]>) {
    for z in z.saturating_sub(1)..=z + 1 {
        for y in y.saturating_sub(1)..=y + 1 {
            row.extend(
                cells
                    .row(y, z)
                    .iter()
                    .map(|run| [run.begin.saturating_sub(1), (run.end + 1).min(cells.side())]),
            );
        }
    }
}

fn parents_of(cells: &Rows) -> Rows {
    Rows::union(cells.side() / 2, |y, z, row| {
        for (y, z) in
            [(2 * y, 2 * z), (2 * y + 1, 2 * z), (2 * y, 2 * z + 1), (2 * y + 1, 2 * z + 1)]
        {
            row.extend(cells.row(y, z).iter().map(|run| [run.begin / 2, run.end.div_ceil(2)]));
        }
    })
}

fn children_of(cells: &Rows) -> Rows {
    Rows::union(2 * cells.side(), |y, z, row| {
        row.extend(cells.row(y / 2, z / 2).iter().map(|run| [2 * run.begin, 2 * run.end]));
    })
}

fn corners_of(cells: &Rows) -> Rows {
    Rows::union(cells.side() + 1, |y, z, row| {
        // Row -1 wraps to a row outside of the lattice, which is empty.
        for (y, z) in [
            (y.wrapping_sub(1), z.wrapping_sub(1)),
            (y, z.wrapping_sub(1)),
            (y.wrapping_sub(1), z),
            (y, z),
        ] {
            row.extend(cells.row(y, z).iter().map(|run| [run.begin, run.end + 1]));
        }
    })
}
