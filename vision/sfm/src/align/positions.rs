//! The similarity that takes the cameras to their position priors.

use nalgebra::{Matrix3, Point3, Similarity3, Vector3};
use volery_geometry::similarity_from_points;
use volery_scene::{ImagePrior, SparseModel};

/// Residual, in standard deviations of a prior, beyond which it is an outlier.
const MAX_DEVIATIONS: f64 = 4.0;
/// Triples tried for the robust start.
const MAX_TRIPLES: usize = 300;
/// Standard deviation of a prior that claims less, meters.
const MIN_SIGMA: f64 = 0.002;

/// Cameras against their position priors.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct PositionFit {
    /// The frame of the priors; `None` where the positions (on a line) leave it open.
    pub(super) map_from_model: Option<Similarity3<f64>>,
    /// Meters per model unit.
    pub(super) factor: f64,
    /// Its relative standard deviation.
    pub(super) scale_sigma_rel: f64,
    /// Standard deviation of up, radians; `None` where the frame is open.
    pub(super) tilt_sigma: Option<f64>,
}

struct Pair {
    model: Point3<f64>,
    prior: Point3<f64>,
    sigma: f64,
}

/// Robust fit over all images with a position; `None` with fewer than two.
pub(super) fn fit_positions(model: &SparseModel, priors: &[ImagePrior]) -> Option<PositionFit> {
    let pairs: Vec<Pair> = model
        .images
        .iter()
        .filter_map(|(id, image)| {
            let prior = priors.get(id.0 as usize)?.position?;
            let finite = prior.position.coords.iter().all(|v| v.is_finite());
            (finite && prior.sigma.is_finite()).then(|| Pair {
                model: image.center(),
                prior: prior.position,
                sigma: prior.sigma.max(MIN_SIGMA),
            })
        })
        .collect();
    if pairs.len() < 2 {
        return None;
    }
    let inliers = consistent(&pairs);
    let used: Vec<&Pair> =
        pairs.iter().zip(&inliers).filter(|(_, i)| **i).map(|(p, _)| p).collect();
    let n = used.len() as f64;
    if used.len() < 2 {
        return None;
    }
    let (model_points, prior_points): (Vec<_>, Vec<_>) =
        used.iter().map(|p| (p.model, p.prior)).unzip();
    let spread = scatter(&prior_points);
    let claimed = (used.iter().map(|p| p.sigma * p.sigma).sum::<f64>() / n).sqrt();
    let trace = spread.trace();
    let eigenvalues = spread.symmetric_eigenvalues();
    let mut sorted = [eigenvalues[0], eigenvalues[1], eigenvalues[2]];
    sorted.sort_by(f64::total_cmp);

    let fitted = similarity_from_points(&model_points, &prior_points).ok();
    // The turn about the longest direction needs width: several times the noise.
    let is_wide = sorted[1] > (10.0 * claimed).powi(2);
    match fitted {
        Some(map_from_model) if used.len() >= 3 && is_wide => {
            let residual: f64 = used
                .iter()
                .map(|p| (map_from_model * p.model - p.prior).norm_squared())
                .sum::<f64>();
            let freedom = (3.0 * n - 7.0).max(1.0);
            let sigma = claimed.max((residual / freedom).sqrt());
            let scale_sigma_rel = sigma / trace.sqrt();
            // Tilt about a horizontal axis is held by the points' distances from that axis.
            let tilt_sigma = sigma / least_tilt_lever(&spread).sqrt();
            Some(PositionFit {
                map_from_model: Some(map_from_model),
                factor: map_from_model.scaling(),
                scale_sigma_rel,
                tilt_sigma: Some(tilt_sigma),
            })
        }
        _ => {
            let model_trace = scatter(&model_points).trace();
            let factor = (trace / model_trace).sqrt();
            (factor.is_finite() && factor > 0.0).then(|| PositionFit {
                map_from_model: None,
                factor,
                scale_sigma_rel: claimed / trace.sqrt(),
                tilt_sigma: None,
            })
        }
    }
}

/// Σ (p − mean)(p − mean)ᵀ.
fn scatter(points: &[Point3<f64>]) -> Matrix3<f64> {
    let mean = points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / points.len() as f64;
    points.iter().map(|p| (p.coords - mean) * (p.coords - mean).transpose()).sum()
}

/// Least Σ of squared distances from any horizontal axis through the mean.
fn least_tilt_lever(spread: &Matrix3<f64>) -> f64 {
    // About the horizontal axis a: tr(S) − aᵀ S a.
    let horizontal = spread.fixed_view::<2, 2>(0, 0).into_owned();
    spread.trace() - horizontal.symmetric_eigenvalues().max()
}

/// Which priors agree with the similarity that most of them agree with.
fn consistent(pairs: &[Pair]) -> Vec<bool> {
    let n = pairs.len();
    if n < 4 {
        return vec![true; n];
    }
    let residual = |t: &Similarity3<f64>, p: &Pair| (t * p.model - p.prior).norm() / p.sigma;
    let limit = MAX_DEVIATIONS * 3.0_f64.sqrt();
    // Samples far apart in the list are far apart in the flight, and fit best.
    let mut best: Option<(f64, Similarity3<f64>)> = None;
    let triples = (0..n)
        .flat_map(|a| (1..n).map(move |step| (a, step)))
        .map(|(a, step)| [a, (a + step) % n, (a + 2 * step + n / 3) % n])
        .filter(|[a, b, c]| a != b && b != c && a != c);
    let stride = (n * n / MAX_TRIPLES).max(1);
    for triple in triples.step_by(stride) {
        let model: Vec<_> = triple.iter().map(|&i| pairs[i].model).collect();
        let prior: Vec<_> = triple.iter().map(|&i| pairs[i].prior).collect();
        let Ok(fit) = similarity_from_points(&model, &prior) else { continue };
        // A sample carries its own noise into the others: a soft count.
        let score: f64 = pairs
            .iter()
            .map(|p| {
                let r = residual(&fit, p) / (3.0 * limit);
                r * r / (1.0 + r * r)
            })
            .sum();
        if best.is_none_or(|(least, _)| score < least) {
            best = Some((score, fit));
        }
    }
    let Some((_, mut fit)) = best else { return vec![true; n] };
    let mut inliers = vec![true; n];
    for widening in [3.0, 1.5, 1.0, 1.0] {
        inliers = pairs.iter().map(|p| residual(&fit, p) <= limit * widening).collect();
        let (model, prior): (Vec<_>, Vec<_>) = pairs
            .iter()
            .zip(&inliers)
            .filter(|(_, inlier)| **inlier)
            .map(|(p, _)| (p.model, p.prior))
            .unzip();
        match similarity_from_points(&model, &prior) {
            Ok(better) => fit = better,
            Err(_) => break,
        }
    }
    // Fewer than half in agreement: nobody is an outlier, the noise is larger than claimed.
    if 2 * inliers.iter().filter(|&&inlier| inlier).count() < n {
        inliers.fill(true);
    }
    inliers
}
