//! A first focal length from fundamental matrices, for cameras nothing is known of, and how far a
//! refined one may be trusted.

use std::collections::BTreeMap;

use nalgebra::Matrix3;
use volery_estimation::bundle_adjustment::{BundleCamera, BundleObservation, BundlePose};
use volery_estimation::{BundleOptions, BundleProblem, IntrinsicsRefinement, adjust_bundle};
use volery_geometry::Camera;
use volery_scene::{CameraId, Cancelled, ImageId, Progress, SparseModel, TwoViewGeometry};

use crate::{SfmCamera, SfmImage};

/// Horizontal fields of view searched, degrees.
const FOV_RANGE_DEG: (f64, f64) = (25.0, 120.0);
/// Steps of the search, evenly spaced in the logarithm of the focal length.
const NUM_STEPS: usize = 80;
/// Inliers of a pair whose fundamental matrix is worth asking.
const MIN_INLIERS: usize = 50;
/// Pairs asked, those with most inliers first.
const MAX_PAIRS: usize = 400;
/// Difference of the singular values of E, relative to their sum, that is mere noise.
const SCALE: f64 = 0.02;
/// The best focal length must explain the pairs so much better than the average one.
const MIN_CONTRAST: f64 = 0.8;

/// Intrinsics to start mapping with: as given, guessed focal lengths replaced by those that turn
/// the fundamental matrices into essential ones.
///
/// An essential matrix has two equal singular values. For guessed cameras of one image size a
/// common focal length is searched that minimizes, over the pairs among them,
///
/// ```text
/// Σ w ρ((σ₁ − σ₂) / (σ₁ + σ₂)),   σ of K₂ᵀ F K₁,   ρ(c) = c² / (c² + s²)
/// ```
///
/// Guesses stay where the pairs do not tell (pure rotation, planes, too few pairs).
///
/// Source: Mendonça & Cipolla, "A Simple Technique for Self-Calibration", CVPR 1999.
pub fn start_cameras(
    images: &[SfmImage],
    cameras: &[SfmCamera],
    pairs: &[TwoViewGeometry],
) -> Vec<Camera> {
    let mut start: Vec<Camera> = cameras.iter().map(|camera| camera.camera).collect();
    let mut done = vec![false; cameras.len()];
    for first in 0..cameras.len() {
        if done[first] || !cameras[first].focal_is_guess || !cameras[first].refine.focal {
            continue;
        }
        let size = |i: usize| (cameras[i].camera.width, cameras[i].camera.height);
        let group: Vec<bool> = (0..cameras.len())
            .map(|i| size(i) == size(first) && cameras[i].focal_is_guess && cameras[i].refine.focal)
            .collect();
        let witnesses = witnesses(images, pairs, &group);
        let focal = best_focal(&start[first], &witnesses);
        for camera in (0..cameras.len()).filter(|&i| group[i]) {
            done[camera] = true;
            if let Some(focal) = focal {
                let num_focals = start[camera].model.num_focals();
                start[camera].params_mut()[..num_focals].fill(focal);
            }
        }
    }
    start
}

/// Fundamental matrices with weights of pairs both of whose cameras are in the group.
fn witnesses(
    images: &[SfmImage],
    pairs: &[TwoViewGeometry],
    group: &[bool],
) -> Vec<(Matrix3<f64>, f64)> {
    let in_group = |id: u32| {
        images
            .get(id as usize)
            .and_then(|image| group.get(image.camera.0 as usize))
            .copied()
            .unwrap_or(false)
    };
    let mut witnesses: Vec<(Matrix3<f64>, f64)> = pairs
        .iter()
        .filter(|pair| pair.num_inliers() >= MIN_INLIERS)
        .filter(|pair| in_group(pair.image1.0) && in_group(pair.image2.0))
        .filter_map(|pair| Some((pair.fundamental?, (pair.num_inliers() as f64).sqrt())))
        .collect();
    witnesses.sort_by(|a, b| b.1.total_cmp(&a.1));
    witnesses.truncate(MAX_PAIRS);
    witnesses
}

