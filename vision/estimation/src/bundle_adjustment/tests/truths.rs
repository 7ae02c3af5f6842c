//! Recovery of the truth, robustness, determinism.

use volery_geometry::{CameraModel, Rng, SimdLevel};
use volery_scene::NoProgress;

use super::ring::{add_noise, perturb, pose_errors, ring, rms};
use crate::bundle_adjustment::{
    BundleOptions, BundleProblem, BundleReport, IntrinsicsRefinement, Minimizer, adjust_bundle,
};

const LEAST_SQUARES: BundleOptions =
    BundleOptions { max_iterations: 50, loss_scale_px: None, cost_tolerance: 1e-12 };

fn adjust(problem: &mut BundleProblem, options: &BundleOptions) -> BundleReport {
    adjust_bundle(problem, options, &NoProgress).unwrap()
}

/// P31, P32: Eq. (5) without noise has its minimum at the truth.
#[test]
fn noise_free_truth_is_recovered() {
    for model in CameraModel::ALL {
        let truth = ring(8, 60, model, IntrinsicsRefinement::FIXED);
        let mut problem = truth.clone();
        perturb(&mut problem, 0.02, 0.05);
        assert!(rms(&problem) > 1.0);
        let report = adjust(&mut problem, &LEAST_SQUARES);
        let (center, angle) = pose_errors(&problem, &truth);
        assert!(center < 1e-8 && angle < 1e-8, "{model:?} {center} {angle} {report:?}");
        assert!(report.final_cost < 1e-15 && report.converged, "{report:?}");
    }
}

/// P31: the reported cost is ½ Σ ρ(‖r‖²).
#[test]
fn reported_cost_is_the_formula() {
    let mut problem = ring(4, 30, CameraModel::OpenCv, IntrinsicsRefinement::FIXED);
    add_noise(&mut problem, 0.5);
    perturb(&mut problem, 0.01, 0.02);
    let options = BundleOptions { max_iterations: 3, loss_scale_px: Some(2.0), ..LEAST_SQUARES };
    let cost = |problem: &BundleProblem| -> f64 {
        crate::bundle_adjustment::squared_residuals(problem)
            .iter()
            .map(|s| 0.5 * 4.0 * (s / 4.0).ln_1p())
            .sum()
    };
    let before = cost(&problem);
    let report = adjust(&mut problem, &options);
    assert!((report.initial_cost / before - 1.0).abs() < 1e-12);
    assert!((report.final_cost / cost(&problem) - 1.0).abs() < 1e-9);
    assert!(report.final_cost < report.initial_cost);
}

/// P32: with 0.5 px noise (6 mm at 6 m) the error falls to the noise and every pose comes to
/// within two such errors.
#[test]
fn noise_leaves_poses_within_bars() {
    let truth = ring(12, 150, CameraModel::SimpleRadial, IntrinsicsRefinement::FIXED);
    let mut problem = truth.clone();
    add_noise(&mut problem, 0.5);
    perturb(&mut problem, 0.02, 0.05);
    let before = rms(&problem);
    adjust(&mut problem, &BundleOptions::default());
    // √2 σ per observation, less what the fit takes.
    assert!(rms(&problem) < 0.72 && before > 5.0, "{before} {}", rms(&problem));
    let (center, angle) = pose_errors(&problem, &truth);
    assert!(center < 0.012 && angle < 0.15_f64.to_radians(), "{center} {angle}");
}

/// Shared intrinsics come back from a focal length 6 % too low, for every model.
#[test]
fn shared_intrinsics_are_recovered() {
    for model in CameraModel::ALL {
        let truth = ring(10, 100, model, IntrinsicsRefinement::FOCAL_AND_DISTORTION);
        let mut problem = truth.clone();
        perturb(&mut problem, 0.01, 0.02);
        let start = model.distortion_start();
        for (index, value) in problem.cameras[0].camera.params_mut().iter_mut().enumerate() {
            if index < model.num_focals() {
                *value *= 0.94;
            } else if index >= start {
                *value *= 0.5;
            }
        }
        adjust(&mut problem, &BundleOptions { max_iterations: 300, ..LEAST_SQUARES });
        let (found, truth) = (problem.cameras[0].camera, truth.cameras[0].camera);
        for index in 0..model.num_focals() {
            let (f, t) = (found.params()[index], truth.params()[index]);
            assert!((f - t).abs() < 1e-3, "{model:?} {f} {t}");
        }
        assert_eq!(found.principal_point(), truth.principal_point());
        // The rational model has more coefficients than the image can tell apart.
        if model != CameraModel::FullOpenCv {
            for (f, t) in found.params()[start..].iter().zip(&truth.params()[start..]) {
                assert!((f - t).abs() < 1e-4, "{model:?} {f} {t}");
            }
        }
    }
}

