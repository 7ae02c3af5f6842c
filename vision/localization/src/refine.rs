//! The last refinement: keypoint noise and the map's own noise together.

use nalgebra::{Isometry3, Matrix2, Matrix2x6, Matrix3, Matrix6, Point2, Point3, Vector2, Vector6};
use volery_geometry::{Camera, median, perturbed};

/// A pixel, the point that it sees, and the covariance of that point's position.
pub(crate) struct Sight {
    pub(crate) pixel: Point2<f64>,
    /// Noise of the pixel relative to that of others: coarse keypoints are placed less exactly.
    pub(crate) relative_sigma: f64,
    pub(crate) point: Point3<f64>,
    pub(crate) covariance: Matrix3<f64>,
}

/// A pose with the covariance of its left perturbation, ξ = (ω, τ).
pub(crate) struct WeightedPose {
    pub(crate) cam_from_world: Isometry3<f64>,
    pub(crate) covariance: Matrix6<f64>,
}

/// Cauchy's 95 % efficiency under normal noise.
const CAUCHY_TUNING: f64 = 2.385;
/// No detector is finer, pixels.
const MIN_SIGMA_PX: f64 = 0.15;
/// Keypoints near each other err together, so n of them are worth fewer: the factor by which the
/// variance exceeds that of independent ones, measured on the rendered warehouse (37 queries: 89 %
/// within the 95 % band with it, 65 % without).
const CORRELATION: f64 = 1.9;
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
    let covariance = current.plain.cholesky()?.inverse() * (CORRELATION * factor.max(1.0));
    let is_finite = covariance.iter().chain(pose.translation.vector.iter()).all(|v| v.is_finite());
    is_finite.then_some(WeightedPose { cam_from_world: pose, covariance })
}

/// Whitened by S: residual and its derivatives by the pose.
fn whitened(
    sight: &Sight,
    camera: &Camera,
    pose: &Isometry3<f64>,
    squared_sigma: f64,
) -> Option<(Vector2<f64>, Matrix2x6<f64>)> {
    let in_cam = pose * sight.point;
    let projection = camera.project_with_jacobians(&in_cam)?;
    let by_point = projection.d_point * pose.rotation.to_rotation_matrix().into_inner();
    let s = by_point * sight.covariance * by_point.transpose()
        + Matrix2::identity() * (squared_sigma * sight.relative_sigma * sight.relative_sigma);
    let whiten = s.cholesky()?.l().try_inverse()?;
    let mut by_pose = Matrix2x6::zeros();
    // exp(ξ) p ≈ p + ω × p + τ
    by_pose
        .fixed_view_mut::<2, 3>(0, 0)
        .copy_from(&(projection.d_point * -in_cam.coords.cross_matrix()));
    by_pose.fixed_view_mut::<2, 3>(0, 3).copy_from(&projection.d_point);
    Some((whiten * (projection.pixel - sight.pixel), whiten * by_pose))
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
