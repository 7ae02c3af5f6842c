//! How long a unit of the model is.

use volery_scene::{KnownDistance, ScaleSource, SparseModel};

use super::heights::HeightFit;
use super::positions::PositionFit;

/// Standard deviation of a distance measured between two cameras, meters: where a camera's center
/// is, is known to about a centimeter.
const DISTANCE_SIGMA: f64 = 0.01;
/// Share of a map's length that its bending may cost any one distance.
pub(super) const MODEL_SIGMA_REL: f64 = 0.001;

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
    heights: Option<&HeightFit>,
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
    estimates.extend(heights.map(|heights| heights.scale));
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
