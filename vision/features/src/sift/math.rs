//! Elementary functions that the compiler can widen.

use std::f32::consts::{FRAC_1_SQRT_2, FRAC_PI_2, LN_2, LOG2_E, PI};

/// e⁻ᵗ for t ≥ 0, relative error below 2e-5.
#[inline(always)]
pub(super) fn exp_negative(t: f32) -> f32 {
    let t = t * LOG2_E;
    let t = if t < 120.0 { t } else { 120.0 };
    let whole = t as i32;
    // 2⁻ᶠ by its Taylor series about ½.
    let f = 0.5 - (t - whole as f32);
    let x = f * LN_2;
    let series = 1.0 + x * (1.0 + x * (0.5 + x * (1.0 / 6.0 + x * (1.0 / 24.0 + x / 120.0))));
    series * FRAC_1_SQRT_2 * f32::from_bits(((127 - whole) << 23) as u32)
}

/// Direction of `(x, y)` in (-π, π], error below 1e-5; 0 for the zero vector.
#[inline(always)]
pub(super) fn atan2(y: f32, x: f32) -> f32 {
    let (ax, ay) = (x.abs(), y.abs());
    let (small, large) = if ax < ay { (ax, ay) } else { (ay, ax) };
    let large = if large > f32::MIN_POSITIVE { large } else { f32::MIN_POSITIVE };
    let t = small / large;
    let s = t * t;
    // Minimax polynomial of atan(t)/t on [0, 1] (Abramowitz and Stegun 4.4.49).
    let p = -0.085_133 + s * 0.020_835_1;
    let p = 0.180_141 + s * p;
    let p = -0.330_299_5 + s * p;
    let angle = t * (0.999_866 + s * p);
    let angle = if ax < ay { FRAC_PI_2 - angle } else { angle };
    let angle = if x < 0.0 { PI - angle } else { angle };
    if y < 0.0 { -angle } else { angle }
}

#[cfg(test)]
mod tests {
    use std::f32::consts::TAU;

    use super::*;

    #[test]
    fn exponential_and_arc_tangent_are_near_the_exact_ones() {
        for i in 0..4000 {
            let t = i as f32 * 0.01;
            let exact = (-t).exp();
            assert!((exp_negative(t) - exact).abs() <= 2e-5 * exact, "e^-{t}");
            let angle = (i as f32 * TAU / 4000.0) - 0.999 * PI;
            let (y, x) = angle.sin_cos();
            let error = (atan2(2.0 * y, 2.0 * x) - y.atan2(x)).abs();
            assert!(error.min(TAU - error) < 2e-5, "{angle}");
        }
        assert_eq!(atan2(0.0, 0.0), 0.0);
    }
}
