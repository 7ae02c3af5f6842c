//! Degenerate problems: refused by name, or survived.

use nalgebra::Point3;
use volery_geometry::CameraModel;
use volery_scene::{Cancelled, NoProgress, Progress, Stage};

use super::ring::{perturb, pose_errors, ring};
use crate::bundle_adjustment::{
    BundleError, BundleObservation, BundleOptions, BundleProblem, IntrinsicsRefinement,
    adjust_bundle, squared_residuals,
};

fn small() -> BundleProblem {
    ring(4, 20, CameraModel::SimpleRadial, IntrinsicsRefinement::FIXED)
}

fn adjust(problem: &mut BundleProblem) -> Result<(), BundleError> {
    adjust_bundle(problem, &BundleOptions::default(), &NoProgress).map(|_| ())
}

fn is_finite(problem: &BundleProblem) -> bool {
    problem.points.iter().all(|p| p.coords.iter().all(|v| v.is_finite()))
        && problem
            .poses
            .iter()
            .all(|p| p.cam_from_world.to_homogeneous().iter().all(|v| v.is_finite()))
}

#[test]
fn bad_input_is_refused() {
    assert_eq!(adjust(&mut BundleProblem::default()), Err(BundleError::Empty));
    let mut problem = small();
    problem.observations[3].point = 20;
    assert_eq!(adjust(&mut problem), Err(BundleError::IndexOutOfRange { observation: 3 }));
    let mut problem = small();
    problem.observations[5].pose = 4;
    assert_eq!(adjust(&mut problem), Err(BundleError::IndexOutOfRange { observation: 5 }));
    let mut problem = small();
    problem.poses[0].camera = 1;
    assert_eq!(adjust(&mut problem), Err(BundleError::NoSuchCamera { num_cameras: 1 }));
    let mut problem = small();
    problem.points[2].x = f64::NAN;
    assert_eq!(adjust(&mut problem), Err(BundleError::NotFinite));
    let mut problem = small();
    problem.observations[2].pixel.y = f64::INFINITY;
    assert_eq!(adjust(&mut problem), Err(BundleError::NotFinite));
}

/// One pose, one sighting, a point seen twice by one image, points and poses never seen.
#[test]
fn too_little_information_stays_finite() {
    let mut one_pose = small();
    one_pose.observations.retain(|o| o.pose == 0);
    perturb(&mut one_pose, 0.01, 0.05);
    adjust(&mut one_pose).unwrap();
    assert!(is_finite(&one_pose));

    let mut one_sighting = small();
    one_sighting.observations.truncate(1);
    let twice = one_sighting.observations[0];
    one_sighting
        .observations
        .push(BundleObservation { pixel: twice.pixel.map(|v| v + 1.0), ..twice });
    adjust(&mut one_sighting).unwrap();
    assert!(is_finite(&one_sighting));
    let residuals = squared_residuals(&one_sighting);
    assert!((residuals[0] - 0.5).abs() < 1e-2, "the mean of both: {residuals:?}");
}

/// A point so far off that its rays are parallel neither spoils the rest nor becomes a NaN.
#[test]
fn point_at_infinity_does_no_harm() {
    let truth = small();
    let mut problem = truth.clone();
    perturb(&mut problem, 0.005, 0.02);
    let camera = problem.cameras[0].camera;
    let far = problem.points.len() as u32;
    problem.points.push(Point3::new(1e9, 2e9, 3e8));
    for (pose, p) in truth.poses.iter().enumerate() {
        let in_cam = p.cam_from_world * problem.points[far as usize];
        if let Some(pixel) = camera.project(&in_cam) {
            let pose = pose as u32;
            problem.observations.push(BundleObservation { pose, point: far, pixel });
        }
    }
    adjust(&mut problem).unwrap();
    assert!(is_finite(&problem));
    problem.points.truncate(far as usize);
    let (center, _) = pose_errors(&problem, &truth);
    assert!(center < 1e-5, "{center}");
}

/// A point behind a camera costs a bounded amount and leaves the others alone.
#[test]
fn points_behind_a_camera_are_bounded() {
    let truth = small();
    let mut problem = truth.clone();
    perturb(&mut problem, 0.005, 0.02);
    problem.points[7] = Point3::new(40.0, 3.0, 0.0);
    let report = adjust_bundle(&mut problem, &BundleOptions::default(), &NoProgress).unwrap();
    assert!(report.initial_cost.is_finite() && is_finite(&problem), "{report:?}");
    let (center, _) = pose_errors(&problem, &truth);
    assert!(center < 0.02, "{center}");
}

#[test]
fn cancel_keeps_the_last_accepted_step() {
    struct Cancel;
    impl Progress for Cancel {
        fn report(&self, _stage: Stage, _done: usize, _total: usize) {}
        fn is_cancelled(&self) -> bool {
            true
        }
    }
    let mut problem = small();
    let before = problem.clone();
    let result = adjust_bundle(&mut problem, &BundleOptions::default(), &Cancel);
    assert_eq!(result, Err(BundleError::Cancelled(Cancelled)));
    for (after, before) in problem.poses.iter().zip(&before.poses) {
        assert_eq!(after.cam_from_world, before.cam_from_world);
    }
}
