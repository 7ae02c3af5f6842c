//! The normals as a vector field, and its divergence against the tents of each level.
//!
//! A sample p of area a and normal n, at depth d with cells of side h, adds
//!
//! ```text
//! V(x) += a n Σᵥ qᵥ(p) Bᵥ(x) / h³
//! ```
//!
//! to the field, with cubic B-splines q that share it among the 64 vertices around it. A fractional depth shares the
//! sample between the depths above and below. The right-hand side at vertex i is `1/h ∫ ∇Bᵢ·V`.

use std::ops::Range;

use rayon::prelude::*;

use super::free::{FreeRun, FreeRuns, NEIGHBORS};
use super::octree::{BASE_DEPTH, Level, Octree};
use super::rows::Rows;
use super::samples::{Samples, cell_of};
use super::transfer::{prolong, restrict_onto, split_planes};

/// What a sample gives to one depth.
#[derive(Clone, Copy)]
struct Share {
    position: [f32; 3],
    /// Normal times area in units of the cell's face.
    normal: [f32; 3],
}

/// Components of the field at the vertices of a level, times the side of its cells.
pub(super) type Field = [Vec<f32>; 3];

/// Samples with what is known of their neighborhood.
#[derive(Clone, Copy)]
pub(super) struct Weighted<'a> {
    pub(super) samples: &'a Samples,
    /// In the unit cube.
    pub(super) areas: &'a [f32],
    /// Depths that the density supports, from [`BASE_DEPTH`] to that of the tree.
    pub(super) depths: &'a [f32],
}

impl Weighted<'_> {
    fn shares(self, depth: u32) -> impl Iterator<Item = Share> {
        let areas_per_unit = (1u64 << (2 * depth)) as f32;
        (0..self.samples.len()).filter_map(move |i| {
            let weight = 1.0 - (self.depths[i] - depth as f32).abs();
            (weight > 0.0).then(|| Share {
                position: self.samples.positions[i],
                normal: self.samples.normals[i]
                    .map(|v| v * weight * self.areas[i] * areas_per_unit),
            })
        })
    }
}

/// Divergence of what the samples of a depth and of finer depths give, per level, coarsest first.
/// The samples of [`BASE_DEPTH`] itself are left out: see [`spread`].
pub(super) fn divergences(octree: &Octree, weighted: Weighted) -> Vec<Vec<f32>> {
    let mut levels: Vec<Vec<f32>> = Vec::new();
    for depth in (BASE_DEPTH..=octree.depth()).rev() {
        let vertices = &octree.level(depth).vertices;
        let mut sums = vec![0.0; vertices.len()];
        if depth > BASE_DEPTH {
            add_divergence(vertices, depth, weighted.shares(depth), &mut sums);
        }
        if let Some(finer) = levels.last() {
            // Bᵢ is a sum of fine tents, and 1/h halves.
            restrict_onto(vertices, &octree.level(depth + 1).vertices, finer, 0.5, &mut sums);
        }
        levels.push(sums);
    }
    levels.reverse();
    levels
}

/// Adds `1/h ∫ ∇Bᵢ·V` of the shares: 216 vertices each.
fn add_divergence(
    vertices: &Rows,
    depth: u32,
    shares: impl Iterator<Item = Share>,
    sums: &mut [f32],
) {
    let mut rows = [[None; 6]; 6];
    let mut rows_of = [u32::MAX; 3];
    let mut along_x = 0..0;
    for share in shares {
        let (cell, inside) = cell_of(share.position, depth);
        if cell != rows_of {
            rows_of = cell;
            let [_, y, z] = cell.map(|v| v.wrapping_sub(2));
            let (x, inside) = inside_cube(cell[0], 2, 6, vertices.side());
            along_x = inside;
            for (k, plane) in rows.iter_mut().enumerate() {
                for (j, row) in plane.iter_mut().enumerate() {
                    let (y, z) = (y.wrapping_add(j as u32), z.wrapping_add(k as u32));
                    *row = vertices.find([x, y, z]).map(|first| first as usize);
                }
            }
        }
        let [mx, my, mz] = inside.map(mass);
        let [cx, cy, cz] = inside.map(gradient);
        let [nx, ny, nz] = share.normal;
        for k in 0..6 {
            for j in 0..6 {
                // Vertices outside of the cube do not exist.
                let Some(row) = rows[k][j] else { continue };
                let along = nx * my[j] * mz[k];
                let across = ny * cy[j] * mz[k] + nz * my[j] * cz[k];
                for (i, sum) in along_x.clone().zip(&mut sums[row..]) {
                    *sum += along * cx[i] + across * mx[i];
                }
            }
        }
    }
}

/// Of `count` vertices along x from `before` ahead of a cell, the first that lies in the cube, and
/// which of them do.
fn inside_cube(cell: u32, before: u32, count: u32, side: u32) -> (u32, Range<usize>) {
    let skipped = before.saturating_sub(cell);
    let end = count.min(side + before - cell);
    (cell + skipped - before, skipped as usize..end as usize)
}

