//! Which way is up.

use nalgebra::{Matrix3, Unit, Vector3};
use volery_geometry::frames::enu_from_camera;
use volery_scene::{GravitySource, ImagePrior, SparseModel};

/// Errors that all attitudes of a flight share (mount, level calibration), radians: averaging
/// does not remove them.
const SHARED_SIGMA: f64 = 0.002;
/// Reweighting rounds of the robust mean.
const NUM_ROUNDS: usize = 20;

/// Up in the frame of the model with its standard deviation, radians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct GravityEstimate {
    pub(super) up: Unit<Vector3<f64>>,
    pub(super) sigma: f64,
    pub(super) source: GravitySource,
}

/// Robust mean of the up directions that the attitudes of the images claim.
///
/// Up in the camera is the third row of `enu_from_camera`, which does not depend on the yaw; the
/// image's pose carries it into the model. Cauchy weights hold wrong attitudes down.
pub(super) fn from_attitudes(
    model: &SparseModel,
    priors: &[ImagePrior],
) -> Option<GravityEstimate> {
    let claims: Vec<(Vector3<f64>, f64)> = model
        .images
        .iter()
        .filter_map(|(id, image)| {
            let attitude = priors.get(id.0 as usize)?.attitude?;
            let in_cam = enu_from_camera(attitude.yaw, attitude.pitch, attitude.roll)
                .inverse_transform_vector(&Vector3::z());
            let up = image.cam_from_world.rotation.inverse_transform_vector(&in_cam);
            let sigma = attitude.sigma_tilt.max(1e-4);
            (up.iter().all(|v| v.is_finite()) && sigma.is_finite()).then_some((up, sigma))
        })
        .collect();
    if claims.is_empty() {
        return None;
    }
    let weighted = |weights: &[f64]| -> Vector3<f64> {
        claims.iter().zip(weights).map(|((up, _), w)| up * *w).sum()
    };
    let mut weights: Vec<f64> = claims.iter().map(|(_, sigma)| sigma.powi(-2)).collect();
    let mut up = Unit::try_new(weighted(&weights), 1e-9)?;
    for round in 0..NUM_ROUNDS {
        // The scale shrinks, so that a bad first mean does not cast out the good claims.
        let widening = (8.0_f64 * 0.6_f64.powi(round as i32)).max(1.0);
        for (weight, (claim, sigma)) in weights.iter_mut().zip(&claims) {
            let r = up.angle(claim) / (2.5 * sigma * widening);
            *weight = sigma.powi(-2) / (1.0 + r * r);
        }
        up = Unit::try_new(weighted(&weights), 1e-9)?;
    }
    let sum: f64 = weights.iter().sum();
    // Angles have two components, each with the tilt's standard deviation.
    let scatter = claims
        .iter()
        .zip(&weights)
        .map(|((claim, _), w)| w * up.angle(claim).powi(2) / 2.0)
        .sum::<f64>()
        / sum;
    let mean_sigma = (claims.len() as f64 / sum).sqrt();
    let single = scatter.sqrt().max(mean_sigma.min(1.0));
    let sigma = (single / (claims.len() as f64).sqrt()).hypot(SHARED_SIGMA);
    Some(GravityEstimate { up, sigma, source: GravitySource::Attitude })
}

/// A guess without any prior: the direction most square to the cameras' x axes, which a pilot
/// keeps level whatever the pitch; the mean of the cameras' up axes where they hardly turn.
pub(super) fn from_camera_axes(model: &SparseModel) -> Unit<Vector3<f64>> {
    let axis = |v: Vector3<f64>| {
        model
            .images
            .values()
            .map(move |image| image.cam_from_world.rotation.inverse_transform_vector(&v))
    };
    let mean: Vector3<f64> = axis(-Vector3::y()).sum();
    let Some(mean) = Unit::try_new(mean, 1e-9) else { return Vector3::z_axis() };
    let spread: Matrix3<f64> = axis(Vector3::x()).map(|x| x * x.transpose()).sum();
    let spread = spread / model.images.len().max(1) as f64;
    let eigen = spread.symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
    // The x axes must span a plane, or the direction square to them is free.
    if eigen.eigenvalues[order[1]] < 10.0 * eigen.eigenvalues[order[0]].max(1e-3) {
        return mean;
    }
    let square = eigen.eigenvectors.column(order[0]).into_owned();
    let up = Unit::new_normalize(square * square.dot(&mean).signum());
    // Far from the mean it is not what was meant.
    if up.angle(&mean) < 0.5 { up } else { mean }
}
