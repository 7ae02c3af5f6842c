//! The cosine transform of blocks.

use std::f32::consts::{FRAC_1_SQRT_2, SQRT_2};

/// The transform of A.3.3 in place, rows and columns one after the other.
///
/// Source: Arai, Agui and Nakajima, "A Fast DCT-SQ Scheme for Images", 1988, with the scale of its
/// results undone.
pub(super) fn forward_dct(block: &mut [f32; 64]) {
    for row in 0..8 {
        transform(block, 8 * row, 1);
    }
    for column in 0..8 {
        transform(block, column, 8);
    }
}

/// Eight numbers from `start`, `step` apart.
fn transform(block: &mut [f32; 64], start: usize, step: usize) {
    // cos(3π/8), cos(π/8) − cos(3π/8), cos(π/8) + cos(3π/8).
    const C6: f32 = 0.382_683_43;
    const C2_MINUS_C6: f32 = 0.541_196_1;
    const C2_PLUS_C6: f32 = 1.306_563;
    let x: [f32; 8] = std::array::from_fn(|i| block[start + i * step]);
    let sum: [f32; 4] = std::array::from_fn(|i| x[i] + x[7 - i]);
    let difference: [f32; 4] = std::array::from_fn(|i| x[i] - x[7 - i]);

    let (a, d) = (sum[0] + sum[3], sum[0] - sum[3]);
    let (b, c) = (sum[1] + sum[2], sum[1] - sum[2]);
    let z = (c + d) * FRAC_1_SQRT_2;
    let even = [a + b, d + z, a - b, d - z];

    let (p, q, r) = (
        difference[3] + difference[2],
        difference[2] + difference[1],
        difference[1] + difference[0],
    );
    let z5 = (p - r) * C6;
    let (z2, z4) = (C2_MINUS_C6 * p + z5, C2_PLUS_C6 * r + z5);
    let z3 = q * FRAC_1_SQRT_2;
    let (z11, z13) = (difference[0] + z3, difference[0] - z3);
    let odd = [z11 + z4, z13 - z2, z13 + z2, z11 - z4];

    for k in 0..8 {
        let value = if k % 2 == 0 { even[k / 2] } else { odd[k / 2] };
        block[start + k * step] = value * SCALES[k];
    }
}

/// 1 / (4 cos(kπ/16)); 1 / (2 √2) for k = 0.
const SCALES: [f32; 8] = [
    0.25 * SQRT_2,
    0.254_897_8,
    0.270_598_05,
    0.300_672_44,
    0.353_553_4,
    0.449_988_1,
    0.653_281_5,
    1.281_457_7,
];

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    /// Against the sum of A.3.3.
    #[test]
    fn fast_and_plain_are_equal() {
        let mut random = volery_geometry::Rng::new(3);
        let block: [f32; 64] = std::array::from_fn(|_| random.range(-128.0, 128.0) as f32);
        let mut fast = block;
        forward_dct(&mut fast);
        for (u, v) in (0..8).flat_map(|v| (0..8).map(move |u| (u, v))) {
            let scale = |k: usize| if k == 0 { 0.5_f64.sqrt() } else { 1.0 };
            let wave = |x: usize, k: usize| ((2 * x + 1) as f64 * k as f64 * PI / 16.0).cos();
            let sum: f64 =
                (0..64).map(|i| f64::from(block[i]) * wave(i % 8, u) * wave(i / 8, v)).sum();
            let truth = 0.25 * scale(u) * scale(v) * sum;
            assert!((f64::from(fast[8 * v + u]) - truth).abs() < 1e-3, "{u} {v}");
        }
    }
}
