//! The reduced system of a bundle adjustment over all poses, dense.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt;
use faer::{MatMut, Par};
use nalgebra::{DMatrix, Matrix3, Matrix6, Matrix6x3};

use super::Sighting;

/// `S = Σ JᵀJ − Σₚ Wₚ Hₚ⁻¹ Wₚᵀ`: information of the poses with the points eliminated, per square
/// pixel.
pub(super) struct ReducedSystem {
    pub(super) matrix: DMatrix<f64>,
}

impl ReducedSystem {
    pub(super) fn new(num_images: usize) -> Self {
        Self { matrix: DMatrix::zeros(6 * num_images, 6 * num_images) }
    }

    /// Adds the sightings of a point, `covariance` = `Hₚ⁻¹`.
    pub(super) fn add(&mut self, track: &[Sighting], covariance: &Matrix3<f64>) {
        let mixed: Vec<Matrix6x3<f64>> =
            track.iter().map(|s| s.at.by_pose.tr_mul(&s.at.by_point)).collect();
        for (a, mixed_a) in track.iter().zip(&mixed) {
            self.block_mut(a, a, &a.at.by_pose.tr_mul(&a.at.by_pose));
            let gain = mixed_a * covariance;
            for (b, mixed_b) in track.iter().zip(&mixed) {
                self.block_mut(a, b, &-(gain * mixed_b.transpose()));
            }
        }
    }

    fn block_mut(&mut self, a: &Sighting, b: &Sighting, block: &Matrix6<f64>) {
        let mut target = self.matrix.fixed_view_mut::<6, 6>(6 * a.image, 6 * b.image);
        target += block;
    }
}

/// The inverse of a positive definite matrix; `None` if it is not one. One thread: kernels that
/// split over threads may add in another order.
pub(super) fn inverse(mut matrix: DMatrix<f64>) -> Option<DMatrix<f64>> {
    let n = matrix.nrows();
    let request = llt::factor::cholesky_in_place_scratch::<f64>(n, Par::Seq, Default::default())
        .or(llt::inverse::inverse_scratch::<f64>(n, Par::Seq));
    let mut memory = MemBuffer::try_new(request).ok()?;
    let stack = MemStack::new(&mut memory);
    let mut factor = MatMut::from_column_major_slice_mut(matrix.as_mut_slice(), n, n);
    llt::factor::cholesky_in_place(
        factor.as_mut(),
        Default::default(),
        Par::Seq,
        stack,
        Default::default(),
    )
    .ok()?;
    let mut result = DMatrix::zeros(n, n);
    let out = MatMut::from_column_major_slice_mut(result.as_mut_slice(), n, n);
    llt::inverse::inverse(out, factor.as_ref(), Par::Seq, stack);
    result.fill_upper_triangle_with_lower_triangle();
    Some(result)
}
