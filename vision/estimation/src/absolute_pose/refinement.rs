//! Robust refinement of a pose on the true reprojection error, with its covariance.

use nalgebra::{Isometry3, Matrix6, Point2, Point3, Vector2};
use volery_geometry::{Camera, median, perturbed};

use crate::ransac::least_squares::{Loss, Normal, levenberg_marquardt};

/// A refined pose with its support.
#[derive(Debug, Clone, PartialEq)]
pub struct RefinedPose {
    /// The pose.
    pub cam_from_world: Isometry3<f64>,
    /// Per correspondence.
    pub inliers: Vec<bool>,
    /// Number of inliers.
    pub num_inliers: usize,
    /// Root mean square reprojection error of the inliers, pixels.
    pub rms_px: f64,
    /// Covariance of a left perturbation `exp(ξ) · cam_from_world`, ξ = (rotation, translation),
    /// radians and model units.
    pub covariance: Matrix6<f64>,
}

const MAX_ITERATIONS: usize = 30;
const TOLERANCE: f64 = 1e-9;
/// Cauchy's 95 % efficiency under normal noise.
const CAUCHY_TUNING: f64 = 2.385;
/// Localization noise no detector goes below, pixels.
const MIN_SIGMA_PX: f64 = 0.1;
/// Rounds of inlier selection and refinement.
const ROUNDS: usize = 3;

/// Refines a pose over the correspondences within `max_error_px` of it under Cauchy's loss, whose
/// scale follows the residuals.
///
/// * `pixels[i]` (distorted) sees `points[i]` (world).
/// * Returns `None` where fewer than four correspondences support the pose or they leave it
///   undetermined.
pub fn refine_absolute_pose(
    pixels: &[Point2<f64>],
    points: &[Point3<f64>],
    camera: &Camera,
    initial: &Isometry3<f64>,
    max_error_px: f64,
) -> Option<RefinedPose> {
    let n = pixels.len().min(points.len());
    let (pixels, points) = (&pixels[..n], &points[..n]);
    let squared_threshold = max_error_px * max_error_px;
    let residual = |pose: &Isometry3<f64>, i: usize| {
        camera.project(&(pose * points[i])).map(|p| p - pixels[i])
    };
    let squared_errors = |pose: &Isometry3<f64>| -> Vec<f64> {
        (0..n).map(|i| residual(pose, i).map_or(f64::INFINITY, |r| r.norm_squared())).collect()
    };

    let mut pose = *initial;
    let mut sigma = MIN_SIGMA_PX;
    for _ in 0..ROUNDS {
        let errors = squared_errors(&pose);
        let selected: Vec<usize> = (0..n).filter(|&i| errors[i] < squared_threshold).collect();
        if selected.len() < super::MIN_CORRESPONDENCES {
            return None;
        }
        sigma = robust_sigma(selected.iter().map(|&i| errors[i]).collect()).max(MIN_SIGMA_PX);
        let scale = CAUCHY_TUNING * sigma;
        let loss = Loss::Cauchy { squared_scale: scale * scale, squared_threshold };
        let linearize = |pose: &Isometry3<f64>| {
            let mut normal = Normal::<6>::zero();
            for &i in &selected {
                let Some((r, [ju, jv])) = linearized(camera, pose, &points[i], &pixels[i]) else {
                    normal.cost += 0.5 * loss.evaluate(f64::INFINITY).0;
                    continue;
                };
                let (rho, weight) = loss.evaluate(r.norm_squared());
                normal.cost += 0.5 * rho;
                if weight > 0.0 {
                    normal.add(r.x, &ju, weight);
                    normal.add(r.y, &jv, weight);
                }
            }
            normal.finish()
        };
        let refined = levenberg_marquardt(pose, MAX_ITERATIONS, TOLERANCE, linearize, perturbed);
        let moved = (refined.inverse() * pose).translation.vector.norm()
            + refined.rotation.angle_to(&pose.rotation);
        pose = refined;
        if moved < 1e-9 {
            break;
        }
    }

    let errors = squared_errors(&pose);
    let inliers: Vec<bool> = errors.iter().map(|&e| e < squared_threshold).collect();
    let num_inliers = inliers.iter().filter(|&&inlier| inlier).count();
    if num_inliers < super::MIN_CORRESPONDENCES
        || !pose.translation.vector.iter().all(|v| v.is_finite())
    {
        return None;
    }
    let sum: f64 = errors.iter().zip(&inliers).filter(|(_, inlier)| **inlier).map(|(e, _)| e).sum();
    let support: Vec<usize> = (0..n).filter(|&i| inliers[i]).collect();
    let covariance = covariance(pixels, points, camera, &pose, &support, CAUCHY_TUNING * sigma)?;
    Some(RefinedPose {
        cam_from_world: pose,
        inliers,
        num_inliers,
        rms_px: (sum / num_inliers as f64).sqrt(),
        covariance,
    })
}

/// Covariance of the M-estimate: `n/(n−3) · E[ψ²] / E[ψ′]² · (Σ JᵀJ)⁻¹`, two residuals a point.
///
/// Source: Huber & Ronchetti, Robust Statistics, 7.6, for an isotropic residual of two
/// dimensions.
fn covariance(
    pixels: &[Point2<f64>],
    points: &[Point3<f64>],
    camera: &Camera,
    pose: &Isometry3<f64>,
    support: &[usize],
    scale: f64,
) -> Option<Matrix6<f64>> {
    let squared_scale = scale * scale;
    let mut normal = Normal::<6>::zero();
    let (mut squared_influence, mut slope) = (0.0, 0.0);
    for &i in support {
        let (r, [ju, jv]) = linearized(camera, pose, &points[i], &pixels[i])?;
        let squared = r.norm_squared();
        let weight = 1.0 / (1.0 + squared / squared_scale);
        squared_influence += 0.5 * weight * weight * squared;
        slope += weight - weight * weight * squared / squared_scale;
        normal.add(r.x, &ju, 1.0);
        normal.add(r.y, &jv, 1.0);
    }
    let n = support.len() as f64;
    let variance = (squared_influence / n) / (slope / n).powi(2) * n / (n - 3.0);
    let variance = variance.max(MIN_SIGMA_PX * MIN_SIGMA_PX);
    let inverse = normal.finish().hessian.cholesky()?.inverse();
    let covariance = inverse * variance;
    covariance.iter().all(|v| v.is_finite()).then_some(covariance)
}

/// Median-based standard deviation per coordinate from squared norms of two-dimensional
/// residuals: the median of χ²₂ is 2 ln 2. Zero without residuals.
pub(super) fn robust_sigma(mut squared: Vec<f64>) -> f64 {
    (median(&mut squared).unwrap_or(0.0) / (2.0 * std::f64::consts::LN_2)).sqrt()
}

/// Residual and the rows of its derivative by a left perturbation.
pub(super) fn linearized(
    camera: &Camera,
    pose: &Isometry3<f64>,
    point: &Point3<f64>,
    pixel: &Point2<f64>,
) -> Option<(Vector2<f64>, [[f64; 6]; 2])> {
    let p = pose * point;
    let projection = camera.project_with_jacobians(&p)?;
    let rows = [0, 1].map(|row| {
        let d = projection.d_point.row(row).transpose();
        // exp(ξ) p ≈ p + ω × p + τ
        let w = p.coords.cross(&d);
        [w.x, w.y, w.z, d.x, d.y, d.z]
    });
    Some((projection.pixel - pixel, rows))
}
