//! Vertices whose value is solved for, as runs with their neighborhoods.

use super::octree::Level;
use super::rows::{Rows, Run};
use super::screen::Screen;

/// Neighbor rows of a row of vertices, (dy, dz).
pub(super) const NEIGHBORS: [(i32, i32); 8] =
    [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)];
/// Cell rows around a row of vertices, (dy, dz): on which side they lie.
pub(super) const CELLS: [(i32, i32); 4] = [(-1, -1), (1, -1), (-1, 1), (1, 1)];

/// Free vertices next to each other along x. All 8 cells around each of them exist.
#[derive(Debug, Clone, Copy)]
pub(super) struct FreeRun {
    /// The first vertex, counted from the first of its plane.
    pub(super) first: u32,
    /// How many.
    pub(super) len: u32,
    /// The vertex next to the first in each of [`NEIGHBORS`], counted from the first of its plane.
    pub(super) neighbors: [u32; 8],
    /// The cell before the first vertex in each of [`CELLS`].
    pub(super) cells: [u32; 4],
    /// Whether any of the cells holds samples.
    pub(super) screened: bool,
}

/// The free runs of a level, plane by plane.
#[derive(Debug)]
pub(super) struct FreeRuns {
    planes: Vec<Vec<FreeRun>>,
}

impl FreeRuns {
    /// Vertices on the boundary of the refined region, and of the cube, are not free: their values
    /// come from the coarser level.
    pub(super) fn of(level: &Level, screen: &Screen) -> Self {
        let side = level.vertices.side();
        let planes = (0..side).map(|z| {
            let mut runs = Vec::new();
            if (1..side - 1).contains(&z) {
                for y in 1..side - 1 {
                    free_row(level, screen, y, z, &mut runs);
                }
            }
            runs
        });
        Self { planes: planes.collect() }
    }

    /// The runs of the plane of one z.
    pub(super) fn plane(&self, z: usize) -> &[FreeRun] {
        &self.planes[z]
    }
}

fn free_row(level: &Level, screen: &Screen, y: u32, z: u32, runs: &mut Vec<FreeRun>) {
    let rows = CELLS.map(|(dy, dz)| {
        level.cells.row(if dy < 0 { y - 1 } else { y }, if dz < 0 { z - 1 } else { z })
    });
    for_each_common(rows, |begin, end, cells| {
        // Cells begin..end surround the vertices begin + 1..end.
        let first = begin + 1;
        let is_screened = |offset: u32| {
            cells.iter().any(|run| {
                let cell = (run.index(begin) + offset) as usize;
                screen.area[cell] > 0.0 || screen.area[cell + 1] > 0.0
            })
        };
        let mut offset = 0;
        while first + offset < end {
            let screened = is_screened(offset);
            let mut len = 1;
            while first + offset + len < end && is_screened(offset + len) == screened {
                len += 1;
            }
            let x = first + offset;
            runs.push(FreeRun {
                first: local_index(&level.vertices, x, y, z),
                len,
                neighbors: NEIGHBORS.map(|(dy, dz)| {
                    local_index(
                        &level.vertices,
                        x,
                        y.wrapping_add_signed(dy),
                        z.wrapping_add_signed(dz),
                    )
                }),
                cells: cells.map(|run| run.index(x - 1)),
                screened,
            });
            offset += len;
        }
    });
}

/// Index of a vertex counted from the first of its plane.
fn local_index(vertices: &Rows, x: u32, y: u32, z: u32) -> u32 {
    let index = vertices.find([x, y, z]).expect("cells have their corners in the tree");
    index - vertices.planes()[z as usize]
}

/// Visits the intervals that four rows have in common, with the run of each row.
fn for_each_common(mut rows: [&[Run]; 4], mut visit: impl FnMut(u32, u32, [Run; 4])) {
    while let [[a, ..], [b, ..], [c, ..], [d, ..]] = rows {
        let runs = [*a, *b, *c, *d];
        let begin = runs.iter().map(|run| run.begin).max().unwrap_or(0);
        let end = runs.iter().map(|run| run.end).min().unwrap_or(0);
        if begin < end {
            visit(begin, end, runs);
        }
        for row in &mut rows {
            if row[0].end == end {
                *row = &row[1..];
            }
        }
    }
}
