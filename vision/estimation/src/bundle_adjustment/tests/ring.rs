//! A ring of cameras that look at a cloud of points from everywhere.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use volery_geometry::{
    Camera, CameraModel, Rng, similarity_from_points, triangulation::camera_center,
};

use crate::bundle_adjustment::{
    BundleCamera, BundleObservation, BundlePose, BundleProblem, IntrinsicsRefinement,
};

pub(super) fn camera(model: CameraModel) -> Camera {
    let mut params = vec![500.0, 505.0];
    params.truncate(model.num_focals());
    params.extend([320.0, 240.0]);
    let distortion = [-0.05, 0.02, 0.001, -0.002, 0.003, 0.01, 0.003, 0.002];
    params.extend(&distortion[..model.num_params() - params.len()]);
    Camera::new(model, 640, 480, &params).unwrap()
}

/// Noise-free sightings of every point by every camera of the ring.
pub(super) fn ring(
    num_poses: usize,
    num_points: usize,
    model: CameraModel,
    refine: IntrinsicsRefinement,
) -> BundleProblem {
    let mut random = Rng::new(7);
    let camera = camera(model);
    let poses: Vec<BundlePose> = (0..num_poses)
        .map(|index| {
            let angle = index as f64 / num_poses as f64 * std::f64::consts::TAU;
            let height = 0.7 * (2.0 * angle).sin() + 0.3 * random.range(-1.0, 1.0);
            let center = Point3::new(6.0 * angle.cos(), 6.0 * angle.sin(), height);
            let world_from_cam = UnitQuaternion::face_towards(&-center.coords, &-Vector3::z());
            BundlePose {
                cam_from_world: Isometry3::from_parts(Translation3::from(center), world_from_cam)
                    .inverse(),
                camera: 0,
                constant: false,
                position_prior: None,
                gravity_prior: None,
            }
        })
        .collect();
    let points: Vec<_> = (0..num_points)
        .map(|_| {
            1.5 * Point3::new(
                random.range(-1.0, 1.0),
                random.range(-1.0, 1.0),
                random.range(-1.0, 1.0),
            )
        })
        .collect();
    let mut observations = Vec::new();
    for (pose, p) in poses.iter().enumerate() {
        for (point, x) in points.iter().enumerate() {
            let pixel = camera.project(&(p.cam_from_world * x)).unwrap();
            observations.push(BundleObservation { pose: pose as u32, point: point as u32, pixel });
        }
    }
    BundleProblem {
        cameras: vec![BundleCamera { camera, refine, focal_prior: None }],
        poses,
        points,
        constant_points: Vec::new(),
        observations,
    }
}

/// Moves all that is free: rotations and centers by about `pose_sigma`, points by `point_sigma`.
pub(super) fn perturb(problem: &mut BundleProblem, pose_sigma: f64, point_sigma: f64) {
    let mut random = Rng::new(11);
    for pose in problem.poses.iter_mut().filter(|pose| !pose.constant) {
        let turn = UnitQuaternion::from_scaled_axis(random.normal3() * pose_sigma);
        let shift = Translation3::from(random.normal3() * pose_sigma);
        pose.cam_from_world = Isometry3::from_parts(shift, turn) * pose.cam_from_world;
    }
    for index in 0..problem.points.len() {
        let step = random.normal3() * point_sigma;
        if !problem.is_constant_point(index as u32) {
            problem.points[index] += step;
        }
    }
}

/// Gaussian pixel noise.
pub(super) fn add_noise(problem: &mut BundleProblem, sigma_px: f64) {
    let mut random = Rng::new(13);
    for observation in &mut problem.observations {
        let noise = random.normal3();
        observation.pixel += noise.xy() * sigma_px;
    }
}

/// Greatest distance of a center and greatest rotation error (radians) once the gauge is aligned.
pub(super) fn pose_errors(found: &BundleProblem, truth: &BundleProblem) -> (f64, f64) {
    let centers = |problem: &BundleProblem| -> Vec<_> {
        problem.poses.iter().map(|p| camera_center(&p.cam_from_world)).collect()
    };
    let truth_from_found = similarity_from_points(&centers(found), &centers(truth)).unwrap();
    let mut worst = (0.0_f64, 0.0_f64);
    for (f, t) in found.poses.iter().zip(&truth.poses) {
        let center = truth_from_found * camera_center(&f.cam_from_world);
        worst.0 = worst.0.max((center - camera_center(&t.cam_from_world)).norm());
        let rotation = f.cam_from_world.rotation * truth_from_found.isometry.rotation.inverse();
        worst.1 = worst.1.max(rotation.angle_to(&t.cam_from_world.rotation));
    }
    worst
}

/// Root mean square of the reprojection errors, pixels.
pub(super) fn rms(problem: &BundleProblem) -> f64 {
    let squared = super::super::squared_residuals(problem);
    (squared.iter().sum::<f64>() / squared.len() as f64).sqrt()
}
