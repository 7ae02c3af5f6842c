//! Samples summed per cell: the points at which the field is held.

use super::octree::{BASE_DEPTH, Octree};
use super::samples::{Samples, cell_of};

/// Per cell of one level, the mean sample and its area.
#[derive(Debug, Default)]
pub(super) struct Screen {
    /// Mean position in the cell, 0 to 1.
    pub(super) x: Vec<f32>,
    /// As `x`.
    pub(super) y: Vec<f32>,
    /// As `x`.
    pub(super) z: Vec<f32>,
    /// Area of the samples in units of the cell's face; 0 in empty cells.
    pub(super) area: Vec<f32>,
}

/// A sample, or the mean of several.
#[derive(Clone, Copy)]
struct Mean {
    position: [f32; 3],
    area: f32,
}

/// The screens of all levels, coarsest first. `areas` are those of the samples in the unit cube.
pub(super) fn screens(octree: &Octree, samples: &Samples, areas: &[f32]) -> Vec<Screen> {
    let pairs = samples.positions.iter().zip(areas);
    let mut means: Vec<Mean> = pairs.map(|(&position, &area)| Mean { position, area }).collect();
    let mut screens: Vec<Screen> = (BASE_DEPTH..=octree.depth())
        .rev()
        .map(|depth| {
            merge_cells(&mut means, depth);
            Screen::of(&means, octree, depth)
        })
        .collect();
    screens.reverse();
    screens
}

/// Joins neighbors in the list that share a cell. In Morton order those are all that share it.
fn merge_cells(means: &mut Vec<Mean>, depth: u32) {
    means.dedup_by(|next, kept| {
        let same = cell_of(next.position, depth).0 == cell_of(kept.position, depth).0;
        if same {
            let area = kept.area + next.area;
            let part = next.area / area;
            for (kept, next) in kept.position.iter_mut().zip(next.position) {
                *kept += part * (next - *kept);
            }
            kept.area = area;
        }
        same
    });
}

impl Screen {
    fn of(means: &[Mean], octree: &Octree, depth: u32) -> Self {
        let cells = &octree.level(depth).cells;
        let empty = || vec![0.0; cells.len()];
        let mut screen = Self { x: empty(), y: empty(), z: empty(), area: empty() };
        let areas_per_unit = (1u64 << (2 * depth)) as f32;
        for mean in means {
            let (cell, [x, y, z]) = cell_of(mean.position, depth);
            if let Some(cell) = cells.find(cell) {
                let cell = cell as usize;
                (screen.x[cell], screen.y[cell], screen.z[cell]) = (x, y, z);
                screen.area[cell] = mean.area * areas_per_unit;
            }
        }
        screen
    }
}
