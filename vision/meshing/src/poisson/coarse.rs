//! The coarsest level, solved to the end: the whole cube with natural (Neumann) boundary.

use super::field::Field;
use super::octree::Level;
use super::screen::Screen;

/// The residual that ends the iteration, relative to the right-hand side.
const RELATIVE_RESIDUAL: f64 = 1e-7;
/// More iterations than a grid of 16 cells a side needs.
const MAX_ITERATIONS: usize = 1000;

/// A cell: the indices of its corners (x fastest) and the weights with which its sample sees them.
struct Element {
    corners: [usize; 8],
    weights: [f64; 8],
    screening: f64,
}

/// The system of the coarsest level, cell by cell.
pub(super) struct CoarseSystem {
    elements: Vec<Element>,
    num_vertices: usize,
}

impl CoarseSystem {
    /// See [`super::relax`] for the equations; `screening` is α.
    pub(super) fn new(level: &Level, screen: &Screen, screening: f32) -> Self {
        let elements = level.cells.iter().flat_map(|(y, z, run)| {
            (run.begin..run.end).map(move |x| {
                let cell = run.index(x) as usize;
                let corners = std::array::from_fn(|k| {
                    let k = k as u32;
                    let corner = [x + (k & 1), y + (k >> 1 & 1), z + (k >> 2)];
                    level.vertices.find(corner).expect("cells have corners") as usize
                });
                let at = [screen.x[cell], screen.y[cell], screen.z[cell]].map(f64::from);
                let weights = std::array::from_fn(|k| {
                    (0..3).map(|i| if k >> i & 1 == 1 { at[i] } else { 1.0 - at[i] }).product()
                });
                let screening = f64::from(screening) * f64::from(screen.area[cell]);
                Element { corners, weights, screening }
            })
        });
        Self { elements: elements.collect(), num_vertices: level.vertices.len() }
    }

    /// Adds `1/h ∫ ∇Bᵢ·V`.
    pub(super) fn add_divergence(&self, field: &Field, sums: &mut [f32]) {
        for element in &self.elements {
            for (i, &corner) in element.corners.iter().enumerate() {
                for (j, &other) in element.corners.iter().enumerate() {
                    let mass = |axis: usize| {
                        if (i ^ j) >> axis & 1 == 0 { 1.0 / 3.0 } else { 1.0 / 6.0_f32 }
                    };
                    for (axis, values) in field.iter().enumerate() {
                        let slope = if i >> axis & 1 == 1 { 0.5 } else { -0.5 };
                        let mass = mass((axis + 1) % 3) * mass((axis + 2) % 3);
                        sums[corner] += slope * mass * values[other];
                    }
                }
            }
        }
    }

    /// Conjugate gradients from zero.
    pub(super) fn solve(&self, rhs: &[f32]) -> Vec<f32> {
        let mut values = vec![0.0; self.num_vertices];
        let mut residual: Vec<f64> = rhs.iter().map(|&b| f64::from(b)).collect();
        let mut direction = residual.clone();
        let mut norm = dot(&residual, &residual);
        let enough = norm * RELATIVE_RESIDUAL * RELATIVE_RESIDUAL;
        for _ in 0..MAX_ITERATIONS {
            if norm <= enough {
                break;
            }
            let image = self.apply(&direction);
            let step = norm / dot(&direction, &image);
            for i in 0..values.len() {
                values[i] += step * direction[i];
                residual[i] -= step * image[i];
            }
            let previous = norm;
            norm = dot(&residual, &residual);
            for (d, r) in direction.iter_mut().zip(&residual) {
                *d = r + norm / previous * *d;
            }
        }
        values.into_iter().map(|v| v as f32).collect()
    }

    fn apply(&self, values: &[f64]) -> Vec<f64> {
        let mut image = vec![0.0; values.len()];
        for element in &self.elements {
            let u = element.corners.map(|corner| values[corner]);
            let sum: f64 = u.iter().sum();
            let seen = element.screening * (0..8).map(|k| element.weights[k] * u[k]).sum::<f64>();
            for k in 0..8 {
                // Of an element, corners couple by 1/3 (with itself), 0 (nearest), -1/12 (others).
                let nearest = u[k ^ 1] + u[k ^ 2] + u[k ^ 4];
                let stiffness = u[k] / 3.0 - (sum - u[k] - nearest) / 12.0;
                image[element.corners[k]] += stiffness + element.weights[k] * seen;
            }
        }
        image
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
