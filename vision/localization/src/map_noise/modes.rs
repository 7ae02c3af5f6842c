//! From the reduced system to the covariance of the poses, as a few shared modes.

use nalgebra::{DMatrix, DVector, Matrix6, Vector3, Vector6};
use volery_geometry::median;
use volery_scene::SparseModel;

use super::PoseNoise;
use super::reduced::{ReducedSystem, inverse};

/// Modes kept: what they leave over is kept per image.
const MAX_MODES: usize = 768;
/// Weight of a rotation error against the motion of a point at the median depth, where the gauge is
/// fitted: little, so that it counts only where the centers leave the rotation open.
const ROTATION_WEIGHT: f64 = 0.1;
/// Information that holds the gauge, relative to the greatest.
const GAUGE_HOLD: f64 = 1e-3;

pub(super) fn pose_noise(
    model: &SparseModel,
    reduced: ReducedSystem,
    sigma_px: f64,
) -> Vec<PoseNoise> {
    let n = model.images.len();
    let unknown = || vec![PoseNoise { shared: Vec::new(), own: Matrix6::zeros() }; n];
    if reduced.matrix.is_empty() {
        return unknown();
    }
    let Some(depth) = median_depth(model) else { return unknown() };
    let Some(covariance) = pose_covariance(model, reduced, depth) else { return unknown() };
    factored(covariance * (sigma_px * sigma_px), depth)
}

/// `P S⁺ Pᵀ`, per square pixel, where P takes out the similarity that fits best.
fn pose_covariance(
    model: &SparseModel,
    reduced: ReducedSystem,
    depth: f64,
) -> Option<DMatrix<f64>> {
    let gauge = gauge_directions(model);
    let mut held = reduced.matrix;
    let hold = GAUGE_HOLD * held.diagonal().max();
    let basis = gauge.clone().qr().q();
    held.gemm(hold, &basis, &basis.transpose(), 1.0);
    let covariance = inverse(held)?;
    // P = I − G (GᵀWG)⁻¹ GᵀW
    let mut weighted = gauge.clone();
    for (row, mut values) in weighted.row_iter_mut().enumerate() {
        values *= if row % 6 < 3 { (ROTATION_WEIGHT * depth).powi(2) } else { 1.0 };
    }
    let fit = gauge.tr_mul(&weighted).cholesky()?.solve(&weighted.transpose());
    let fitted = &fit * &covariance;
    let both = &fitted * fit.transpose();
    let cross = &gauge * fitted;
    Some(covariance - &cross - cross.transpose() + &gauge * both * gauge.transpose())
}

/// How the left perturbations of the poses move with the similarity of the map, one column per
/// rotation about the middle, translation and scale.
fn gauge_directions(model: &SparseModel) -> DMatrix<f64> {
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

/// Cholesky factorization with pivots, broken off: `Σ = L Lᵀ + rest`, the rest positive
/// semidefinite, of which the blocks on the diagonal are kept.
fn factored(mut rest: DMatrix<f64>, depth: f64) -> Vec<PoseNoise> {
    let unknowns = rest.nrows();
    // Radians count as the way that a point at the median depth goes.
    let weight = |row: usize| if row % 6 < 3 { depth * depth } else { 1.0 };
    let mut modes: Vec<DVector<f64>> = Vec::new();
    while modes.len() < MAX_MODES.min(unknowns) {
        let share = |row: usize| rest[(row, row)] * weight(row);
        let Some(pivot) = (0..unknowns).max_by(|&a, &b| share(a).total_cmp(&share(b))) else {
            break;
        };
        if rest[(pivot, pivot)] <= 0.0 {
            break;
        }
        let mode: DVector<f64> = rest.column(pivot) / rest[(pivot, pivot)].sqrt();
        rest.ger(-1.0, &mode, &mode, 1.0);
        modes.push(mode);
    }
    (0..unknowns / 6)
        .map(|image| {
            let of_image =
                |mode: &DVector<f64>| Vector6::from_fn(|r, _| mode[6 * image + r] as f32);
            let own = rest.fixed_view::<6, 6>(6 * image, 6 * image).into_owned();
            PoseNoise {
                shared: modes.iter().map(of_image).collect(),
                own: ((own + own.transpose()) * 0.5).map(|v| v as f32),
            }
        })
        .collect()
}

fn median_depth(model: &SparseModel) -> Option<f64> {
    let depths = model.points.values().flat_map(|point| {
        let first = point.track.first().and_then(|o| model.images.get(&o.image));
        first.map(|image| (image.cam_from_world * point.position).coords.norm())
    });
    median(&mut depths.collect::<Vec<_>>()).filter(|depth| depth.is_finite() && *depth > 0.0)
}

#[cfg(test)]
mod tests {
    use nalgebra::DMatrix;

    use super::*;

    /// What is kept gives back the covariance of each pose exactly, and of pairs where the modes
    /// suffice.
    #[test]
    fn modes_give_the_covariance_back() {
        let low_rank = DMatrix::from_fn(18, 4, |r, c| ((r * 7 + c * 5) as f64).sin());
        let covariance = &low_rank * low_rank.transpose();
        let noise = factored(covariance.clone(), 1.0);
        for (a, of_a) in noise.iter().enumerate() {
            for (b, of_b) in noise.iter().enumerate() {
                let mut block = Matrix6::zeros();
                for (x, y) in of_a.shared.iter().zip(&of_b.shared) {
                    block += x.map(f64::from) * y.map(f64::from).transpose();
                }
                if a == b {
                    block += of_a.own.map(f64::from);
                }
                let expected = covariance.fixed_view::<6, 6>(6 * a, 6 * b);
                assert!((block - expected).amax() < 1e-5, "{a} {b}");
            }
        }
    }
}
