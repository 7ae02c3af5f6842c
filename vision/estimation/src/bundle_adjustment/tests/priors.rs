//! Priors pull, constants stay.

use nalgebra::{Unit, Vector3};
use volery_geometry::{CameraModel, triangulation::camera_center};
use volery_scene::NoProgress;

use super::ring::{add_noise, perturb, ring};
use crate::bundle_adjustment::{BundleOptions, IntrinsicsRefinement, adjust_bundle};

const OPTIONS: BundleOptions =
    BundleOptions { max_iterations: 100, loss_scale_px: None, cost_tolerance: 1e-14 };

/// Positions of three cameras hold the gauge: the whole ring comes back in their frame and scale.
#[test]
fn position_priors_fix_frame_and_scale() {
    let truth = ring(8, 60, CameraModel::Pinhole, IntrinsicsRefinement::FIXED);
    let mut problem = truth.clone();
    for index in [0, 3, 5] {
        let center = camera_center(&truth.poses[index].cam_from_world);
        problem.poses[index].position_prior = Some((center, 0.01));
    }
    perturb(&mut problem, 0.02, 0.05);
    adjust_bundle(&mut problem, &OPTIONS, &NoProgress).unwrap();
    for (found, truth) in problem.poses.iter().zip(&truth.poses) {
        let distance = camera_center(&found.cam_from_world) - camera_center(&truth.cam_from_world);
        assert!(distance.norm() < 1e-6, "{}", distance.norm());
    }
    for (found, truth) in problem.points.iter().zip(&truth.points) {
        assert!((found - truth).norm() < 1e-6);
    }
}

/// Two priors against each other meet at the mean weighted by 1/σ².
#[test]
fn position_priors_are_weighted_by_sigma() {
    let mut problem = ring(2, 1, CameraModel::Pinhole, IntrinsicsRefinement::FIXED);
    let center = camera_center(&problem.poses[0].cam_from_world);
    // One observation of a free point says nothing against a shift.
    problem.observations.truncate(1);
    problem.poses[0].position_prior = Some((center + Vector3::new(0.3, 0.0, 0.0), 0.1));
    adjust_bundle(&mut problem, &OPTIONS, &NoProgress).unwrap();
    let moved = camera_center(&problem.poses[0].cam_from_world) - center;
    assert!((moved - Vector3::new(0.3, 0.0, 0.0)).norm() < 1e-4, "{moved}");
}

/// Gravity levels a tilted reconstruction.
#[test]
fn gravity_priors_level() {
    let truth = ring(8, 60, CameraModel::Pinhole, IntrinsicsRefinement::FIXED);
    let mut problem = truth.clone();
    let tilt = nalgebra::UnitQuaternion::from_euler_angles(0.1, -0.05, 0.0);
    for (pose, truth) in problem.poses.iter_mut().zip(&truth.poses) {
        pose.cam_from_world *= nalgebra::Isometry3::from_parts(Default::default(), tilt.inverse());
        let up = Unit::new_normalize(truth.cam_from_world.rotation * Vector3::z());
        pose.gravity_prior = Some((up, 0.01));
    }
    for point in &mut problem.points {
        *point = tilt * *point;
    }
    adjust_bundle(&mut problem, &OPTIONS, &NoProgress).unwrap();
    for (found, truth) in problem.poses.iter().zip(&truth.poses) {
        let up = found.cam_from_world.rotation * Vector3::z();
        let expected = truth.cam_from_world.rotation * Vector3::z();
        assert!(up.angle(&expected) < 1e-5, "{}", up.angle(&expected));
    }
}

/// A strong focal prior wins over noise, a weak one does not.
#[test]
fn focal_prior_pulls() {
    let refine = IntrinsicsRefinement { focal: true, ..IntrinsicsRefinement::FIXED };
    let focal_with = |sigma: f64| {
        let mut problem = ring(6, 40, CameraModel::SimplePinhole, refine);
        add_noise(&mut problem, 0.3);
        problem.cameras[0].focal_prior = Some((520.0, sigma));
        adjust_bundle(&mut problem, &OPTIONS, &NoProgress).unwrap();
        problem.cameras[0].camera.params()[0]
    };
    assert!((focal_with(1e-3) - 520.0).abs() < 0.01);
    assert!((focal_with(1e4) - 500.0).abs() < 5.0);
}

/// What is constant keeps its bits, the rest comes to it.
#[test]
fn constants_do_not_move() {
    let mut truth = ring(8, 60, CameraModel::OpenCv, IntrinsicsRefinement::FIXED);
    truth.poses[1].constant = true;
    truth.poses[4].constant = true;
    truth.constant_points = (0..60).map(|index| index % 3 == 0).collect();
    let mut problem = truth.clone();
    perturb(&mut problem, 0.02, 0.05);
    let report = adjust_bundle(&mut problem, &OPTIONS, &NoProgress).unwrap();
    assert!(report.final_cost < 1e-12, "{report:?}");
    for index in [1, 4] {
        assert_eq!(problem.poses[index], truth.poses[index]);
    }
    for (index, (found, truth)) in problem.points.iter().zip(&truth.points).enumerate() {
        assert!((found - truth).norm() < 1e-7);
        assert!(index % 3 != 0 || found == truth);
    }
    assert_eq!(problem.cameras, truth.cameras);
}

/// All poses constant: each point is the best triangulation; all points constant: a resection.
#[test]
fn either_side_alone() {
    let truth = ring(5, 40, CameraModel::Radial, IntrinsicsRefinement::FIXED);
    let mut points_only = truth.clone();
    points_only.poses.iter_mut().for_each(|pose| pose.constant = true);
    perturb(&mut points_only, 0.0, 0.1);
    adjust_bundle(&mut points_only, &OPTIONS, &NoProgress).unwrap();
    for (found, truth) in points_only.points.iter().zip(&truth.points) {
        assert!((found - truth).norm() < 1e-8);
    }
    let mut poses_only = truth.clone();
    poses_only.constant_points = vec![true; 40];
    perturb(&mut poses_only, 0.03, 0.0);
    adjust_bundle(&mut poses_only, &OPTIONS, &NoProgress).unwrap();
    for (found, truth) in poses_only.poses.iter().zip(&truth.poses) {
        let difference =
            found.cam_from_world.to_homogeneous() - truth.cam_from_world.to_homogeneous();
        assert!(difference.norm() < 1e-8);
    }
}