/// How a sample at t in cell 0 is shared by the vertices -1 to 2: cubic B-splines.
fn shares_along(t: f32) -> [f32; 4] {
    let s = 1.0 - t;
    let inner = |t: f32| (3.0 * t - 6.0) * t * t + 4.0;
    [s * s * s, inner(t), inner(s), t * t * t].map(|v| v / 6.0)
}

/// `1/h ∫ Bᵥ Σⱼ qⱼ Bⱼ` at the vertices v = -2 to 3, with the shares q of -1 to 2.
fn mass(t: f32) -> [f32; 6] {
    let [a, b, c, d] = shares_along(t);
    [a, 4.0 * a + b, a + 4.0 * b + c, b + 4.0 * c + d, c + 4.0 * d, d].map(|v| v / 6.0)
}

/// `∫ B'ᵥ Σⱼ qⱼ Bⱼ` at the same vertices.
fn gradient(t: f32) -> [f32; 6] {
    let [a, b, c, d] = shares_along(t);
    [-0.5 * a, -0.5 * b, 0.5 * (a - c), 0.5 * (b - d), 0.5 * c, 0.5 * d]
}

/// Adds the field of the samples of a depth at its vertices.
pub(super) fn spread(vertices: &Rows, depth: u32, weighted: Weighted, field: &mut Field) {
    for share in weighted.shares(depth) {
        let (cell, inside) = cell_of(share.position, depth);
        let [_, y, z] = cell.map(|v| v.wrapping_sub(1));
        let (x, along_x) = inside_cube(cell[0], 1, 4, vertices.side());
        let [qx, qy, qz] = inside.map(shares_along);
        for (k, qz) in qz.into_iter().enumerate() {
            for (j, qy) in qy.into_iter().enumerate() {
                let (y, z) = (y.wrapping_add(j as u32), z.wrapping_add(k as u32));
                let Some(first) = vertices.find([x, y, z]) else { continue };
                for (axis, values) in field.iter_mut().enumerate() {
                    let value = share.normal[axis] * qy * qz;
                    for (i, target) in along_x.clone().zip(&mut values[first as usize..]) {
                        *target += value * qx[i];
                    }
                }
            }
        }
    }
}

/// The field of a level on the vertices of the next: `V` stays, the side of the cells halves.
pub(super) fn prolong_field(coarse: &Rows, fine: &Rows, field: &Field) -> Field {
    std::array::from_fn(|axis| {
        let mut values = prolong(coarse, fine, &field[axis]);
        values.iter_mut().for_each(|v| *v *= 0.5);
        values
    })
}

/// Adds the divergence of a field at the free vertices of its level.
pub(super) fn add_field_divergence(
    level: &Level,
    free: &FreeRuns,
    field: &Field,
    sums: &mut [f32],
) {
    let planes = level.vertices.planes();
    split_planes(&level.vertices, sums).into_par_iter().enumerate().for_each(|(z, sums)| {
        for run in free.plane(z) {
            // All nine rows, the run's own among them.
            for (dy, dz, first) in rows_around(run) {
                let plane = z.wrapping_add_signed(dz as isize);
                let start = planes[plane] as usize + first as usize - 1;
                let rows = field.each_ref().map(|v| &v[start..][..run.len as usize + 2]);
                let sums = &mut sums[run.first as usize..][..run.len as usize];
                add_row_divergence(dy, dz, rows, sums);
            }
        }
    });
}

fn rows_around(run: &FreeRun) -> impl Iterator<Item = (i32, i32, u32)> {
    let others = NEIGHBORS.iter().zip(run.neighbors).map(|(&(dy, dz), first)| (dy, dz, first));
    others.chain([(0, 0, run.first)])
}

/// What one row of the field adds to a row of sums (dy, dz) away from it: products of
/// `∫B'ᵢBⱼ = ±1/2` and `1/h ∫BᵢBⱼ = 2/3, 1/6`.
fn add_row_divergence(dy: i32, dz: i32, [vx, vy, vz]: [&[f32]; 3], sums: &mut [f32]) {
    let mass = |d: i32| if d == 0 { 2.0 / 3.0 } else { 1.0 / 6.0_f32 };
    // The field's vertex lies after Bᵢ where d > 0: there the slope is negative.
    let slope = |d: i32| -0.5 * d as f32;
    let weights = [mass(dy) * mass(dz), slope(dy) * mass(dz), mass(dy) * slope(dz)];
    for (i, sum) in sums.iter_mut().enumerate() {
        let x = 0.5 * (vx[i] - vx[i + 2]);
        let y = (vy[i] + 4.0 * vy[i + 1] + vy[i + 2]) / 6.0;
        let z = (vz[i] + 4.0 * vz[i + 1] + vz[i + 2]) / 6.0;
        *sum += weights[0] * x + weights[1] * y + weights[2] * z;
    }
}
