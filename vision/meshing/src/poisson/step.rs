//! The step that χ makes across the surface, and what tents make of it.

use super::octree::BASE_DEPTH;

/// Variance of what spreads a sample, in squared cells of its depth: 1/3 of the cubic B-spline that
/// shares it among vertices, 1/6 of the tents there.
const SPREAD_VARIANCE: f32 = 0.5;

/// Variance of what spreads a sample of a fractional depth, in the unit cube.
pub(super) fn spread_variance(depth: f32) -> f32 {
    let coarser = depth.floor().max(BASE_DEPTH as f32);
    let finer_part = (depth - coarser).max(0.0);
    SPREAD_VARIANCE * (-2.0 * coarser).exp2() * (1.0 - 0.75 * finer_part)
}

/// What a sum of tents says at a point of the surface if it is right at the corners of the cell.
///
/// Along the normal n at the point p, χ is the distribution function Φ of what spreads the samples:
///
/// ```text
/// τ = Σₖ Nₖ(p) Φ(n·(xₖ − p)),   Φ(0) = 0
/// ```
///
/// over the corners x with their trilinear weights N. Φ is curved off the surface: τ is 0 where p
/// lies in the middle of the cell, and up to 0.03 cells times the slope of χ elsewhere.
///
/// * `inside`: p in the cell, 0 to 1.
/// * `normal`: n, or the mean of several; the more they differ, the smaller τ.
/// * `variance`: that of Φ, in squared cells.
pub(super) fn tents_on_step(inside: [f32; 3], normal: [f32; 3], variance: f32) -> f32 {
    let per_deviation = variance.sqrt().recip();
    let corner = |k: usize| {
        let (mut weight, mut distance) = (1.0, 0.0);
        for axis in 0..3 {
            let step = (k >> axis & 1) as f32 - inside[axis];
            weight *= 1.0 - step.abs();
            distance += step * normal[axis];
        }
        weight * normal_distribution(distance * per_deviation)
    };
    (0..8).map(corner).sum()
}

/// Φ(x) − 1/2, to 2e-4.
fn normal_distribution(x: f32) -> f32 {
    /// √(2/π), so that the slope at 0 is right.
    const LINEAR: f32 = 0.797_884_6;
    /// Least greatest error.
    const CUBIC: f32 = 0.044_715 * LINEAR;
    0.5 * (x * (LINEAR + CUBIC * x * x)).tanh()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sums of the density, by the midpoint rule.
    fn integrated(x: f32) -> f64 {
        let step = f64::from(x) / 1000.0;
        let density = |t: f64| (-0.5 * t * t).exp() / (2.0 * std::f64::consts::PI).sqrt();
        (0..1000).map(|i| step * density((f64::from(i) + 0.5) * step)).sum()
    }

    #[test]
    fn the_distribution_is_the_integral_of_its_density() {
        for i in -40..=40 {
            let x = 0.1 * i as f32;
            assert!((f64::from(normal_distribution(x)) - integrated(x)).abs() < 3e-4, "{x}");
        }
    }

    /// In one dimension the sum has two terms.
    #[test]
    fn a_step_across_an_axis_is_interpolated_along_it() {
        let deviation = SPREAD_VARIANCE.sqrt();
        for t in [0.0, 0.1, 0.3, 0.5, 0.8, 1.0] {
            let said = tents_on_step([0.7, t, 0.2], [0.0, -1.0, 0.0], SPREAD_VARIANCE);
            let expected = f64::from(1.0 - t) * integrated(t / deviation)
                - f64::from(t) * integrated((1.0 - t) / deviation);
            assert!((f64::from(said) - expected).abs() < 3e-4, "{t}: {said} {expected}");
        }
    }

    /// Tents hold what is linear, and a step much wider than the cell is linear in it.
    #[test]
    fn tents_follow_a_wide_step() {
        let normal = [0.48, 0.6, 0.64];
        assert!(tents_on_step([0.2, 0.9, 0.4], normal, 400.0).abs() < 1e-5);
        assert!(tents_on_step([0.2, 0.9, 0.4], normal, 0.5).abs() > 1e-3);
    }

    #[test]
    fn the_spread_halves_with_the_depth() {
        assert_eq!(spread_variance(6.0), 4.0 * spread_variance(7.0));
        assert!((spread_variance(6.999_9) / spread_variance(7.0) - 1.0).abs() < 1e-3);
    }
}
