//! Gauss-Seidel sweeps over the free vertices of a level.
//!
//! Row i of the system, divided by the side h of the cells, is
//!
//! ```text
//! Σⱼ Kᵢⱼ uⱼ + α Σ_c a_c N_c,ᵢ (N_c · u) = bᵢ
//! ```
//!
//! with the stiffness K of trilinear elements (8/3 at the vertex, 0 at the 6 nearest, -1/6 at the
//! 12 next, -1/12 at the 8 farthest), and per cell c its mean sample of area a_c, at which the 8
//! corners have the weights N_c. b holds the divergence of V and α Σ a_c N_c,ᵢ τ_c.

use rayon::prelude::*;

use super::free::{CELLS, FreeRun, FreeRuns, NEIGHBORS};
use super::octree::Level;
use super::screen::Screen;
use super::transfer::split_planes;

/// The stiffness at the vertex itself.
const DIAGONAL: f32 = 8.0 / 3.0;

/// The system of one level.
#[derive(Clone, Copy)]
pub(super) struct System<'a> {
    pub(super) level: &'a Level,
    pub(super) free: &'a FreeRuns,
    pub(super) screen: &'a Screen,
    /// α.
    pub(super) screening: f32,
    /// b.
    pub(super) rhs: &'a [f32],
}

impl System<'_> {
    /// One sweep: the even planes, then the odd ones. Within a parity the planes do not touch each
    /// other, so that their order, and the number of threads, do not matter.
    pub(super) fn sweep(self, values: &mut [f32]) {
        for parity in 0..2 {
            let mut passive: Vec<&[f32]> = Vec::new();
            let mut active: Vec<(usize, &mut [f32])> = Vec::new();
            for (z, plane) in split_planes(&self.level.vertices, values).into_iter().enumerate() {
                if z % 2 == parity {
                    active.push((z, plane));
                    passive.push(&[]);
                } else {
                    passive.push(plane);
                }
            }
            let last = passive.len() - 1;
            active.into_par_iter().filter(|&(z, _)| 0 < z && z < last).for_each_init(
                Row::default,
                |row, (z, plane)| {
                    let start = self.level.vertices.planes()[z] as usize;
                    let rhs = &self.rhs[start..][..plane.len()];
                    for run in self.free.plane(z) {
                        self.relax_run(run, passive[z - 1], plane, passive[z + 1], rhs, row);
                    }
                },
            );
        }
    }

    fn relax_run(
        self,
        run: &FreeRun,
        below: &[f32],
        plane: &mut [f32],
        above: &[f32],
        rhs: &[f32],
        row: &mut Row,
    ) {
        let (first, len) = (run.first as usize, run.len as usize);
        // Neighbor rows from the vertex before the run to the one after it.
        let neighbor = |k: usize| {
            let source = match NEIGHBORS[k].1 {
                -1 => below,
                0 => &*plane,
                _ => above,
            };
            &source[run.neighbors[k] as usize - 1..][..len + 2]
        };
        let rows: [&[f32]; 8] = std::array::from_fn(neighbor);
        row.gather(&rhs[first..][..len], rows);
        if run.screened {
            row.screen(run, self.screen, self.screening, rows);
            let u = &mut plane[first - 1..][..len + 2];
            for i in 0..len {
                let sum = row.sums[i]
                    - row.low_high[i] * u[i]
                    - row.low_high[i + 1] * u[i + 2]
                    - row.of_high[i]
                    - row.of_low[i + 1];
                u[i + 1] = sum / (DIAGONAL + row.high_high[i] + row.low_low[i + 1]);
            }
        } else {
            for (u, sum) in plane[first..][..len].iter_mut().zip(&row.sums) {
                *u = sum * (1.0 / DIAGONAL);
            }
        }
    }
}

/// Sums along one run; kept between runs to save allocations.
#[derive(Default)]
struct Row {
    /// Per vertex, b less the stiffness of the other rows.
    sums: Vec<f32>,
    /// Per cell column of the run, what the screen of its four cells couples: the corner at lower
    /// x with itself, with the one at higher x, and that with itself.
    low_low: Vec<f32>,
    low_high: Vec<f32>,
    high_high: Vec<f32>,
    /// What the values of the other rows add to the equations of both corners.
    of_low: Vec<f32>,
    of_high: Vec<f32>,
}

impl Row {
    fn gather(&mut self, rhs: &[f32], rows: [&[f32]; 8]) {
        let len = rhs.len();
        let [a, b, c, d, e, f, g, h] = rows.map(|row| &row[..len + 2]);
        self.sums.clear();
        self.sums.extend((0..len).map(|i| {
            let corners =
                (a[i] + a[i + 2]) + (c[i] + c[i + 2]) + (f[i] + f[i + 2]) + (h[i] + h[i + 2]);
            let middles = a[i + 1] + c[i + 1] + f[i + 1] + h[i + 1];
            let sides =
                (b[i] + b[i + 2]) + (d[i] + d[i + 2]) + (e[i] + e[i + 2]) + (g[i] + g[i + 2]);
            rhs[i] + corners * (1.0 / 12.0) + (middles + sides) * (1.0 / 6.0)
        }));
    }

    fn screen(&mut self, run: &FreeRun, screen: &Screen, screening: f32, rows: [&[f32]; 8]) {
        let len = run.len as usize + 1;
        for values in [
            &mut self.low_low,
            &mut self.low_high,
            &mut self.high_high,
            &mut self.of_low,
            &mut self.of_high,
        ] {
            values.clear();
            values.resize(len, 0.0);
        }
        let row_at = |dy: i32, dz: i32| {
            let k = NEIGHBORS.iter().position(|&at| at == (dy, dz)).unwrap_or(0);
            &rows[k][..len + 1]
        };
        for (first, (dy, dz)) in run.cells.into_iter().zip(CELLS) {
            let cells = first as usize..first as usize + len;
            let (x, y, z) =
                (&screen.x[cells.clone()], &screen.y[cells.clone()], &screen.z[cells.clone()]);
            let area = &screen.area[cells];
            let (beside, over, across) = (row_at(dy, 0), row_at(0, dz), row_at(dy, dz));
            for i in 0..len {
                if area[i] == 0.0 {
                    continue;
                }
                // Weights of this row's y and z at the sample.
                let wy = if dy < 0 { y[i] } else { 1.0 - y[i] };
                let wz = if dz < 0 { z[i] } else { 1.0 - z[i] };
                let (high, low) = (x[i], 1.0 - x[i]);
                let others = low
                    * ((1.0 - wy) * (wz * beside[i] + (1.0 - wz) * across[i])
                        + wy * (1.0 - wz) * over[i])
                    + high
                        * ((1.0 - wy) * (wz * beside[i + 1] + (1.0 - wz) * across[i + 1])
                            + wy * (1.0 - wz) * over[i + 1]);
                let own = wy * wz;
                let weight = screening * area[i] * own;
                self.low_low[i] += weight * own * low * low;
                self.low_high[i] += weight * own * low * high;
                self.high_high[i] += weight * own * high * high;
                self.of_low[i] += weight * low * others;
                self.of_high[i] += weight * high * others;
            }
        }
    }
}
