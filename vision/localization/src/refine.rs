//! The last refinement: keypoint noise and the map's own noise together.

use std::collections::BTreeMap;

use nalgebra::{
    Isometry3, Matrix2, Matrix2x3, Matrix2x6, Matrix3, Matrix6, Point2, Point3, Vector2, Vector6,
};
use volery_geometry::{Camera, linearize, median, perturbed};

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

/// Scale of Cauchy's loss, in σ: that of the Cauchy distribution of two dimensions with the same
/// median, √(2 ln 2) / √3. The errors of keypoints that were looked for around projected points
/// follow it: a sharp core, and tails as far as was looked.
const CAUCHY_SCALE: f64 = 0.6798;
/// No detector is finer, pixels.
const MIN_SIGMA_PX: f64 = 0.15;
/// Keypoints within a cell of this size may err together, of an image 640 pixels wide.
const CELL_PX: f64 = 128.0;
/// Least part of the information that the other cells hold in any direction.
const MIN_REST: f64 = 0.1;
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
    // The noise around the first pose holds the error of that too.
    let around_initial = pixel_variance(sights, camera, initial)?;
    let (closer, _) = minimize(sights, camera, initial, around_initial)?;
    let squared_sigma = pixel_variance(sights, camera, &closer)?;
    let (pose, current) = minimize(sights, camera, &closer, squared_sigma)?;
    // Huber & Ronchetti, Robust Statistics, 7.6: n/(n−3) · E[ψ²] / E[ψ′]² · (Σ JᵀS⁻¹J)⁻¹.
    let n = sights.len() as f64;
    let factor = (current.squared_influence / n) / (current.slope / n).powi(2) * n / (n - 3.0);
    let inverse_information = current.plain.cholesky()?.inverse();
    let effect = design_effect(sights, camera, &pose, squared_sigma)?;
    let covariance = inverse_information * (factor.max(1.0) * effect);
    let is_finite = covariance.iter().chain(pose.translation.vector.iter()).all(|v| v.is_finite());
    is_finite.then_some(WeightedPose {
        cam_from_world: pose,
        covariance,
        inverse_information,
        squared_sigma,
    })
}

/// The pose of least cost from `initial` on, and the normal equations there.
fn minimize(
    sights: &[Sight],
    camera: &Camera,
    initial: &Isometry3<f64>,
    squared_sigma: f64,
) -> Option<(Isometry3<f64>, Normal)> {
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
    Some((pose, current))
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

/// How much more the pose varies than if the keypoints erred one by one, by the poses that each
/// cell g of the image alone moves away from what the others say:
///
/// ```text
/// Σ_g δ_gᵀ N δ_g / Σᵢ sᵢᵀ N⁻¹ sᵢ,   δ_g = (N − N_g)⁻¹ s_g,   s_g = Σ_{i ∈ g} sᵢ,   sᵢ = Jᵢᵀ ψᵢ
/// ```
///
/// The jackknife gives back what the fitted pose has taken out of the residuals of a cell. Bell &
/// McCaffrey, "Bias reduction in standard errors for linear regression with multi-stage samples",
/// Survey Methodology 2002; the ratio is the mean design effect of Rao & Scott, JASA 1981.
fn design_effect(
    sights: &[Sight],
    camera: &Camera,
    pose: &Isometry3<f64>,
    squared_sigma: f64,
) -> Option<f64> {
    let cell_px = CELL_PX * f64::from(camera.width.max(camera.height)) / 640.0;
    let mut cells: BTreeMap<(i64, i64), (Vector6<f64>, Matrix6<f64>)> = BTreeMap::new();
    let mut scores: Vec<Vector6<f64>> = Vec::with_capacity(sights.len());
    for sight in sights {
        let Some((r, j)) = whitened(sight, camera, pose, squared_sigma) else { continue };
        let (weight, slope) = cauchy(r.norm_squared());
        let score = j.tr_mul(&r) * weight;
        let cell = |v: f64| (v / cell_px).floor() as i64;
        let (sum, curvature) = cells.entry((cell(sight.pixel.x), cell(sight.pixel.y))).or_default();
        *sum += score;
        *curvature += j.tr_mul(&j) * slope;
        scores.push(score);
    }
    let all: Matrix6<f64> = cells.values().map(|(_, curvature)| curvature).sum();
    let whiten = all.cholesky()?.l().try_inverse()?;
    let alone: f64 = scores.iter().map(|score| (whiten * score).norm_squared()).sum();
    let moved = |(score, curvature): &(Vector6<f64>, Matrix6<f64>)| {
        let rest = Matrix6::identity() - whiten * curvature * whiten.transpose();
        let eigen = rest.symmetric_eigen();
        let along = eigen.eigenvectors.tr_mul(&(whiten * score));
        along.component_div(&eigen.eigenvalues.map(|v| v.max(MIN_REST))).norm_squared()
    };
    let together: f64 = cells.values().map(moved).sum();
    Some(if alone > 0.0 { (together / alone).max(1.0) } else { 1.0 })
}

/// Weight ψ(r)/r of a whitened residual, and the mean of ψ′ over the two directions.
fn cauchy(squared: f64) -> (f64, f64) {
    let relative = squared / (CAUCHY_SCALE * CAUCHY_SCALE);
    let weight = 1.0 / (1.0 + relative);
    (weight, weight - weight * weight * relative)
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
        let squared_scale = CAUCHY_SCALE * CAUCHY_SCALE;
        for sight in sights {
            let (r, j) = whitened(sight, camera, pose, squared_sigma)?;
            let squared = r.norm_squared();
            let (weight, slope) = cauchy(squared);
            let information = j.tr_mul(&j);
            normal.cost += squared_scale * (squared / squared_scale).ln_1p();
            normal.gradient += j.tr_mul(&r) * weight;
            normal.weighted += information * weight;
            normal.plain += information;
            normal.squared_influence += 0.5 * weight * weight * squared;
            normal.slope += slope;
        }
        Some(normal)
    }
}

