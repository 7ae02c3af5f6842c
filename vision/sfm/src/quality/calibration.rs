//! What the photos say of intrinsics: how well they know those that were refined, and what they
//! hold against those that were given.

use std::collections::BTreeMap;

use nalgebra::{DVector, Isometry3, Point3, Vector2};
use volery_estimation::bundle_adjustment::{BundleCamera, BundleObservation, BundlePose};
use volery_estimation::{
    BundleError, BundleOptions, BundleProblem, IntrinsicsRefinement, adjust_bundle,
};
use volery_geometry::{Camera, CameraModel, median};
use volery_scene::{CameraId, Cancelled, ImageId, Progress, SparseModel};

use super::drift::gauge;

/// Change of the focal length by which its certainty is probed.
const PROBE: f64 = 1.03;
/// Steps of a probing adjustment.
const PROBE_ITERATIONS: usize = 15;
/// Sightings that tell a wrong calibration as surely as all, at a part of the cost.
const MAX_SIGHTINGS: usize = 40_000;

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
    let Some((mut free, slot)) = problem_of(model, camera, 1) else { return Ok(None) };
    free.cameras[slot].refine.distortion = true;
    let mut probed = free.clone();
    let focals = free.cameras[slot].camera.model.num_focals();
    for focal in &mut probed.cameras[slot].camera.params_mut()[..focals] {
        *focal *= PROBE;
    }
    let Some(free) = adjusted_cost(&mut free, progress)? else { return Ok(None) };
    let Some(probed) = adjusted_cost(&mut probed, progress)? else { return Ok(None) };
    let freedom = 2.0 * model.num_observations() as f64
        - 3.0 * model.points.len() as f64
        - 6.0 * model.images.len() as f64;
    let rise = (probed - free) / (free / freedom.max(1.0));
    Ok(Some(if rise > 0.0 { (PROBE.ln() / rise.sqrt()).min(1.0) } else { 1.0 }))
}

/// How a model changes when a camera that was held as given may follow the photos.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CalibrationShift {
    /// Focal length that fits, as a multiple of the given one. It trades with the distortion and
    /// may be far off where the poses are not.
    pub focal_factor: f64,
    /// By how much positions move beyond a similarity, root mean square over the images, as a
    /// part of the median depth from which they see their points.
    pub position: f64,
    /// By how much rotations move, median over the images, radians.
    pub rotation: f64,
    /// How many standard deviations lie between the two, each track being one witness.
    pub num_sigmas: f64,
}

/// What the photos hold against intrinsics that were not refined: everything is adjusted with
/// them held and with the focal length and the distortion of `camera` free.
///
/// How far the focal length moves says little: a scene of little depth, or a lens whose
/// distortion is known only roughly, asks for another one while the poses stay. What is measured is
/// the change of the map. Its certainty is that of the score along the way from one adjustment
/// to the other,
///
/// ```text
/// z = Σ g_t / √(Σ g_t²),   g_t = Σ_{i of track t} w_i r_iᵀ (r_i − r'_i)
/// ```
///
/// with the residuals r held and r' free and the weights w of the robust loss. Keypoints of one
/// track err together, so a track is one witness and not as many as it has sightings.
///
/// `None` if the camera sees nothing.
///
/// Source of z: Liang & Zeger, "Longitudinal Data Analysis Using Generalized Linear Models",
/// Biometrika 1986 (the variance from the scores of independent clusters).
pub fn calibration_shift(
    model: &SparseModel,
    camera: CameraId,
    progress: &dyn Progress,
) -> Result<Option<CalibrationShift>, Cancelled> {
    let step = model.num_observations().div_ceil(MAX_SIGHTINGS).max(1);
    let Some((mut held, slot)) = problem_of(model, camera, step) else { return Ok(None) };
    if adjusted_cost(&mut held, progress)?.is_none() {
        return Ok(None);
    }
    let mut free = held.clone();
    let of_camera = &mut free.cameras[slot];
    of_camera.camera = with_distortion(&of_camera.camera);
    of_camera.refine = IntrinsicsRefinement::FOCAL_AND_DISTORTION;
    if adjusted_cost(&mut free, progress)?.is_none() {
        return Ok(None);
    }
    let mut scores = vec![0.0; held.points.len()];
    let mut depths = Vec::with_capacity(held.observations.len());
    for observation in &held.observations {
        let (Some((r, depth)), Some((r_free, _))) =
            (residual(&held, observation), residual(&free, observation))
        else {
            continue;
        };
        scores[observation.point as usize] += r.dot(&(r - r_free)) / (1.0 + r.norm_squared());
        depths.push(depth);
    }
    let Some(depth) = median(&mut depths) else { return Ok(None) };
    let spread = scores.iter().map(|g| g * g).sum::<f64>().sqrt();
    let (position, rotation) = change(model, &held, &free, depth);
    let focal = |problem: &BundleProblem| problem.cameras[slot].camera.mean_focal();
    Ok(Some(CalibrationShift {
        focal_factor: focal(&free) / focal(&held),
        position,
        rotation,
        num_sigmas: if spread > 0.0 { scores.iter().sum::<f64>() / spread } else { 0.0 },
    }))
}