fn best_focal(camera: &Camera, witnesses: &[(Matrix3<f64>, f64)]) -> Option<f64> {
    if witnesses.is_empty() {
        return None;
    }
    let focal_of =
        |fov_deg: f64| f64::from(camera.width) / 2.0 / (fov_deg.to_radians() / 2.0).tan();
    let (least, greatest) = (focal_of(FOV_RANGE_DEG.1), focal_of(FOV_RANGE_DEG.0));
    let c = camera.principal_point();
    let cost = |focal: f64| -> f64 {
        let k = Matrix3::new(focal, 0.0, c.x, 0.0, focal, c.y, 0.0, 0.0, 1.0);
        witnesses
            .iter()
            .map(|(f, weight)| {
                let s = (k.transpose() * f * k).singular_values();
                let c = (s[0] - s[1]) / (s[0] + s[1]);
                if c.is_finite() { weight * c * c / (c * c + SCALE * SCALE) } else { *weight }
            })
            .sum()
    };
    let step = (greatest / least).ln() / (NUM_STEPS - 1) as f64;
    let costs: Vec<f64> = (0..NUM_STEPS).map(|i| cost(least * (step * i as f64).exp())).collect();
    let best = (0..NUM_STEPS).min_by(|&a, &b| costs[a].total_cmp(&costs[b]))?;
    let mean = costs.iter().sum::<f64>() / NUM_STEPS as f64;
    // At the rim of the range or on a plateau the pairs tell nothing.
    if best == 0 || best == NUM_STEPS - 1 || costs[best] > MIN_CONTRAST * mean {
        return None;
    }
    // Vertex of the parabola through the best step and its neighbors.
    let (a, b, c) = (costs[best - 1], costs[best], costs[best + 1]);
    let offset = 0.5 * (a - c) / (a - 2.0 * b + c);
    Some(least * (step * (best as f64 + offset.clamp(-1.0, 1.0))).exp())
}

/// Change of the focal length by which its certainty is probed.
const PROBE: f64 = 1.03;
/// Steps of a probing adjustment.
const PROBE_ITERATIONS: usize = 15;

/// Relative standard deviation of the focal length of `camera` in a refined model: the camera is
/// given a focal length three percent longer, everything else (distortion included) adjusts to
/// it, and the rise of the squared residuals tells how much the images mind:
///
/// ```text
/// σ = ln 1.03 / √(Δχ²),   χ² = Σ r² / (χ²₀ / degrees of freedom)
/// ```
///
/// `None` if the camera sees nothing.
pub fn focal_sigma(
    model: &SparseModel,
    camera: CameraId,
    progress: &dyn Progress,
) -> Result<Option<f64>, Cancelled> {
    let Some(free) = cost_with(model, camera, 1.0, progress)? else { return Ok(None) };
    let Some(probed) = cost_with(model, camera, PROBE, progress)? else { return Ok(None) };
    let freedom = 2.0 * model.num_observations() as f64
        - 3.0 * model.points.len() as f64
        - 6.0 * model.images.len() as f64;
    let rise = (probed - free) / (free / freedom.max(1.0));
    Ok(Some(if rise > 0.0 { (PROBE.ln() / rise.sqrt()).min(1.0) } else { 1.0 }))
}

/// Least robust cost with the focal length of `camera` held at `factor` times its value.
fn cost_with(
    model: &SparseModel,
    camera: CameraId,
    factor: f64,
    progress: &dyn Progress,
) -> Result<Option<f64>, Cancelled> {
    let mut problem = BundleProblem::default();
    let mut slot_of_camera: BTreeMap<CameraId, u32> = BTreeMap::new();
    for (&id, intrinsics) in &model.cameras {
        let mut intrinsics = *intrinsics;
        if id == camera {
            let num_focals = intrinsics.model.num_focals();
            intrinsics.params_mut()[..num_focals].iter_mut().for_each(|f| *f *= factor);
        }
        slot_of_camera.insert(id, problem.cameras.len() as u32);
        let refine =
            IntrinsicsRefinement { distortion: id == camera, ..IntrinsicsRefinement::FIXED };
        problem.cameras.push(BundleCamera { camera: intrinsics, refine, focal_prior: None });
    }
    let mut slot_of_image: BTreeMap<ImageId, u32> = BTreeMap::new();
    for (&id, image) in &model.images {
        let Some(&camera) = slot_of_camera.get(&image.camera) else { continue };
        slot_of_image.insert(id, problem.poses.len() as u32);
        problem.poses.push(BundlePose {
            cam_from_world: image.cam_from_world,
            camera,
            constant: false,
            position_prior: None,
            gravity_prior: None,
        });
    }
    for (index, point) in model.points.values().enumerate() {
        problem.points.push(point.position);
        for observation in &point.track {
            let Some(&pose) = slot_of_image.get(&observation.image) else { continue };
            let keypoints = &model.images[&observation.image].keypoints;
            let Some(&pixel) = keypoints.get(observation.keypoint as usize) else { continue };
            problem.observations.push(BundleObservation { pose, point: index as u32, pixel });
        }
    }
    let options = BundleOptions { max_iterations: PROBE_ITERATIONS, ..BundleOptions::default() };
    match adjust_bundle(&mut problem, &options, progress) {
        Ok(report) => Ok(Some(report.final_cost)),
        Err(volery_estimation::BundleError::Cancelled(cancelled)) => Err(cancelled),
        Err(_) => Ok(None),
    }
}
