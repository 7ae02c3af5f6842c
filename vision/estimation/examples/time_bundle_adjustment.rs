//! Time of a bundle adjustment per observation and iteration, on one thread.
//!
//! `cargo run --release -p volery-estimation --example time_bundle_adjustment`
//!
//! CPU time is the thread's own where the system tells it (Linux), so that other work on the
//! machine does not count.

use std::time::Instant;

use nalgebra::{Isometry3, Point2, Point3, UnitQuaternion, Vector3};
use volery_estimation::bundle_adjustment::{
    BundleCamera, BundleObservation, BundleOptions, BundlePose, BundleProblem,
    IntrinsicsRefinement, adjust_bundle,
};
use volery_geometry::{Camera, CameraModel};
use volery_scene::NoProgress;

fn main() {
    // One thread: this one, so that its CPU time is the whole.
    rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .use_current_thread()
        .build_global()
        .expect("the first pool of the process");
    println!("case                                     obs  it    ms/it  us per obs-iteration");
    let fixed = IntrinsicsRefinement::FIXED;
    let free = IntrinsicsRefinement::FOCAL_AND_DISTORTION;
    time("200 images, tracks of 20 anywhere", &scene(200, 20_000, 20, 200, fixed));
    time("200 images, tracks of 20 within 40", &scene(200, 20_000, 20, 40, fixed));
    time("200 images, tracks of 5 within 15", &scene(200, 80_000, 5, 15, fixed));
    time("the same, intrinsics free", &scene(200, 80_000, 5, 15, free));
    time("1000 images, tracks of 5 within 15", &scene(1000, 200_000, 5, 15, fixed));
    time("6 images, 2000 points (local)", &scene(6, 2_000, 5, 6, fixed));
    time("2 images, 200 points", &scene(2, 200, 2, 2, fixed));
}

fn time(name: &str, problem: &BundleProblem) {
    // Plain least squares from a start that is far off keeps every iteration at full work.
    let options =
        BundleOptions { max_iterations: 5, loss_scale_px: Some(1.0), cost_tolerance: 0.0 };
    let mut best = f64::INFINITY;
    let mut num_iterations = 0;
    for _ in 0..3 {
        // Small problems are repeated: the clock of the kernel is coarse.
        let mut copies = vec![problem.clone(); (100_000 / problem.observations.len()).max(1)];
        let start = cpu_seconds();
        for copy in &mut copies {
            let report = adjust_bundle(copy, &options, &NoProgress).expect("a sound problem");
            num_iterations = report.num_iterations;
        }
        best = best.min((cpu_seconds() - start) / copies.len() as f64);
    }
    let per_iteration = best / num_iterations as f64;
    let num_observations = problem.observations.len();
    println!(
        "{name:36} {num_observations:7}  {num_iterations:2} {:8.3} {:8.3}",
        per_iteration * 1e3,
        per_iteration * 1e6 / num_observations as f64
    );
}

/// CPU time of this thread where the kernel tells it, wall time elsewhere.
fn cpu_seconds() -> f64 {
    thread_local!(static START: Instant = Instant::now());
    let nanoseconds = std::fs::read_to_string("/proc/thread-self/schedstat")
        .ok()
        .and_then(|text| text.split(' ').next()?.parse::<f64>().ok());
    nanoseconds.map_or_else(|| START.with(|start| start.elapsed().as_secs_f64()), |ns| ns * 1e-9)
}

/// Cameras on a ring that look outwards and inwards at a band of points; point p is seen by
/// `track` of the `window` cameras nearest to it.
fn scene(
    num_poses: usize,
    num_points: usize,
    track: usize,
    window: usize,
    refine: IntrinsicsRefinement,
) -> BundleProblem {
    let mut seed = 1_u64;
    let mut random = move || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    };
    let camera = Camera::new(CameraModel::SimpleRadial, 1280, 960, &[1000.0, 640.0, 480.0, -0.05])
        .expect("sound parameters");
    let poses: Vec<_> = (0..num_poses)
        .map(|index| {
            let angle = index as f64 / num_poses as f64 * std::f64::consts::TAU;
            let center = Vector3::new(8.0 * angle.cos(), 8.0 * angle.sin(), 0.2 * random());
            let world_from_cam = UnitQuaternion::face_towards(&-center, &-Vector3::z());
            BundlePose {
                cam_from_world: Isometry3::from_parts(center.into(), world_from_cam).inverse(),
                camera: 0,
                constant: false,
                position_prior: None,
                gravity_prior: None,
            }
        })
        .collect();
    let points: Vec<_> = (0..num_points)
        .map(|_| Point3::new(2.0 * random(), 2.0 * random(), 1.5 * random()))
        .collect();
    let mut observations = Vec::new();
    for (index, point) in points.iter().enumerate() {
        let first = ((random() + 1.0) / 2.0 * num_poses as f64) as usize;
        let mut left = track;
        for offset in 0..window {
            let chance = left as f64 / (window - offset) as f64;
            if (random() + 1.0) / 2.0 >= chance {
                continue;
            }
            left -= 1;
            let pose = (first + offset) % num_poses;
            let pixel = camera.project(&(poses[pose].cam_from_world * point)).expect("in front");
            let pixel = Point2::new(pixel.x + random(), pixel.y + random());
            let (pose, point) = (pose as u32, index as u32);
            observations.push(BundleObservation { pose, point, pixel });
        }
    }
    let mut problem = BundleProblem {
        cameras: vec![BundleCamera { camera, refine, focal_prior: None }],
        poses,
        points,
        constant_points: Vec::new(),
        observations,
    };
    for point in &mut problem.points {
        *point += Vector3::new(random(), random(), random()) * 0.05;
    }
    for pose in &mut problem.poses {
        pose.cam_from_world.translation.vector += Vector3::new(random(), random(), random()) * 0.05;
    }
    problem
}
