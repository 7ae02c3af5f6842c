//! The field χ, coarse to fine.

use rayon::prelude::*;
use volery_scene::{Progress, Stage};

use super::coarse::CoarseSystem;
use super::field::{Field, Weighted, add_field_divergence, divergences, prolong_field, spread};
use super::free::FreeRuns;
use super::octree::{BASE_DEPTH, Octree};
use super::relax::System;
use super::samples::cell_of;
use super::screen::screens;
use super::transfer::prolong;
use crate::MeshingError;

/// Sweeps per level. Only a few cells around the surface are free, so that they are soon settled.
const NUM_SWEEPS: usize = 6;

/// χ at the vertices of every level; between them it is trilinear, and continuous across levels.
#[derive(Debug)]
pub(super) struct Solution {
    /// Coarsest first.
    values: Vec<Vec<f32>>,
}

impl Solution {
    /// Cascadic multigrid: each level starts from the coarser one and relaxes what is free.
    pub(super) fn solve(
        octree: &Octree,
        weighted: Weighted,
        screening: f32,
        progress: &dyn Progress,
    ) -> Result<Self, MeshingError> {
        let mut sums = divergences(octree, weighted);
        let screens = screens(octree, weighted, screening, &mut sums);
        let num_levels = screens.len();
        let mut field: Option<Field> = None;
        let mut values: Vec<Vec<f32>> = Vec::new();
        for (i, screen) in screens.iter().enumerate() {
            progress.check()?;
            let depth = BASE_DEPTH + i as u32;
            let level = octree.level(depth);
            let rhs = &mut sums[i];
            let mut level_field = field.take().unwrap_or_else(|| empty_field(level.vertices.len()));
            if i == 0 {
                spread(&level.vertices, depth, weighted, &mut level_field);
                let system = CoarseSystem::new(level, screen, screening);
                system.add_divergence(&level_field, rhs);
                values.push(system.solve(rhs));
            } else {
                let free = FreeRuns::of(level, screen);
                if level_field.iter().any(|component| component.iter().any(|&v| v != 0.0)) {
                    add_field_divergence(level, &free, &level_field, rhs);
                }
                let coarse = &octree.level(depth - 1).vertices;
                let mut level_values = prolong(coarse, &level.vertices, &values[i - 1]);
                let system = System { level, free: &free, screen, screening, rhs };
                for _ in 0..NUM_SWEEPS {
                    system.sweep(&mut level_values);
                }
                values.push(level_values);
            }
            if depth < octree.depth() {
                // The divergence of the samples of deeper levels is exact already: only finer
                // levels need the field itself.
                if i > 0 {
                    spread(&level.vertices, depth, weighted, &mut level_field);
                }
                let fine = &octree.level(depth + 1).vertices;
                field = Some(prolong_field(&level.vertices, fine, &level_field));
            }
            progress.report(Stage::Meshing, i + 1, num_levels + 1);
        }
        Ok(Self { values })
    }

    /// χ at the vertices of a depth.
    pub(super) fn at_depth(&self, depth: u32) -> &[f32] {
        &self.values[(depth - BASE_DEPTH) as usize]
    }

    /// χ at a point of the unit cube.
    pub(super) fn at(&self, octree: &Octree, position: [f32; 3]) -> f32 {
        for depth in (BASE_DEPTH..=octree.depth()).rev() {
            let (cell, inside) = cell_of(position, depth);
            let level = octree.level(depth);
            if level.cells.find(cell).is_some() {
                return self.in_cell(octree, depth, cell, inside);
            }
        }
        0.0
    }

    fn in_cell(&self, octree: &Octree, depth: u32, cell: [u32; 3], inside: [f32; 3]) -> f32 {
        let (vertices, values) = (&octree.level(depth).vertices, self.at_depth(depth));
        let ([x, y, z], [tx, ty, tz]) = (cell, inside);
        let mut sum = 0.0;
        for (dz, wz) in [(0, 1.0 - tz), (1, tz)] {
            for (dy, wy) in [(0, 1.0 - ty), (1, ty)] {
                if let Some(first) = vertices.find([x, y + dy, z + dz]) {
                    let row = &values[first as usize..];
                    sum += wz * wy * ((1.0 - tx) * row[0] + tx * row[1]);
                }
            }
        }
        sum
    }

    /// The mean of χ over the surface: its value at the samples, weighted by their areas.
    pub(super) fn mean_at(&self, octree: &Octree, weighted: Weighted) -> f32 {
        let positions = &weighted.samples.positions;
        let values: Vec<f32> = positions.par_iter().map(|&p| self.at(octree, p)).collect();
        let sum = |i: usize| f64::from(weighted.areas[i]) * f64::from(values[i]);
        let total: f64 = weighted.areas.iter().map(|&a| f64::from(a)).sum();
        ((0..values.len()).map(sum).sum::<f64>() / total) as f32
    }
}

fn empty_field(len: usize) -> Field {
    std::array::from_fn(|_| vec![0.0; len])
}
