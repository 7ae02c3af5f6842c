//! The last refinement: keypoint noise and the map's own noise together.

use std::collections::BTreeMap;

use nalgebra::{
    Isometry3, Matrix2, Matrix2x3, Matrix2x6, Matrix3, Matrix6, Point2, Point3, Vector2, Vector6,
};
use volery_geometry::{Camera, median, perturbed};

use crate::jacobians::linearize;

/// A pixel, the point that it sees, and the covariance of that point's position.
pub(crate) struct Sight {
    pub(crate) pixel: Point2<f64>,
    /// Noise of the pixel relative to that of others: coarse keypoints are placed less exactly.
    pub(crate) relative_sigma: f64,
    pub(crate) point: Point3<f64>,
    /// Index of the point in the map.
    pub(crate) point_index: u32,
    pub(crate) covariance: Matrix3<f64>,
}

impl Sight {
    /// S.
    pub(crate) fn noise(&self, by_point: &Matrix2x3<f64>, squared_sigma: f64) -> Matrix2<f64> {
        by_point * self.covariance * by_point.transpose()
            + Matrix2::identity() * (squared_sigma * self.relative_sigma * self.relative_sigma)
    }
}

/// A pose with the covariance of its left perturbation, ξ = (ω, τ).
pub(crate) struct WeightedPose {
    pub(crate) cam_from_world: Isometry3<f64>,
    /// By the noise of the keypoints and of the points, each on its own.
    pub(crate) covariance: Matrix6<f64>,
    /// (Σ JᵀS⁻¹J)⁻¹
    pub(crate) inverse_information: Matrix6<f64>,
    /// σ²
    pub(crate) squared_sigma: f64,
}

/// Cauchy's 95 % efficiency under normal noise.
const CAUCHY_TUNING: f64 = 2.385;
/// No detector is finer, pixels.
const MIN_SIGMA_PX: f64 = 0.15;
/// Keypoints within a cell of this size may err together, pixels.
const CELL_PX: f64 = 48.0;
const MAX_ITERATIONS: usize = 15;
const NOISE_ROUNDS: usize = 5;

/// Minimizes over the pose, with Cauchy's loss ρ,
///
/// ```text
/// Σᵢ ρ(rᵢᵀ Sᵢ⁻¹ rᵢ),   Sᵢ = σ² gᵢ² I + Jᵢ Cᵢ Jᵢᵀ
/// ```
///
/// `rᵢ` residuals in pixels, `gᵢ` relative noise of the keypoint, `Cᵢ` covariance of the point, `Jᵢ` = ∂pixel/∂point, σ such that the
/// median of `rᵀ S⁻¹ r` is that of χ²₂. `None` if the sights leave the pose undetermined.
pub(crate) fn refine_weighted(
    sights: &[Sight],
    camera: &Camera,
    initial: &Isometry3<f64>,
) -> Option<WeightedPose> {
    let squared_sigma = pixel_variance(sights, camera, initial)?;
    let mut pose = *initial;
    let mut current = Normal::at(sights, camera, &pose, squared_sigma)?;
    for _ in 0..MAX_ITERATIONS {
        let step = current.weighted.cholesky()?.solve(&-current.gradient);
        let moved = perturbed(&pose, &step);
        let Some(next) = Normal::at(sights, camera, &moved, squared_sigma) else { break };
        if next.cost >= current.cost {
            break;
        }
        let is_done = current.cost - next.cost < 1e-9 * current.cost;
        (pose, current) = (moved, next);
        if is_done {
            break;
        }
    }
    // Huber & Ronchetti, Robust Statistics, 7.6: n/(n−3) · E[ψ²] / E[ψ′]² · (Σ JᵀS⁻¹J)⁻¹.
    let n = sights.len() as f64;
    let factor = (current.squared_influence / n) / (current.slope / n).powi(2) * n / (n - 3.0);
    let inverse_information = current.plain.cholesky()?.inverse();
    let effect = design_effect(sights, camera, &pose, squared_sigma, &inverse_information);
    let covariance = inverse_information * (factor.max(1.0) * effect);
    let is_finite = covariance.iter().chain(pose.translation.vector.iter()).all(|v| v.is_finite());
    is_finite.then_some(WeightedPose {
        cam_from_world: pose,
        covariance,
        inverse_information,
        squared_sigma,
    })
}

