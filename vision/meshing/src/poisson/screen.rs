//! Samples summed per cell: the points at which the field is held.

use super::field::Weighted;
use super::octree::{BASE_DEPTH, Level, Octree};
use super::rows::Rows;
use super::samples::cell_of;
use super::step::{spread_variance, tents_on_step};

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
    normal: [f32; 3],
    /// Variance of what spreads the sample, in the unit cube.
    variance: f32,
    area: f32,
}

/// The screens of all levels, coarsest first. Adds what they draw the field to, times `screening`
/// α, to the right-hand sides.
pub(super) fn screens(
    octree: &Octree,
    weighted: Weighted,
    screening: f32,
    sums: &mut [Vec<f32>],
) -> Vec<Screen> {
    let Weighted { samples, areas, depths } = weighted;
    let mean = |i: usize| Mean {
        position: samples.positions[i],
        normal: samples.normals[i],
        variance: spread_variance(depths[i]),
        area: areas[i],
    };
    let mut means: Vec<Mean> = (0..samples.len()).map(mean).collect();
    let mut screens: Vec<Screen> = (BASE_DEPTH..=octree.depth())
        .rev()
        .map(|depth| {
            let sums = &mut sums[(depth - BASE_DEPTH) as usize];
            merge_cells(&mut means, depth);
            Screen::of(&means, octree.level(depth), depth, screening, sums)
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
            let mix = |kept: &mut f32, next: f32| *kept += part * (next - *kept);
            for axis in 0..3 {
                mix(&mut kept.position[axis], next.position[axis]);
                mix(&mut kept.normal[axis], next.normal[axis]);
            }
            mix(&mut kept.variance, next.variance);
            kept.area = area;
        }
        same
    });
}

impl Screen {
    fn of(means: &[Mean], level: &Level, depth: u32, screening: f32, sums: &mut [f32]) -> Self {
        let empty = || vec![0.0; level.cells.len()];
        let mut screen = Self { x: empty(), y: empty(), z: empty(), area: empty() };
        let areas_per_unit = (1u64 << (2 * depth)) as f32;
        for mean in means {
            let (at, inside) = cell_of(mean.position, depth);
            if let Some(cell) = level.cells.find(at) {
                let cell = cell as usize;
                [screen.x[cell], screen.y[cell], screen.z[cell]] = inside;
                screen.area[cell] = mean.area * areas_per_unit;
                let target = tents_on_step(inside, mean.normal, mean.variance * areas_per_unit);
                let weight = screening * screen.area[cell] * target;
                add_at_corners(&level.vertices, at, inside, weight, sums);
            }
        }
        screen
    }
}

/// Adds a value to the sums at the corners of a cell, shared by the trilinear weights.
fn add_at_corners(
    vertices: &Rows,
    [x, y, z]: [u32; 3],
    [tx, ty, tz]: [f32; 3],
    value: f32,
    sums: &mut [f32],
) {
    for (dz, wz) in [(0, 1.0 - tz), (1, tz)] {
        for (dy, wy) in [(0, 1.0 - ty), (1, ty)] {
            let first = vertices.find([x, y + dy, z + dz]).expect("cells have corners") as usize;
            sums[first] += value * wz * wy * (1.0 - tx);
            sums[first + 1] += value * wz * wy * tx;
        }
    }
}
