//! Camera centers and points from rotations and tracks, all at once.

use std::ops::Range;

use nalgebra::{Matrix3, Point3, Unit, Vector3};
use volery_cholesky::DenseCholesky;

/// Residual beyond which the Huber loss turns linear; a ray's length is 1.
const HUBER_SCALE: f64 = 0.1;
/// Least inverse depth: keeps points in front of their cameras.
const MIN_INVERSE_DEPTH: f64 = 1e-6;
const INITIAL_DAMPING: f64 = 1e-3;
const MAX_DAMPING: f64 = 1e10;

/// A point seen along a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RayObservation {
    /// Index of the image.
    pub image: usize,
    /// Index of the point.
    pub point: usize,
    /// From the center of the image towards the point.
    pub ray_in_world: Unit<Vector3<f64>>,
}

/// Where to start and when to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PositioningOptions {
    /// Bound on Levenberg–Marquardt steps.
    pub max_iterations: usize,
    /// Stop when a step lowers the cost by less than this part.
    pub cost_tolerance: f64,
}

impl Default for PositioningOptions {
    fn default() -> Self {
        Self { max_iterations: 150, cost_tolerance: 1e-6 }
    }
}

/// Centers and points in a frame of arbitrary origin and scale.
#[derive(Debug, Clone, PartialEq)]
pub struct Positions {
    /// Of every image.
    pub centers: Vec<Point3<f64>>,
    /// Of every point.
    pub points: Vec<Point3<f64>>,
}

/// Minimizes over centers `c`, points `X` and inverse depths `d ≥ 0` of the observations
///
/// ```text
/// Σ ρ(‖ v − d (X − c) ‖)
/// ```
///
/// with rays `v` of unit length and Huber's ρ, by Levenberg–Marquardt from `start`, in place.
/// `d` and `X` are eliminated. The residual is bounded and bilinear, so that random starts come
/// home and wrong tracks do little harm. Observations must be sorted by point. Returns the final
/// cost per observation.
///
/// Source: Pan, Baráth, Pollefeys & Schönberger, "Global Structure-from-Motion Revisited", ECCV
/// 2024, eq. (3).
pub fn position_globally(
    start: &mut Positions,
    observations: &[RayObservation],
    options: &PositioningOptions,
) -> f64 {
    let mut solver = Solver::new(start, observations);
    let mut cost = solver.cost(&solver.values);
    let (mut damping, mut growth) = (INITIAL_DAMPING, 2.0);
    for _ in 0..options.max_iterations {
        if damping > MAX_DAMPING {
            break;
        }
        let candidate = solver.step(damping);
        let candidate_cost = candidate.as_ref().map_or(f64::INFINITY, |c| solver.cost(c));
        match candidate {
            Some(candidate) if candidate_cost < cost => {
                solver.values = candidate;
                damping = (damping / 3.0).max(1e-9);
                growth = 2.0;
                let is_done = cost - candidate_cost < options.cost_tolerance * cost;
                cost = candidate_cost;
                if is_done {
                    break;
                }
            }
            _ => {
                damping *= growth;
                growth *= 2.0;
            }
        }
    }
    *start = solver.values.positions;
    cost / observations.len().max(1) as f64
}

#[derive(Clone)]
struct Values {
    positions: Positions,
    inverse_depths: Vec<f64>,
}

struct Solver<'a> {
    observations: &'a [RayObservation],
    /// Observations of one point each.
    tracks: Vec<Range<usize>>,
    values: Values,
}

/// One observation with its inverse depth eliminated: `δᵀ M δ / 2 + gᵀ δ` over `δ = δX − δc`.
struct Reduced {
    m: Matrix3<f64>,
    gradient: Vector3<f64>,
}

fn huber(norm: f64) -> f64 {
    if norm <= HUBER_SCALE { 0.5 * norm * norm } else { HUBER_SCALE * (norm - 0.5 * HUBER_SCALE) }
}

impl<'a> Solver<'a> {
    fn new(start: &Positions, observations: &'a [RayObservation]) -> Self {
        let best_inverse_depth = |o: &RayObservation| {
            let b = start.points[o.point] - start.centers[o.image];
            (o.ray_in_world.dot(&b) / b.norm_squared().max(1e-12)).max(MIN_INVERSE_DEPTH)
        };
        let mut first = 0;
        let tracks = observations
            .chunk_by(|a, b| a.point == b.point)
            .map(|of_point| {
                first += of_point.len();
                first - of_point.len()..first
            })
            .collect();
        Self {
            observations,
            tracks,
            values: Values {
                positions: start.clone(),
                inverse_depths: observations.iter().map(best_inverse_depth).collect(),
            },
        }
    }

    fn cost(&self, values: &Values) -> f64 {
        self.observations
            .iter()
            .zip(&values.inverse_depths)
            .map(|(o, d)| {
                let b = values.positions.points[o.point] - values.positions.centers[o.image];
                huber((o.ray_in_world.into_inner() - b * *d).norm())
            })
            .sum()
    }

