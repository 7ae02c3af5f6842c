//! A position from distances to beacons.

use nalgebra::{Matrix2, Matrix3, Point2, Point3, Vector2};

use super::Range;

/// Beacons whose spread across their line is less than this part of that along it are on a line.
const LINE: f64 = 0.05;
/// Gauss-Newton converges slowly where noisy circles do not meet.
const MAX_ITERATIONS: usize = 200;

/// Where a vehicle is in the plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HorizontalFix {
    /// Position in the map.
    pub position: Point2<f64>,
    /// Its covariance. Square meters.
    pub covariance: Matrix2<f64>,
}

/// Where a vehicle is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fix {
    /// Position in the map.
    pub position: Point3<f64>,
    /// Its covariance. Square meters.
    pub covariance: Matrix3<f64>,
}

/// Why there is no position.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum FixError {
    /// Two circles meet twice.
    #[error("a position needs at least 3 ranges, got {got}")]
    TooFewRanges {
        /// How many there are.
        got: usize,
    },
    /// A mirror image explains the ranges as well.
    #[error("the beacons stand on a line")]
    Collinear,
    /// A number is infinite or NaN, or a distance or deviation is not positive.
    #[error("a range is not a positive finite number")]
    NotFinite,
    /// No position explains the ranges.
    #[error("no position was found")]
    NotConverged,
}

impl FixError {
    /// Stable name for programs.
    pub fn code(self) -> &'static str {
        match self {
            Self::TooFewRanges { .. } => "too_few_ranges",
            Self::Collinear => "beacons_collinear",
            Self::NotFinite => "not_finite",
            Self::NotConverged => "not_converged",
        }
    }
}

/// The position at the height `z` that explains the ranges best.
///
/// Minimizes over `x`, `y`
///
/// ```text
/// Σᵢ (‖p − bᵢ‖ − dᵢ)² / σᵢ²,   p = (x, y, z)
/// ```
///
/// * `ranges`: at least three, to beacons that do not stand on a line.
/// * Returns the position and `(Jᵀ W J)⁻¹`, the covariance if the deviations are true.
///
/// The start is the linear solution of the differences of squared ranges (the radical lines of the
/// circles), the rest Gauss-Newton with step halving.
///
/// # Errors
///
/// [`FixError`]: too few or bad ranges, beacons on a line, no minimum found.
pub fn trilaterate(ranges: &[Range], z: f64) -> Result<HorizontalFix, FixError> {
    if ranges.len() < 3 {
        return Err(FixError::TooFewRanges { got: ranges.len() });
    }
    let positive = |v: f64| v.is_finite() && v > 0.0;
    let valid = |r: &Range| {
        positive(r.distance) && positive(r.sigma) && r.beacon.iter().all(|v| v.is_finite())
    };
    if !z.is_finite() || !ranges.iter().all(valid) {
        return Err(FixError::NotFinite);
    }
    let mut position = linear_fix(ranges, z)?;
    let mut cost = cost_of(ranges, &position, z);
    for _ in 0..MAX_ITERATIONS {
        let (information, gradient) = normal_equations(ranges, &position, z);
        let step = information.try_inverse().ok_or(FixError::NotConverged)? * gradient;
        if !step.norm().is_finite() {
            return Err(FixError::NotConverged);
        }
        let mut length = 1.0;
        let (next, next_cost) = loop {
            let next = position - step * length;
            let next_cost = cost_of(ranges, &next, z);
            if next_cost <= cost || length < 1e-6 {
                break (next, next_cost);
            }
            length *= 0.5;
        };
        let moved = (next - position).norm();
        (position, cost) = (next, next_cost.min(cost));
        if moved < 1e-6 {
            let covariance = normal_equations(ranges, &position, z)
                .0
                .try_inverse()
                .ok_or(FixError::NotConverged)?;
            return Ok(HorizontalFix { position, covariance });
        }
    }
    Err(FixError::NotConverged)
}

/// A height over the floor measured by light straight down, with a position in the plane.
///
/// * `floor`: height of the floor in the map. What stands on it, the sensor cannot tell from it.
/// * `down`, `sigma`: measured distance and its deviation. Meters.
///
/// # Errors
///
/// [`FixError::NotFinite`].
pub fn with_height(
    fix: &HorizontalFix,
    floor: f64,
    down: f64,
    sigma: f64,
) -> Result<Fix, FixError> {
    if !(floor.is_finite() && down.is_finite() && down >= 0.0 && sigma.is_finite() && sigma > 0.0) {
        return Err(FixError::NotFinite);
    }
    let mut covariance = Matrix3::zeros();
    covariance.fixed_view_mut::<2, 2>(0, 0).copy_from(&fix.covariance);
    covariance[(2, 2)] = sigma * sigma;
    let position = Point3::new(fix.position.x, fix.position.y, floor + down);
    Ok(Fix { position, covariance })
}

/// Weighted least squares of `2 (bᵢ − b̄)ᵀ p = …`, from the squared horizontal ranges `ρᵢ² = dᵢ² −
/// (z − zᵢ)²` less their mean.
fn linear_fix(ranges: &[Range], z: f64) -> Result<Point2<f64>, FixError> {
    let n = ranges.len() as f64;
    let mean = ranges.iter().map(|r| r.beacon.xy().coords).sum::<Vector2<f64>>() / n;
    let offset = |r: &Range| r.beacon.xy().coords - mean;
    let scatter: Matrix2<f64> = ranges.iter().map(|r| offset(r) * offset(r).transpose()).sum();
    let spread = scatter.symmetric_eigenvalues();
    if spread.min() <= LINE * LINE * spread.max() {
        return Err(FixError::Collinear);
    }
    // ‖q − oᵢ‖² = ρᵢ² with q = p − b̄; summed against oᵢ, ‖q‖² drops out.
    let right: Vector2<f64> = ranges
        .iter()
        .map(|r| {
            let squared = r.distance.powi(2) - (z - r.beacon.z).powi(2);
            offset(r) * (0.5 * (offset(r).norm_squared() - squared))
        })
        .sum();
    let inverse = scatter.try_inverse().ok_or(FixError::Collinear)?;
    Ok(Point2::from(mean + inverse * right))
}

fn residual(range: &Range, position: &Point2<f64>, z: f64) -> (f64, Vector2<f64>) {
    let apart = Point3::new(position.x, position.y, z) - range.beacon;
    let distance = apart.norm().max(1e-9);
    ((distance - range.distance) / range.sigma, apart.xy() / (distance * range.sigma))
}

fn cost_of(ranges: &[Range], position: &Point2<f64>, z: f64) -> f64 {
    ranges.iter().map(|range| residual(range, position, z).0.powi(2)).sum()
}

/// `Jᵀ W J` and `Jᵀ W r`.
fn normal_equations(
    ranges: &[Range],
    position: &Point2<f64>,
    z: f64,
) -> (Matrix2<f64>, Vector2<f64>) {
    let zero = (Matrix2::zeros(), Vector2::zeros());
    ranges.iter().fold(zero, |(information, gradient), range| {
        let (r, j) = residual(range, position, z);
        (information + j * j.transpose(), gradient + j * r)
    })
}

#[cfg(test)]
mod tests;