#[cfg(test)]
mod tests {
    use volery_geometry::{CameraModel, Rng};

    use super::*;

    /// Mean normalized squared error of 150 poses by 400 points, where keypoints of one patch of
    /// 100 pixels share an error of `shared` pixels on top of their own half pixel.
    fn mean_squared_error(shared: f64) -> f64 {
        let camera =
            Camera::new(CameraModel::Pinhole, 640, 480, &[500.0, 500.0, 320.0, 240.0]).unwrap();
        let mut rng = Rng::new(7);
        let trial = |_| {
            let patches: Vec<Vector2<f64>> =
                (0..35).map(|_| Vector2::new(rng.normal(), rng.normal()) * shared).collect();
            let sight = |index: u32| {
                let (u, v) = (rng.range(0.0, 640.0), rng.range(0.0, 480.0));
                let z = rng.range(2.0, 8.0);
                let patch = patches[(u / 100.0) as usize + 7 * (v / 100.0) as usize];
                let error = patch + Vector2::new(rng.normal(), rng.normal()) * 0.5;
                Sight {
                    pixel: Point2::new(u, v) + error,
                    relative_sigma: 1.0,
                    point: Point3::new((u - 320.0) / 500.0 * z, (v - 240.0) / 500.0 * z, z),
                    point_index: index,
                    covariance: Matrix3::zeros(),
                }
            };
            let sights: Vec<Sight> = (0..400).map(sight).collect();
            let found = refine_weighted(&sights, &camera, &Isometry3::identity()).unwrap();
            let turn = found.cam_from_world.rotation.scaled_axis();
            let shift = found.cam_from_world.translation.vector;
            let error = Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z);
            error.dot(&(found.covariance.try_inverse().unwrap() * error))
        };
        (0..150).map(trial).sum::<f64>() / 150.0
    }

    /// Dies without the design effect: patches that err together count as many observations.
    #[test]
    fn patches_that_err_together_count_as_few_observations() {
        for shared in [0.0, 0.2, 0.4] {
            let mean = mean_squared_error(shared);
            assert!((6.0 / 2.25..6.0 * 1.56).contains(&mean), "{shared}: {mean}");
        }
    }
}