    /// Residual `r = v − d b` with `b = X − c` and weight w: over `(δ, δd)` the model is
    /// `w ‖ r − d δ − b δd ‖²  / 2`.
    fn reduce(&self, index: usize, damping: f64) -> (Reduced, Vector3<f64>, f64, f64) {
        let o = &self.observations[index];
        let d = self.values.inverse_depths[index];
        let b = self.values.positions.points[o.point] - self.values.positions.centers[o.image];
        let r = o.ray_in_world.into_inner() - b * d;
        let norm = r.norm();
        let weight = if norm <= HUBER_SCALE { 1.0 } else { HUBER_SCALE / norm };
        let bb = b.norm_squared().max(1e-12) * (1.0 + damping);
        let m = (Matrix3::identity() - b * b.transpose() / bb) * (weight * d * d);
        // Gradients: by δ −w d r, by δd −w b·r; the latter is folded into the former.
        let gradient = -weight * d * (r - b * (b.dot(&r) / bb));
        (Reduced { m, gradient }, b, b.dot(&r), bb)
    }

    /// One damped Gauss–Newton step.
    fn step(&self, damping: f64) -> Option<Values> {
        let num_images = self.values.positions.centers.len();
        let n = 3 * num_images;
        let mut s = vec![0.0; n * n];
        let mut right = vec![0.0; n];
        let num_points = self.values.positions.points.len();
        let mut points = vec![(Matrix3::zeros(), Vector3::zeros()); num_points];
        let reduced: Vec<Reduced> =
            (0..self.observations.len()).map(|i| self.reduce(i, damping).0).collect();

        for track in &self.tracks {
            let (of_point, reduced) = (&self.observations[track.clone()], &reduced[track.clone()]);
            let mut v: Matrix3<f64> = reduced.iter().map(|r| r.m).sum();
            let gradient: Vector3<f64> = reduced.iter().map(|r| r.gradient).sum();
            let floor = 1e-6 * v.diagonal().max() + 1e-30;
            for axis in 0..3 {
                v[(axis, axis)] += damping * v[(axis, axis)].max(floor) + 1e-9 * floor;
            }
            let Some(inverse) = v.try_inverse() else { continue };
            points[of_point[0].point] = (inverse, gradient);
            // Centers move against the points: columns of W are −M.
            for (o, r) in of_point.iter().zip(reduced) {
                let w_v = r.m * inverse;
                let reduced_gradient = r.gradient - w_v * gradient;
                for axis in 0..3 {
                    right[3 * o.image + axis] += reduced_gradient[axis];
                }
                add_block(&mut s, n, o.image, o.image, &r.m);
                for (other, r2) in of_point.iter().zip(reduced) {
                    if other.image >= o.image {
                        let product = w_v * r2.m;
                        add_block(&mut s, n, other.image, o.image, &-product.transpose());
                    }
                }
            }
        }
        for i in 0..n {
            s[i * n + i] += damping * s[i * n + i].max(1e-12) + 1e-12;
        }
        if !DenseCholesky::new(n)?.solve_in_place(&mut s, &mut right) {
            return None;
        }

        let mut next = self.values.clone();
        for (image, center) in next.positions.centers.iter_mut().enumerate() {
            *center += Vector3::from_column_slice(&right[3 * image..3 * image + 3]);
        }
        let delta_center = |o: &RayObservation| {
            next.positions.centers[o.image] - self.values.positions.centers[o.image]
        };
        for track in &self.tracks {
            let of_point = &self.observations[track.clone()];
            let (inverse, gradient) = &points[of_point[0].point];
            let mut pull = -gradient;
            for (o, r) in of_point.iter().zip(&reduced[track.clone()]) {
                pull += r.m * delta_center(o);
            }
            let delta_point = inverse * pull;
            next.positions.points[of_point[0].point] += delta_point;
            for (offset, o) in of_point.iter().enumerate() {
                let (_, b, b_r, bb) = self.reduce(track.start + offset, damping);
                let d = &mut next.inverse_depths[track.start + offset];
                let delta = delta_point - delta_center(o);
                // b·(r − d δ − b δd) = 0, damped.
                *d = (*d + (b_r - *d * b.dot(&delta)) / bb).max(MIN_INVERSE_DEPTH);
            }
        }
        let is_finite = right.iter().all(|v| v.is_finite());
        is_finite.then_some(next)
    }
}

/// Adds to block (row, column) of a column-major matrix.
fn add_block(s: &mut [f64], n: usize, row: usize, column: usize, block: &Matrix3<f64>) {
    for c in 0..3 {
        for r in 0..3 {
            s[(3 * column + c) * n + 3 * row + r] += block[(r, c)];
        }
    }
}
