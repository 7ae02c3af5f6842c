//! The reduced system of a bundle adjustment over some poses, dense.

use nalgebra::{DMatrix, DVector, Matrix3, Matrix6, Matrix6x3, Vector6};

use super::{Loss, Track};

/// The second and first derivative of the cost by the poses, the points eliminated:
/// `S = Σ AᵀΩA − Σₚ Wₚ Hₚ⁻¹ Wₚᵀ` and `s = Σ Aᵀψ`, with A, B the derivatives of a sighting by pose and
/// point, ψ, Ω those of the loss, `Hₚ = Σ BᵀΩB`, `Wₚ = AᵀΩB`.
pub(super) struct ReducedSystem {
    /// Indices of the images, ascending.
    pub(super) images: Vec<usize>,
    pub(super) hessian: DMatrix<f64>,
    pub(super) gradient: DVector<f64>,
}

impl ReducedSystem {
    /// Over the poses that see one of the tracks.
    pub(super) fn of(tracks: &[&Track], loss: &Loss) -> Self {
        let sightings = tracks.iter().flat_map(|track| &track.sightings);
        let mut images: Vec<usize> = sightings.map(|s| s.image).collect();
        images.sort_unstable();
        images.dedup();
        let n = 6 * images.len();
        let mut system =
            Self { images, hessian: DMatrix::zeros(n, n), gradient: DVector::zeros(n) };
        for track in tracks {
            system.add(track, loss);
        }
        system
    }

    /// The rows of its poses in a system over all poses.
    pub(super) fn rows(&self) -> Vec<usize> {
        self.images.iter().flat_map(|image| 6 * image..6 * image + 6).collect()
    }

    /// A point whose wrong sightings outweigh the others, so that it is at no minimum, is left out.
    fn add(&mut self, track: &Track, loss: &Loss) {
        let mut of_point = Matrix3::zeros();
        let mut of_sightings = Vec::with_capacity(track.sightings.len());
        for sighting in &track.sightings {
            let (first, second) = loss.derivatives(&sighting.residual);
            let (a, b) = (&sighting.at.by_pose, &sighting.at.by_point);
            of_point += b.tr_mul(&(second * b));
            let row = self.images.partition_point(|image| *image < sighting.image) * 6;
            let mixed: Matrix6x3<f64> = a.tr_mul(&(second * b));
            of_sightings.push((row, a.tr_mul(&first), a.tr_mul(&(second * a)), mixed));
        }
        let Some(covariance) = of_point.cholesky().map(|factor| factor.inverse()) else { return };
        for (row, gradient, own, mixed) in &of_sightings {
            self.add_gradient(*row, gradient);
            self.add_block(*row, *row, own);
            let gain = mixed * covariance;
            for (column, _, _, other) in &of_sightings {
                self.add_block(*row, *column, &-(gain * other.transpose()));
            }
        }
    }

    fn add_gradient(&mut self, row: usize, gradient: &Vector6<f64>) {
        let mut target = self.gradient.fixed_rows_mut::<6>(row);
        target += gradient;
    }

    fn add_block(&mut self, row: usize, column: usize, block: &Matrix6<f64>) {
        let mut target = self.hessian.fixed_view_mut::<6, 6>(row, column);
        target += block;
    }
}
