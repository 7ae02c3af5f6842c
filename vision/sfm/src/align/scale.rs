//! How long a unit of the model is.

use nalgebra::{Unit, Vector3};
use volery_scene::{ImagePrior, KnownDistance, ScaleSource, SparseModel};

use super::positions::PositionFit;

/// Standard deviation of a distance measured between two cameras, meters: where a camera's center
/// is, is known to about a centimeter.
const DISTANCE_SIGMA: f64 = 0.01;
/// Share of a map's length that its bending may cost any one distance.
const MODEL_SIGMA_REL: f64 = 0.001;
/// Standard deviation of a height that claims less, meters.
const MIN_HEIGHT_SIGMA: f64 = 0.005;
/// Reweighting rounds of the height regression.
const NUM_ROUNDS: usize = 10;

/// Meters per model unit from one source.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ScaleEstimate {
    pub(super) factor: f64,
    pub(super) sigma_rel: f64,
    pub(super) source: ScaleSource,
}

/// What every source says. Known distances that contradict each other come as several estimates.
pub(super) fn scales(
    model: &SparseModel,
    priors: &[ImagePrior],
    up: &Unit<Vector3<f64>>,
    fit: Option<&PositionFit>,
    known_distances: &[KnownDistance],
) -> Vec<ScaleEstimate> {
    let mut estimates = from_distances(model, known_distances);
    if let Some(fit) = fit {
        estimates.push(ScaleEstimate {
            factor: fit.factor,
            sigma_rel: fit.scale_sigma_rel.hypot(MODEL_SIGMA_REL),
            source: ScaleSource::Positions,
        });
    }
    estimates.extend(from_heights(model, priors, up));
    estimates
}

/// The precision-weighted mean of the known distances; the single ones as well where they do not
/// agree with it.
fn from_distances(model: &SparseModel, known_distances: &[KnownDistance]) -> Vec<ScaleEstimate> {
    let center = |name: &str| {
        model.images.values().find(|image| image.name == name).map(|image| image.center())
    };
    let single: Vec<ScaleEstimate> = known_distances
        .iter()
        .filter(|known| known.meters.is_finite() && known.meters > 0.0)
        .filter_map(|known| {
            let length = (center(&known.image_a)? - center(&known.image_b)?).norm();
            (length > 0.0).then(|| ScaleEstimate {
                factor: known.meters / length,
                sigma_rel: (DISTANCE_SIGMA / known.meters).hypot(MODEL_SIGMA_REL),
                source: ScaleSource::KnownDistance,
            })
        })
        .collect();
    let weight: f64 = single.iter().map(|s| s.sigma_rel.powi(-2)).sum();
    if single.is_empty() {
        return Vec::new();
    }
    let log_mean =
        single.iter().map(|s| s.factor.ln() * s.sigma_rel.powi(-2)).sum::<f64>() / weight;
    let mean = ScaleEstimate {
        factor: log_mean.exp(),
        sigma_rel: weight.powf(-0.5).max(MODEL_SIGMA_REL),
        source: ScaleSource::KnownDistance,
    };
    let disagrees = |s: &ScaleEstimate| (s.factor.ln() - log_mean).abs() > 3.0 * s.sigma_rel;
    std::iter::once(mean).chain(single.iter().copied().filter(disagrees)).collect()
}

/// Regression of the heights on the model's up coordinate, `h = c u + b`, with Cauchy weights.
fn from_heights(
    model: &SparseModel,
    priors: &[ImagePrior],
    up: &Unit<Vector3<f64>>,
) -> Option<ScaleEstimate> {
    let samples: Vec<(f64, f64, f64)> = model
        .images
        .iter()
        .filter_map(|(id, image)| {
            let prior = priors.get(id.0 as usize)?.height?;
            (prior.height.is_finite() && prior.sigma.is_finite()).then(|| {
                (up.dot(&image.center().coords), prior.height, prior.sigma.max(MIN_HEIGHT_SIGMA))
            })
        })
        .collect();
    if samples.len() < 3 {
        return None;
    }
    let mut weights: Vec<f64> = samples.iter().map(|(_, _, sigma)| sigma.powi(-2)).collect();
    let (mut c, mut b, mut s_uu) = (0.0, 0.0, 0.0);
    for _ in 0..NUM_ROUNDS {
        let sum: f64 = weights.iter().sum();
        let mean = |value: &dyn Fn(&(f64, f64, f64)) -> f64| -> f64 {
            samples.iter().zip(&weights).map(|(s, w)| w * value(s)).sum::<f64>() / sum
        };
        let (mean_u, mean_h) = (mean(&|s| s.0), mean(&|s| s.1));
        s_uu = mean(&|s| (s.0 - mean_u).powi(2)) * sum;
        let s_uh = mean(&|s| (s.0 - mean_u) * (s.1 - mean_h)) * sum;
        c = s_uh / s_uu;
        b = mean_h - c * mean_u;
        for (weight, (u, h, sigma)) in weights.iter_mut().zip(&samples) {
            let r = (h - c * u - b) / (3.0 * sigma);
            *weight = sigma.powi(-2) / (1.0 + r * r);
        }
    }
    // Residuals larger than claimed (a bent map, a tilted up) widen the claim.
    let chi2: f64 =
        samples.iter().zip(&weights).map(|((u, h, _), w)| w * (h - c * u - b).powi(2)).sum();
    let excess = (chi2 / (samples.len() as f64 - 2.0).max(1.0)).sqrt().max(1.0);
    let sigma_rel = (excess / (s_uu.sqrt() * c)).hypot(MODEL_SIGMA_REL);
    (c.is_finite() && c > 0.0 && sigma_rel.is_finite()).then_some(ScaleEstimate {
        factor: c,
        sigma_rel,
        source: ScaleSource::Heights,
    })
}