/// Whitened by S: residual and its derivatives by the pose.
fn whitened(
    sight: &Sight,
    camera: &Camera,
    pose: &Isometry3<f64>,
    squared_sigma: f64,
) -> Option<(Vector2<f64>, Matrix2x6<f64>)> {
    let at = linearize(camera, pose, &sight.point)?;
    let whiten = sight.noise(&at.by_point, squared_sigma).cholesky()?.l().try_inverse()?;
    Some((whiten * (at.pixel - sight.pixel), whiten * at.by_pose))
}

/// How much more the pose varies than if the keypoints erred one by one: keypoints of one cell
/// count as a cluster.
///
/// ```text
/// tr(N⁻¹ Σ_g s_g s_gᵀ) / tr(N⁻¹ Σᵢ sᵢ sᵢᵀ),   sᵢ = wᵢ Jᵢᵀ rᵢ,   s_g = Σ_{i ∈ g} sᵢ
/// ```
///
/// Rao & Scott, "The Analysis of Categorical Data from Complex Sample Surveys", JASA 1981: the
/// mean design effect.
fn design_effect(
    sights: &[Sight],
    camera: &Camera,
    pose: &Isometry3<f64>,
    squared_sigma: f64,
    inverse_information: &Matrix6<f64>,
) -> f64 {
    let mut clusters: BTreeMap<(i64, i64), Vector6<f64>> = BTreeMap::new();
    let mut alone = 0.0;
    let size = |s: &Vector6<f64>| s.dot(&(inverse_information * s));
    for sight in sights {
        let Some((r, j)) = whitened(sight, camera, pose, squared_sigma) else { continue };
        let weight = 1.0 / (1.0 + r.norm_squared() / (CAUCHY_TUNING * CAUCHY_TUNING));
        let s = j.tr_mul(&r) * weight;
        alone += size(&s);
        let cell = |v: f64| (v / CELL_PX).floor() as i64;
        *clusters.entry((cell(sight.pixel.x), cell(sight.pixel.y))).or_default() += s;
    }
    let together: f64 = clusters.values().map(size).sum();
    if alone > 0.0 { (together / alone).max(1.0) } else { 1.0 }
}

/// σ², by fixed-point iteration.
fn pixel_variance(sights: &[Sight], camera: &Camera, pose: &Isometry3<f64>) -> Option<f64> {
    let mut squared_sigma = 1.0_f64;
    for _ in 0..NOISE_ROUNDS {
        let mut squared: Vec<f64> = sights
            .iter()
            .filter_map(|sight| {
                Some(whitened(sight, camera, pose, squared_sigma)?.0.norm_squared())
            })
            .collect();
        let ratio = median(&mut squared)? / (2.0 * std::f64::consts::LN_2);
        squared_sigma = (squared_sigma * ratio).max(MIN_SIGMA_PX * MIN_SIGMA_PX);
    }
    Some(squared_sigma)
}

/// Normal equations at a pose.
struct Normal {
    cost: f64,
    gradient: Vector6<f64>,
    /// Σ w JᵀS⁻¹J
    weighted: Matrix6<f64>,
    /// Σ JᵀS⁻¹J
    plain: Matrix6<f64>,
    /// Σ ψ², per coordinate.
    squared_influence: f64,
    /// Σ ψ′, per coordinate.
    slope: f64,
}

impl Normal {
    /// `None` if a point has gone behind the camera.
    fn at(
        sights: &[Sight],
        camera: &Camera,
        pose: &Isometry3<f64>,
        squared_sigma: f64,
    ) -> Option<Self> {
        let mut normal = Self {
            cost: 0.0,
            gradient: Vector6::zeros(),
            weighted: Matrix6::zeros(),
            plain: Matrix6::zeros(),
            squared_influence: 0.0,
            slope: 0.0,
        };
        let squared_scale = CAUCHY_TUNING * CAUCHY_TUNING;
        for sight in sights {
            let (r, j) = whitened(sight, camera, pose, squared_sigma)?;
            let squared = r.norm_squared();
            let weight = 1.0 / (1.0 + squared / squared_scale);
            let information = j.tr_mul(&j);
            normal.cost += squared_scale * (squared / squared_scale).ln_1p();
            normal.gradient += j.tr_mul(&r) * weight;
            normal.weighted += information * weight;
            normal.plain += information;
            normal.squared_influence += 0.5 * weight * weight * squared;
            normal.slope += weight - weight * weight * squared / squared_scale;
        }
        Some(normal)
    }
}
