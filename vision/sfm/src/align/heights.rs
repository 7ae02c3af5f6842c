//! Scale and up from heights.

use nalgebra::{Matrix3, Matrix4, Unit, Vector3, Vector4};
use volery_scene::{ImagePrior, ScaleSource, SparseModel};

use super::scale::{MODEL_SIGMA_REL, ScaleEstimate};

/// Standard deviation of a height that claims less, meters.
const MIN_HEIGHT_SIGMA: f64 = 0.005;
/// Reweighting rounds.
const NUM_ROUNDS: usize = 12;
/// Deviations at which a height weighs half.
const LOSS_SCALE: f64 = 3.0;

/// What the heights of a flight say.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct HeightFit {
    pub(super) scale: ScaleEstimate,
    /// Up in the frame of the model, from the heights and the given up together.
    pub(super) up: Unit<Vector3<f64>>,
    /// Its standard deviation, radians.
    pub(super) tilt_sigma: f64,
}

/// A height against the place of its image.
struct Sample {
    /// Camera center less the mean of all, model units; and 1.
    place: Vector4<f64>,
    height: f64,
    sigma: f64,
}

/// Maximum-likelihood fit of the plane `h = g · C + b` over the camera centers C, where
/// `g = c u` holds the meters per model unit c and up u:
///
/// ```text
/// min Σ w ((g · Cᵢ + b − hᵢ) / σᵢ)² + Σ_k (t_k · g / (c σ_up))²
/// ```
///
/// with tangents t_k of the given `up` of standard deviation `up_sigma`, and Cauchy weights w.
/// Heights err by centimeters, centers by millimeters, so all errors are in the heights. A flight
/// that climbs as it moves mixes slope with scale: up has to be estimated with it. The scale comes
/// out with σ = σ_h / √(Σ (z − z̄)²) at best: for 1 % at 95 % confidence and 3 cm, √n times the
/// standard deviation of the heights must be 5.9 m (140 images, half of them a meter above the
/// others).
///
/// `None` with fewer than four heights, or where they say that up is down.
pub(super) fn fit_heights(
    model: &SparseModel,
    priors: &[ImagePrior],
    up: &Unit<Vector3<f64>>,
    up_sigma: f64,
) -> Option<HeightFit> {
    let samples = samples(model, priors);
    if samples.len() < 4 {
        return None;
    }
    let (t1, t2) = tangents(up);
    let tangent_spread = t1 * t1.transpose() + t2 * t2.transpose();
    let mut weights = vec![1.0; samples.len()];
    // The first round holds up as given; its stiffness needs a scale, that of the heights' spread.
    let (mut fit, mut normal) = (Vector4::zeros(), Matrix4::zeros());
    let mut stiffness = 1e6 * spread(&samples);
    for _ in 0..NUM_ROUNDS {
        normal = Matrix4::zeros();
        let mut right = Vector4::zeros();
        for (sample, weight) in samples.iter().zip(&weights) {
            let w = weight / sample.sigma.powi(2);
            normal += sample.place * sample.place.transpose() * w;
            right += sample.place * (sample.height * w);
        }
        let mut block = normal.fixed_view_mut::<3, 3>(0, 0);
        block += tangent_spread * stiffness;
        fit = normal.cholesky()?.solve(&right);
        let c = up.dot(&fit.xyz());
        if !(c.is_finite() && c > 0.0) {
            return None;
        }
        stiffness = (c * up_sigma).powi(-2);
        for (weight, sample) in weights.iter_mut().zip(&samples) {
            let r = residual(sample, &fit) / LOSS_SCALE;
            *weight = 1.0 / (1.0 + r * r);
        }
    }
    // Residuals larger than claimed (a bent map) widen the claim.
    let chi2: f64 = samples.iter().zip(&weights).map(|(s, w)| w * residual(s, &fit).powi(2)).sum();
    let excess = (chi2 / (samples.len() as f64 - 4.0).max(1.0)).max(1.0);
    let g = fit.xyz();
    let covariance: Matrix3<f64> =
        normal.try_inverse()?.fixed_view::<3, 3>(0, 0).into_owned() * excess;
    let (up, c) = Unit::try_new_and_get(g, 0.0)?;
    let (t1, t2) = tangents(&up);
    let variance = |direction: &Vector3<f64>| direction.dot(&(covariance * direction)) / (c * c);
    let scale = ScaleEstimate {
        factor: c,
        sigma_rel: variance(&up).sqrt().hypot(MODEL_SIGMA_REL),
        source: ScaleSource::Heights,
    };
    let tilt_sigma = (0.5 * (variance(&t1) + variance(&t2))).sqrt();
    scale.sigma_rel.is_finite().then_some(HeightFit { scale, up, tilt_sigma })
}

fn samples(model: &SparseModel, priors: &[ImagePrior]) -> Vec<Sample> {
    let known: Vec<_> = model
        .images
        .iter()
        .filter_map(|(id, image)| {
            let prior = priors.get(id.0 as usize)?.height?;
            let is_finite = prior.height.is_finite() && prior.sigma.is_finite();
            is_finite.then(|| (image.center().coords, prior))
        })
        .collect();
    let mean = known.iter().map(|(c, _)| c).sum::<Vector3<f64>>() / known.len().max(1) as f64;
    known
        .into_iter()
        .map(|(center, prior)| Sample {
            place: (center - mean).push(1.0),
            height: prior.height,
            sigma: prior.sigma.max(MIN_HEIGHT_SIGMA),
        })
        .collect()
}

/// Residual in standard deviations.
fn residual(sample: &Sample, fit: &Vector4<f64>) -> f64 {
    (fit.dot(&sample.place) - sample.height) / sample.sigma
}

/// Σ ‖C‖² / σ².
fn spread(samples: &[Sample]) -> f64 {
    samples.iter().map(|s| s.place.xyz().norm_squared() / s.sigma.powi(2)).sum()
}

fn tangents(up: &Unit<Vector3<f64>>) -> (Vector3<f64>, Vector3<f64>) {
    let across = if up.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() };
    let t1 = up.cross(&across).normalize();
    (t1, up.cross(&t1))
}
