//! Pose and focal length together, for a camera whose focal length is a guess.

use nalgebra::{Isometry3, Point2, Point3, SVector};
use volery_geometry::{Camera, perturbed};

use super::refinement::{linearized, robust_sigma};
use super::{AbsolutePose, AbsolutePoseError, AbsolutePoseOptions, estimate_absolute_pose};
use crate::ransac::least_squares::{Loss, Normal, levenberg_marquardt};

/// Focal lengths tried, as multiples of the guess, the guess first. A pose at a focal length 8 %
/// off still finds most of its inliers.
const FACTORS: [f64; 9] = [1.0, 0.87, 1.15, 0.76, 1.32, 0.66, 1.52, 0.57, 1.75];
/// Hypotheses per focal length.
const MAX_ITERATIONS_EACH: usize = 2000;
const ROUNDS: usize = 3;
const MAX_STEPS: usize = 30;
const TOLERANCE: f64 = 1e-9;
const CAUCHY_TUNING: f64 = 2.385;
const MIN_SIGMA_PX: f64 = 0.1;

/// [`estimate_absolute_pose`] for a camera whose focal length may be off by up to a factor of 1.8.
///
/// * Returns the pose and `camera` with its refined focal length; the covariance is the pose's at
///   that focal length.
/// * Points on a plane parallel to the image leave focal length and distance undetermined; the
///   answer is then one of many.
///
/// # Errors
///
/// As [`estimate_absolute_pose`].
pub fn estimate_absolute_pose_and_focal(
    pixels: &[Point2<f64>],
    points: &[Point3<f64>],
    camera: &Camera,
    options: &AbsolutePoseOptions,
    seed: u64,
) -> Result<(AbsolutePose, Camera), AbsolutePoseError> {
    let each = AbsolutePoseOptions {
        max_iterations: options.max_iterations.min(MAX_ITERATIONS_EACH),
        ..*options
    };
    let mut best: Option<(AbsolutePose, Camera)> = None;
    let mut refusal = None;
    for factor in FACTORS {
        let candidate = with_focal_factor(camera, factor);
        match estimate_absolute_pose(pixels, points, &candidate, &each, seed) {
            Ok(pose) => {
                let better = best.as_ref().is_none_or(|(b, _)| {
                    (pose.num_inliers, -pose.rms_px) > (b.num_inliers, -b.rms_px)
                });
                if better {
                    best = Some((pose, candidate));
                }
            }
            Err(error) => refusal = refusal.or(Some(error)),
        }
    }
    let Some((mut pose, mut refined)) = best else {
        return Err(refusal.unwrap_or(AbsolutePoseError::NotFinite));
    };
    for _ in 0..ROUNDS {
        let candidate = refine_with_focal(pixels, points, &refined, &pose, options.max_error_px);
        let found = estimate_absolute_pose(pixels, points, &candidate, &each, seed)?;
        if found.num_inliers < pose.num_inliers {
            break;
        }
        (pose, refined) = (found, candidate);
    }
    Ok((pose, refined))
}

fn with_focal_factor(camera: &Camera, factor: f64) -> Camera {
    let mut camera = *camera;
    let num_focals = camera.model.num_focals();
    camera.params_mut()[..num_focals].iter_mut().for_each(|f| *f *= factor);
    camera
}

/// The camera whose focal length, refined with the pose, fits the inliers best.
fn refine_with_focal(
    pixels: &[Point2<f64>],
    points: &[Point3<f64>],
    camera: &Camera,
    pose: &AbsolutePose,
    max_error_px: f64,
) -> Camera {
    let support: Vec<usize> = (0..pose.inliers.len()).filter(|&i| pose.inliers[i]).collect();
    let squared: Vec<f64> = support
        .iter()
        .filter_map(|&i| camera.project(&(pose.cam_from_world * points[i])).map(|p| (i, p)))
        .map(|(i, p)| (p - pixels[i]).norm_squared())
        .collect();
    if squared.is_empty() {
        return *camera;
    }
    let scale = CAUCHY_TUNING * robust_sigma(squared).max(MIN_SIGMA_PX);
    let loss = Loss::Cauchy {
        squared_scale: scale * scale,
        squared_threshold: 4.0 * max_error_px * max_error_px,
    };
    let linearize = |(pose, factor): &(Isometry3<f64>, f64)| {
        let camera = with_focal_factor(camera, *factor);
        let mut normal = Normal::<7>::zero();
        for &i in &support {
            let Some((r, rows)) = linearized(&camera, pose, &points[i], &pixels[i]) else {
                normal.cost += 0.5 * loss.evaluate(f64::INFINITY).0;
                continue;
            };
            let (rho, weight) = loss.evaluate(r.norm_squared());
            normal.cost += 0.5 * rho;
            // d pixel / d ln f is the pixel's offset from the principal point.
            let offset = pixels[i] + r - camera.principal_point();
            for axis in 0..2 {
                let d = rows[axis];
                let row = [d[0], d[1], d[2], d[3], d[4], d[5], offset[axis]];
                normal.add(r[axis], &row, weight);
            }
        }
        normal.finish()
    };
    let apply = |(pose, factor): &(Isometry3<f64>, f64), step: &SVector<f64, 7>| {
        (
            perturbed(pose, &step.fixed_rows::<6>(0).into_owned()),
            factor * step[6].clamp(-0.5, 0.5).exp(),
        )
    };
    let start = (pose.cam_from_world, 1.0);
    let (_, factor) = levenberg_marquardt(start, MAX_STEPS, TOLERANCE, linearize, apply);
    with_focal_factor(camera, factor)
}
