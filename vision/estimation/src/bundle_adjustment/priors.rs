//! Priors on positions, rotations, gravity and focal lengths.

use nalgebra::{Isometry3, Matrix3, Matrix3x6, Vector3};

use super::BundleProblem;
use super::layout::{LANES, Layout, NONE};
use super::linearize::Sums;
use super::state::State;

/// A residual of three rows over the six unknowns of a pose, divided by its sigma.
struct PosePrior {
    residual: Vector3<f64>,
    jacobian: Matrix3x6<f64>,
}

/// `(C − c) / σ` with `C = −Rᵀ t`; the left perturbation moves it by `−Rᵀ v`.
fn position_prior(cam_from_world: &Isometry3<f64>, center: &Vector3<f64>, sigma: f64) -> PosePrior {
    let world_from_cam: Matrix3<f64> =
        cam_from_world.rotation.inverse().to_rotation_matrix().into_inner();
    let residual = (-(world_from_cam * cam_from_world.translation.vector) - center) / sigma;
    let mut jacobian = Matrix3x6::zeros();
    jacobian.fixed_view_mut::<3, 3>(0, 3).copy_from(&(world_from_cam / -sigma));
    PosePrior { residual, jacobian }
}

/// `(R ẑ − up) / σ`; the left perturbation moves it by `ω × R ẑ`.
fn gravity_prior(cam_from_world: &Isometry3<f64>, up: &Vector3<f64>, sigma: f64) -> PosePrior {
    let predicted = cam_from_world.rotation * Vector3::z();
    let mut jacobian = Matrix3x6::zeros();
    jacobian.fixed_view_mut::<3, 3>(0, 0).copy_from(&(predicted.cross_matrix() / -sigma));
    PosePrior { residual: (predicted - up) / sigma, jacobian }
}

/// `log(R R₀ᵀ) / σ`; the left perturbation moves it by ω, to first order.
fn rotation_prior(
    cam_from_world: &Isometry3<f64>,
    first: &Isometry3<f64>,
    sigma: f64,
) -> PosePrior {
    let turned = cam_from_world.rotation * first.rotation.inverse();
    let mut jacobian = Matrix3x6::zeros();
    jacobian.fixed_view_mut::<3, 3>(0, 0).fill_diagonal(1.0 / sigma);
    PosePrior { residual: turned.scaled_axis() / sigma, jacobian }
}

/// All priors of pose `index`.
fn pose_priors(
    problem: &BundleProblem,
    rotation_sigma: Option<f64>,
    state: &State,
    index: usize,
) -> impl Iterator<Item = PosePrior> {
    let (pose, cam_from_world) = (&problem.poses[index], &state.cam_from_world[index]);
    let position = pose
        .position_prior
        .map(|(center, sigma)| position_prior(cam_from_world, &center.coords, sigma));
    let gravity = pose.gravity_prior.map(|(up, sigma)| gravity_prior(cam_from_world, &up, sigma));
    let rotation =
        rotation_sigma.map(|sigma| rotation_prior(cam_from_world, &pose.cam_from_world, sigma));
    position.into_iter().chain(gravity).chain(rotation)
}

/// Focal residuals of camera `index`: (parameter, residual, derivative).
fn focal_priors(
    problem: &BundleProblem,
    state: &State,
    index: usize,
) -> impl Iterator<Item = (usize, f64, f64)> {
    let camera = &state.cameras[index];
    problem.cameras[index].focal_prior.into_iter().flat_map(move |(focal, sigma)| {
        (0..camera.model.num_focals())
            .map(move |param| (param, (camera.params()[param] - focal) / sigma, 1.0 / sigma))
    })
}

/// `½ Σ ‖r‖²` of the priors.
pub(super) fn priors_cost(
    problem: &BundleProblem,
    rotation_sigma: Option<f64>,
    state: &State,
) -> f64 {
    let poses: f64 = (0..problem.poses.len())
        .flat_map(|index| pose_priors(problem, rotation_sigma, state, index))
        .map(|prior| prior.residual.norm_squared())
        .sum();
    let focals: f64 = (0..problem.cameras.len())
        .flat_map(|index| focal_priors(problem, state, index))
        .map(|(_, residual, _)| residual * residual)
        .sum();
    0.5 * (poses + focals)
}

/// Adds the priors to the normal equations.
pub(super) fn add_priors(
    (problem, rotation_sigma): (&BundleProblem, Option<f64>),
    layout: &Layout,
    state: &State,
    sums: &mut Sums,
) {
    for (index, &block) in layout.pose_blocks.iter().enumerate() {
        if block == NONE {
            continue;
        }
        let terms = &mut sums.blocks[block as usize];
        for prior in pose_priors(problem, rotation_sigma, state, index) {
            let hessian = prior.jacobian.tr_mul(&prior.jacobian);
            let gradient = prior.jacobian.tr_mul(&prior.residual);
            for row in 0..6 {
                terms.gradient[row] += gradient[row];
                for column in 0..6 {
                    terms.hessian[row][column] += hessian[(row, column)];
                }
            }
        }
    }
    for (index, free) in layout.intrinsics.iter().enumerate() {
        for (param, residual, derivative) in focal_priors(problem, state, index) {
            // Focal lengths come first, so they lie in the first block.
            if let Some(lane) = free.params.iter().position(|&p| p == param) {
                debug_assert!(lane < LANES);
                let terms = &mut sums.blocks[free.first_block];
                terms.gradient[lane] += residual * derivative;
                terms.hessian[lane][lane] += derivative * derivative;
            }
        }
    }
}
