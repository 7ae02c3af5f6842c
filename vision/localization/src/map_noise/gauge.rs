//! The similarity that a map leaves open.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Vector3};
use volery_scene::SparseModel;

/// Weight of a rotation error against the motion of a point at the median depth: little, so that it
/// counts only where the centers leave the rotation open.
const ROTATION_WEIGHT: f64 = 0.1;

/// Takes out of the errors of all poses the similarity that fits them best.
pub(super) struct Gauge {
    directions: DMatrix<f64>,
    /// Row weights times directions.
    weighted: DMatrix<f64>,
    normal: Cholesky<f64, Dyn>,
}

impl Gauge {
    /// `depth`: median distance of the points from the images that see them.
    pub(super) fn of(model: &SparseModel, depth: f64) -> Option<Self> {
        let directions = directions(model);
        let mut weighted = directions.clone();
        for (row, mut values) in weighted.row_iter_mut().enumerate() {
            values *= if row % 6 < 3 { (ROTATION_WEIGHT * depth).powi(2) } else { 1.0 };
        }
        let normal = directions.tr_mul(&weighted).cholesky()?;
        Some(Self { directions, weighted, normal })
    }

    /// Orthonormal columns that span the directions.
    pub(super) fn basis(&self) -> DMatrix<f64> {
        self.directions.clone().qr().q()
    }

    /// `(I − G (GᵀWG)⁻¹ GᵀW) e`
    pub(super) fn taken_out_of(&self, errors: DVector<f64>) -> DVector<f64> {
        let fit = self.normal.solve(&self.weighted.tr_mul(&errors));
        errors - &self.directions * fit
    }
}

/// How the left perturbations of the poses move with the similarity of the map, one column per
/// rotation about the middle, translation and scale.
fn directions(model: &SparseModel) -> DMatrix<f64> {
    let n = model.images.len();
    let middle = model.images.values().map(|i| i.center().coords).sum::<Vector3<f64>>() / n as f64;
    let mut gauge = DMatrix::zeros(6 * n, 7);
    for (index, image) in model.images.values().enumerate() {
        let r = image.cam_from_world.rotation.to_rotation_matrix().into_inner();
        let t = image.cam_from_world.translation.vector + r * middle;
        let row = 6 * index;
        gauge.fixed_view_mut::<3, 3>(row, 0).copy_from(&-r);
        gauge.fixed_view_mut::<3, 3>(row + 3, 0).copy_from(&-(t.cross_matrix() * r));
        gauge.fixed_view_mut::<3, 3>(row + 3, 3).copy_from(&-r);
        gauge.fixed_view_mut::<3, 1>(row + 3, 6).copy_from(&t);
    }
    gauge
}
