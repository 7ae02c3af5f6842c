//! How much the sightings of one track repeat each other.
//!
//! A keypoint lies a little beside its point for reasons that change slowly with the view (edges,
//! shading, the shape of the blob), so that neighboring sightings err alike. Modeled as first-order
//! autoregressive along the track, `Cov(ε_k, ε_l) = σ² ρ^|k−l|`.

use nalgebra::{DMatrix, Matrix3};

use super::Sighting;

/// Shortest track that tells: three of its numbers go into the point.
const MIN_SIGHTINGS: usize = 4;
/// Longest part of a track that is looked at.
const MAX_SIGHTINGS: usize = 24;
/// Fewest tracks that tell.
const MIN_TRACKS: usize = 30;
/// Tracks that are enough.
const MAX_TRACKS: usize = 4000;
/// Candidates for ρ: 0, 1/20, …
const NUM_STEPS: usize = 19;
const STEP: f64 = 0.05;

/// Sums over tracks of products of residuals, and what each ρ lets expect.
pub(super) struct SerialCorrelation {
    num_tracks: usize,
    /// Greatest residual that is looked at, pixels.
    max_residual_px: f64,
    observed: Moments,
    /// For ρ = 0, STEP, …, with σ = 1.
    expected: [Moments; NUM_STEPS],
}

#[derive(Debug, Clone, Copy, Default)]
struct Moments {
    /// Σ r_k · r_k
    same: f64,
    /// Σ r_k · r_{k+1}
    next: f64,
}

impl SerialCorrelation {
    pub(super) fn new(max_residual_px: f64) -> Self {
        Self {
            num_tracks: 0,
            max_residual_px,
            observed: Moments::default(),
            expected: [Moments::default(); NUM_STEPS],
        }
    }

    /// Adds a track in the order of capture, `covariance` = `(Σ JᵀJ)⁻¹` of its point.
    pub(super) fn add(&mut self, track: &[Sighting], covariance: &Matrix3<f64>) {
        let is_useful = (MIN_SIGHTINGS..=MAX_SIGHTINGS).contains(&track.len())
            && self.num_tracks < MAX_TRACKS
            && track.iter().all(|s| s.residual.norm() < self.max_residual_px);
        if !is_useful {
            return;
        }
        self.num_tracks += 1;
        self.observed.same += track.iter().map(|s| s.residual.norm_squared()).sum::<f64>();
        let pairs = track.windows(2).map(|pair| pair[0].residual.dot(&pair[1].residual));
        self.observed.next += pairs.sum::<f64>();
        // r = (I − J (JᵀJ)⁻¹ Jᵀ) ε
        let n = 2 * track.len();
        let mut jacobian = DMatrix::zeros(n, 3);
        for (k, s) in track.iter().enumerate() {
            jacobian.fixed_view_mut::<2, 3>(2 * k, 0).copy_from(&s.at.by_point);
        }
        let remove = DMatrix::identity(n, n) - &jacobian * covariance * jacobian.transpose();
        for (step, expected) in self.expected.iter_mut().enumerate() {
            let rho = step as f64 * STEP;
            let noise = DMatrix::from_fn(n, n, |a, b| {
                if a % 2 == b % 2 { rho.powi((a / 2).abs_diff(b / 2) as i32) } else { 0.0 }
            });
            let left = &remove * noise * &remove;
            expected.same += left.trace();
            expected.next += (0..n - 2).map(|a| left[(a, a + 2)]).sum::<f64>();
        }
    }

    /// ρ, and by how much the residuals of that noise are smaller than those of independent noise,
    /// as a ratio of squares.
    pub(super) fn estimate(&self) -> (f64, f64) {
        if self.num_tracks < MIN_TRACKS {
            return (0.0, 1.0);
        }
        let ratio = |m: &Moments| if m.same > 0.0 { m.next / m.same } else { 0.0 };
        let observed = ratio(&self.observed);
        let step = self.expected.iter().rposition(|e| ratio(e) <= observed).unwrap_or(0);
        let absorbed = self.expected[step].same / self.expected[0].same;
        (step as f64 * STEP, absorbed)
    }
}

/// How much the mean of n such errors varies more than that of independent ones:
/// `1/n Σ_kl ρ^|k−l|`.
pub(super) fn inflation(rho: f64, n: usize) -> f64 {
    let n = n as f64;
    (1.0 + rho) / (1.0 - rho) - 2.0 * rho * (1.0 - rho.powf(n)) / (n * (1.0 - rho).powi(2))
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, Point3, Vector2, Vector3};
    use volery_geometry::{Camera, CameraModel, Rng};

    use super::*;
    use crate::jacobians::linearize;

    /// Tracks of eight views with errors of known correlation, as an adjusted point leaves them.
    fn estimate(rho: f64) -> (f64, f64) {
        let camera =
            Camera::new(CameraModel::Pinhole, 640, 480, &[500.0, 500.0, 320.0, 240.0]).unwrap();
        let mut rng = Rng::new(3);
        let mut correlation = SerialCorrelation::new(f64::INFINITY);
        for _ in 0..600 {
            let point = Point3::from(rng.normal3() + Vector3::z() * 5.0);
            let mut error = Vector2::new(rng.normal(), rng.normal());
            let mut track: Vec<Sighting> = Vec::new();
            for image in 0..8 {
                let fresh = Vector2::new(rng.normal(), rng.normal());
                error = error * rho + fresh * (1.0 - rho * rho).sqrt();
                let center = Vector3::new(0.3 * image as f64, 0.1 * rng.normal(), 0.0);
                let pose = Isometry3::translation(-center.x, -center.y, -center.z);
                let at = linearize(&camera, &pose, &point).unwrap();
                track.push(Sighting { image, at, residual: error });
            }
            let information: Matrix3<f64> =
                track.iter().map(|s| s.at.by_point.tr_mul(&s.at.by_point)).sum();
            let covariance = information.try_inverse().unwrap();
            let pull: Vector3<f64> = track.iter().map(|s| s.at.by_point.tr_mul(&s.residual)).sum();
            let moved = covariance * pull;
            for sighting in &mut track {
                sighting.residual -= sighting.at.by_point * moved;
            }
            correlation.add(&track, &covariance);
        }
        correlation.estimate()
    }

    /// What the point absorbs is given back.
    #[test]
    fn the_correlation_of_errors_is_found_in_residuals() {
        for rho in [0.0, 0.3, 0.6] {
            let (found, absorbed) = estimate(rho);
            assert!((found - rho).abs() <= 0.05 + 1e-9, "{rho}: {found}");
            assert!(absorbed <= 1.0 && (rho == 0.0 || absorbed < 0.95), "{rho}: {absorbed}");
        }
    }

    #[test]
    fn inflation_is_the_sum_of_the_correlations() {
        for n in 1..6_i32 {
            let sum: f64 =
                (0..n).flat_map(|k| (0..n).map(move |l| 0.4_f64.powi((k - l).abs()))).sum();
            assert!((inflation(0.4, n as usize) - sum / f64::from(n)).abs() < 1e-12);
        }
        assert_eq!(inflation(0.0, 5), 1.0);
    }
}