/// The same lens under a model that has terms of distortion.
fn with_distortion(camera: &Camera) -> Camera {
    let model = match camera.model {
        CameraModel::SimplePinhole => CameraModel::SimpleRadial,
        CameraModel::Pinhole => CameraModel::OpenCv,
        _ => return *camera,
    };
    let mut params = camera.params().to_vec();
    params.resize(model.num_params(), 0.0);
    Camera::new(model, camera.width, camera.height, &params).unwrap_or(*camera)
}

/// Residual and depth of a sighting.
fn residual(problem: &BundleProblem, sighting: &BundleObservation) -> Option<(Vector2<f64>, f64)> {
    let pose = &problem.poses[sighting.pose as usize];
    let in_cam = pose.cam_from_world * problem.points[sighting.point as usize];
    let pixel = problem.cameras[pose.camera as usize].camera.project(&in_cam)?;
    Some((pixel - sighting.pixel, in_cam.z))
}

/// How far the poses of `free` lie from those of `held` beyond a similarity: positions, root mean
/// square in depths, and rotations, median in radians.
fn change(
    model: &SparseModel,
    held: &BundleProblem,
    free: &BundleProblem,
    depth: f64,
) -> (f64, f64) {
    let moves = held.poses.iter().zip(&free.poses).flat_map(|(held, free)| {
        let (held, free) = (held.cam_from_world, free.cam_from_world);
        let turn = (free.rotation.inverse() * held.rotation).scaled_axis();
        let shift = (center(&free) - center(&held)) / depth;
        [turn.x, turn.y, turn.z, shift.x, shift.y, shift.z]
    });
    let moved = DVector::from_iterator(6 * held.poses.len(), moves);
    let gauge = gauge(model, depth);
    let beyond = &moved - &gauge * gauge.tr_mul(&moved);
    let of_images = || beyond.as_slice().chunks_exact(6);
    let norm = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    let squares: f64 = of_images().map(|m| norm(&m[3..]).powi(2)).sum();
    let mut rotations: Vec<f64> = of_images().map(|m| norm(&m[..3])).collect();
    ((squares / held.poses.len() as f64).sqrt(), median(&mut rotations).unwrap_or(0.0))
}

fn center(cam_from_world: &Isometry3<f64>) -> Point3<f64> {
    cam_from_world.inverse() * Point3::origin()
}

/// `model` as it stands with every `step`-th point, all intrinsics held, and the place of `camera` in
/// it; `None` if that sees nothing.
fn problem_of(
    model: &SparseModel,
    camera: CameraId,
    step: usize,
) -> Option<(BundleProblem, usize)> {
    let slot_of_camera: BTreeMap<CameraId, u32> = model.cameras.keys().copied().zip(0..).collect();
    let slot_of_image: BTreeMap<ImageId, u32> = model.images.keys().copied().zip(0..).collect();
    let mut problem = BundleProblem {
        cameras: model
            .cameras
            .values()
            .map(|&camera| BundleCamera {
                camera,
                refine: IntrinsicsRefinement::FIXED,
                focal_prior: None,
            })
            .collect(),
        ..BundleProblem::default()
    };
    for image in model.images.values() {
        problem.poses.push(BundlePose {
            cam_from_world: image.cam_from_world,
            camera: *slot_of_camera.get(&image.camera)?,
            constant: false,
            position_prior: None,
            gravity_prior: None,
        });
    }
    let mut sees = false;
    for (point, of_point) in (0..).zip(model.points.values().step_by(step)) {
        problem.points.push(of_point.position);
        for observation in &of_point.track {
            let Some(&pose) = slot_of_image.get(&observation.image) else { continue };
            let image = &model.images[&observation.image];
            let Some(&pixel) = image.keypoints.get(observation.keypoint as usize) else { continue };
            sees |= image.camera == camera;
            problem.observations.push(BundleObservation { pose, point, pixel });
        }
    }
    let slot = *slot_of_camera.get(&camera)?;
    sees.then_some((problem, slot as usize))
}

/// Adjusts `problem` and returns its least robust cost; `None` if that cannot be done.
fn adjusted_cost(
    problem: &mut BundleProblem,
    progress: &dyn Progress,
) -> Result<Option<f64>, Cancelled> {
    let options = BundleOptions { max_iterations: PROBE_ITERATIONS, ..BundleOptions::default() };
    match adjust_bundle(problem, &options, progress) {
        Ok(report) => Ok(Some(report.final_cost)),
        Err(BundleError::Cancelled(cancelled)) => Err(cancelled),
        Err(_) => Ok(None),
    }
}
