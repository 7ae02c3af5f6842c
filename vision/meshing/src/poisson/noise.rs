//! How far samples lie off their surface, told from each other, and what that means for the screen.

use super::samples::Samples;

/// Longest way between samples that are compared, in cells.
const MAX_DISTANCE: f32 = 1.0;
/// Standard deviation of a normal distribution relative to the median of its absolute values.
const DEVIATION_PER_MEDIAN: f32 = 1.482_6;
/// What the tents cannot follow between samples that are right, in cells. Measured on round shapes,
/// a room and a warehouse, with and without noise: half of it smooths the thin and the angular of the
/// warehouse away, twice it follows the noise of round shapes.
const MODEL_ERROR: f32 = 0.04;

/// The weight of the screen for samples that lie off their surface by `noise` cells.
///
/// In a least-squares fit samples weigh the inverse of their variance. One that is right differs
/// from the best sum of tents by e = [`MODEL_ERROR`], another one by its noise σ too:
///
/// ```text
/// α(σ) = α(0) e² / (e² + σ²)
/// ```
pub(super) fn screening_under(noise: f32, screening: f32) -> f32 {
    screening / (1.0 + (noise / MODEL_ERROR).powi(2))
}

/// Standard deviation of the samples off the surface, in cells of their depth.
///
/// Samples p, q with unit normals m, n differ along the mean normal by `(p − q)·(m + n)/2`. On a
/// smooth surface without noise that vanishes up to third order in their distance, as a chord of a
/// circle is perpendicular to the mean of the normals at its ends; noise σ of both makes it √2 σ.
/// The median of neighbors along the Morton curve does not see edges.
pub(super) fn noise_in_cells(samples: &Samples, depths: &[f32]) -> f32 {
    let offset = |i: usize| {
        let step: [f32; 3] =
            std::array::from_fn(|k| samples.positions[i + 1][k] - samples.positions[i][k]);
        let cells = depths[i].exp2();
        let along = |normal: &[f32; 3]| (0..3).map(|k| step[k] * normal[k]).sum::<f32>();
        let distance = along(&step).sqrt() * cells;
        let off = 0.5 * (along(&samples.normals[i]) + along(&samples.normals[i + 1])) * cells;
        (distance > 0.0 && distance <= MAX_DISTANCE).then_some(off.abs())
    };
    let mut offsets: Vec<f32> = (0..samples.len() - 1).filter_map(offset).collect();
    if offsets.is_empty() {
        return 0.0;
    }
    let middle = offsets.len() / 2;
    let (_, median, _) = offsets.select_nth_unstable_by(middle, f32::total_cmp);
    DEVIATION_PER_MEDIAN * *median * std::f32::consts::FRAC_1_SQRT_2
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_shapes::{sphere, torus, with_noise};

    /// Per unit of the cloud: `depths` are of cells of side 1/64 of the cube.
    fn noise_of(cloud: &volery_scene::PointCloud) -> f64 {
        let samples = Samples::from_cloud(cloud).unwrap();
        let depths = vec![6.0; samples.len()];
        f64::from(noise_in_cells(&samples, &depths)) * samples.cube.side / 64.0
    }

    #[test]
    fn noise_is_told_from_curvature() {
        let sigma = 0.004;
        for cloud in [sphere(60_000, 1), torus(60_000, 1.0, 2)] {
            assert!(noise_of(&cloud) < 0.05 * sigma, "{}", noise_of(&cloud));
            let found = noise_of(&with_noise(cloud, sigma, 3));
            assert!((found / sigma - 1.0).abs() < 0.15, "{found}");
        }
    }

    #[test]
    fn a_noisy_sample_weighs_less() {
        assert_eq!(screening_under(0.0, 8.0), 8.0);
        assert_eq!(screening_under(MODEL_ERROR, 16.0), 8.0);
        assert!(screening_under(1.0, 16.0) < 0.1);
    }
}