/// Cameras of their own: each image's intrinsics come back.
#[test]
fn intrinsics_per_image_are_recovered() {
    let refine = IntrinsicsRefinement {
        principal_point: true,
        ..IntrinsicsRefinement::FOCAL_AND_DISTORTION
    };
    let mut truth = ring(8, 150, CameraModel::SimpleRadial, refine);
    truth.cameras = vec![truth.cameras[0]; 8];
    for (index, pose) in truth.poses.iter_mut().enumerate() {
        pose.camera = index as u32;
    }
    let mut problem = truth.clone();
    perturb(&mut problem, 0.005, 0.02);
    for camera in &mut problem.cameras {
        camera.camera.params_mut()[0] *= 0.97;
    }
    let report = adjust(&mut problem, &BundleOptions { max_iterations: 500, ..LEAST_SQUARES });
    for camera in &problem.cameras {
        assert!((camera.camera.params()[0] - 500.0).abs() < 0.01, "{camera:?} {report:?}");
    }
}

/// 15 % gross errors leave the poses where the noise puts them.
#[test]
fn outliers_are_resisted() {
    let truth = ring(12, 150, CameraModel::Pinhole, IntrinsicsRefinement::FIXED);
    let mut problem = truth.clone();
    add_noise(&mut problem, 0.5);
    let mut random = Rng::new(17);
    for observation in problem.observations.iter_mut().step_by(7) {
        observation.pixel += random.normal3().xy() * 60.0;
    }
    perturb(&mut problem, 0.005, 0.01);
    let mut plain = problem.clone();
    adjust(&mut problem, &BundleOptions { max_iterations: 100, ..BundleOptions::default() });
    adjust(&mut plain, &LEAST_SQUARES);
    let (center, _) = pose_errors(&problem, &truth);
    let (plain_center, _) = pose_errors(&plain, &truth);
    assert!(center < 0.012 && plain_center > 5.0 * center, "{center} {plain_center}");
}

/// A problem of many chunks, with sparse covisibility.
fn long_strip() -> BundleProblem {
    let mut problem =
        ring(60, 4000, CameraModel::Radial, IntrinsicsRefinement::FOCAL_AND_DISTORTION);
    problem
        .observations
        .retain(|o| (u64::from(o.point) * 60 / 4000 + 64 - u64::from(o.pose)) % 60 < 9);
    add_noise(&mut problem, 0.5);
    perturb(&mut problem, 0.005, 0.02);
    problem
}

/// The same bits for 1, 2 and 4 threads.
#[test]
fn result_does_not_depend_on_threads() {
    let options = BundleOptions { max_iterations: 4, ..BundleOptions::default() };
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut problem = long_strip();
        pool.install(|| adjust(&mut problem, &options));
        problem
    };
    let one = run(1);
    assert!(one.observations.len() > 30_000, "too few for several chunks");
    for threads in [2, 4] {
        let other = run(threads);
        assert!(one == other, "{threads} threads");
    }
}

/// The vectorized and the portable passes take the same way.
#[test]
fn portable_passes_agree() {
    let options = BundleOptions { max_iterations: 4, ..BundleOptions::default() };
    let run = |level: SimdLevel| {
        let problem = long_strip();
        let mut minimizer = Minimizer::new(&problem, &options, None, level).unwrap();
        minimizer.run(&options, &NoProgress).unwrap()
    };
    let (fast, plain) = (run(SimdLevel::detect()), run(SimdLevel::Portable));
    assert!((fast.final_cost / plain.final_cost - 1.0).abs() < 1e-9, "{fast:?} {plain:?}");
}

/// The sparse and the dense factorization solve the same system.
#[test]
fn sparse_and_dense_systems_agree() {
    let options = BundleOptions { max_iterations: 5, ..BundleOptions::default() };
    let mut sparse = long_strip();
    let report = adjust(&mut sparse, &options);
    let mut dense = long_strip();
    let problem = dense.clone();
    let mut minimizer = Minimizer::new(&problem, &options, None, SimdLevel::detect()).unwrap();
    assert!(minimizer.make_dense(), "covisibility of 9 in 60 is sparse");
    let dense_report = minimizer.run(&options, &NoProgress).unwrap();
    let (state, layout) = minimizer.finish();
    state.store(&mut dense, &layout);
    assert!((report.final_cost / dense_report.final_cost - 1.0).abs() < 1e-9);
    let (center, angle) = pose_errors(&sparse, &dense);
    assert!(center < 1e-7 && angle < 1e-7, "{center} {angle}");
}
