//! Time per stage on one core, beside its budget.

use nalgebra::{Point3, Vector3};
use volery_estimation::bundle_adjustment::{BundleCamera, BundleObservation, BundlePose};
use volery_estimation::{
    BundleOptions, BundleProblem, IntrinsicsRefinement, TwoViewOptions, adjust_bundle,
    estimate_two_view_geometry,
};
use volery_features::{
    MatchOptions, PackedDescriptors, SiftOptions, detect_and_describe, match_features,
};
use volery_geometry::{Camera, CameraModel};
use volery_scene::{Descriptor, GrayImage, ImageId, NoProgress};
use volery_synthetic::{
    Hall, PointOptions, PointScene, Renderer, Rng, Room, Sensor, cam_from_heading, flight,
    paper_camera,
};

use crate::clock::measure;
use crate::table::{Table, figure};

/// Repetitions of a measurement; the best counts, since other work only adds.
const REPEATS: usize = 3;

/// The table of the stages.
pub(crate) fn stages() -> Table {
    let heads = ["stage", "CPU time", "budget", "goal", "measured on"];
    let mut table = Table::new("Time per stage, one core", &heads);
    let mut add = |row: [String; 5]| {
        eprintln!("{}: {}", row[0], row[1]);
        table.add(row.to_vec());
    };
    add(sift());
    add(matching());
    add(two_view());
    add(bundle_adjustment());
    add(rendering());
    table
}

fn best_cpu_s<T>(mut work: impl FnMut() -> T) -> (T, f64) {
    let (mut result, cost) = measure(&mut work);
    let mut best = cost.cpu_s;
    for _ in 1..REPEATS {
        let (again, cost) = measure(&mut work);
        (result, best) = (again, best.min(cost.cpu_s));
    }
    (result, best)
}

fn row(stage: &str, time: String, budget: &str, goal: &str, on: String) -> [String; 5] {
    [stage.to_owned(), time, budget.to_owned(), goal.to_owned(), on]
}

/// A photo of 1.23 megapixels: the first of `sceaux_castle`, or a rendered hall where it is absent.
fn photo() -> (GrayImage, &'static str) {
    let set = volery_tests::SharedSet::open("sceaux_castle");
    let photo = set.and_then(|set| {
        let bytes = std::fs::read(set.images_dir.join(set.images.first()?)).ok()?;
        let limits = volery_formats::DecodeLimits::default();
        let gray = volery_formats::decode_image(&bytes, &limits).ok()?.gray;
        volery_formats::downscale_to_max_side(&gray, 1280).or(Some(gray))
    });
    if let Some(photo) = photo {
        return (photo, "sceaux_castle");
    }
    let hall = Hall::furnished(Vector3::new(10.0, 8.0, 3.8), 0.004, 1);
    let pose = cam_from_heading(&Point3::new(0.0, 0.0, 1.6), 0.0, 0.0, 0.0);
    let ideal = Renderer::new(&paper_camera()).render(&hall, &pose);
    (Sensor::default().expose(&ideal, 1).gray(), "a rendered hall")
}

fn sift() -> [String; 5] {
    let (photo, origin) = photo();
    let (features, cpu_s) = best_cpu_s(|| detect_and_describe(&photo, &SiftOptions::default()));
    let on =
        format!("{} x {} of {origin}, {} features", photo.width(), photo.height(), features.len());
    row("SIFT, doubled first octave", figure(cpu_s, 3, "s"), "0.4 s", "0.25 s", on)
}

fn matching() -> [String; 5] {
    let descriptors = |seed| -> PackedDescriptors {
        let mut rng = Rng::new(seed);
        let one = |_| -> Descriptor { std::array::from_fn(|_| (rng.bits() >> 59) as u8) };
        let all: Vec<Descriptor> = (0..8192).map(one).collect();
        PackedDescriptors::new(&all)
    };
    let (a, b) = (descriptors(1), descriptors(2));
    let (_, cpu_s) = best_cpu_s(|| match_features(&a, &b, &MatchOptions::default()));
    let on = "8192 x 8192 random descriptors, both ways".to_owned();
    row("Exact matching of a pair", figure(cpu_s * 1e3, 1, "ms"), "60 ms", "40 ms", on)
}

fn two_view() -> [String; 5] {
    let room = Room::standard();
    let options =
        PointOptions { num_points: 15_000, wrong_fraction: 0.5, ..PointOptions::default() };
    let poses = flight::along_wall(&Point3::new(-0.5, -0.5, 1.5), 0.3, 0.5, 2, 1);
    let scene = PointScene::observe(&room, &paper_camera(), poses, &options, 1);
    let (_, _, matches) = &scene.matches[0];
    let estimate = || {
        estimate_two_view_geometry(
            ImageId(0),
            &scene.camera,
            &scene.keypoints[0],
            ImageId(1),
            &scene.camera,
            &scene.keypoints[1],
            matches,
            &TwoViewOptions::default(),
            1,
        )
    };
    let (found, cpu_s) = best_cpu_s(estimate);
    let inliers = found.map_or(0, |pair| pair.num_inliers());
    let on = format!("{} matches, half of them wrong, {inliers} inliers", matches.len());
    row("Two-view geometry of a pair", figure(cpu_s * 1e3, 1, "ms"), "", "", on)
}

fn bundle_adjustment() -> [String; 5] {
    let problem = bundle_problem();
    let options =
        BundleOptions { max_iterations: 5, loss_scale_px: Some(1.0), cost_tolerance: 0.0 };
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let one_thread = one_thread.expect("a pool of one thread");
    let solve = || {
        let mut copy = problem.clone();
        adjust_bundle(&mut copy, &options, &NoProgress).map_or(1, |report| report.num_iterations)
    };
    let (iterations, cpu_s) = one_thread.install(|| best_cpu_s(solve));
    let n = problem.observations.len();
    let us = cpu_s * 1e6 / (n * iterations.max(1)) as f64;
    let on = format!("{} images, {n} observations, {iterations} iterations", problem.poses.len());
    let name = "Bundle adjustment per observation and iteration";
    row(name, figure(us, 2, "us"), "1.2 us", "0.6 us", on)
}

/// A walk of 200 images with about 400 thousand observations, moved off its optimum.
fn bundle_problem() -> BundleProblem {
    let room = Room::standard();
    let camera = Camera::from_focal(CameraModel::SimpleRadial, 1280, 960, 914.0);
    let camera = camera.expect("constants are valid");
    let poses = flight::random_walk(&room, 0.15, 200, 1);
    let options =
        PointOptions { num_points: 36_000, min_shared: usize::MAX, ..PointOptions::default() };
    let scene = PointScene::observe(&room, &camera, poses, &options, 1);
    let mut rng = Rng::new(1);
    let mut observations = Vec::new();
    for (pose, pixels) in scene.keypoints.iter().enumerate() {
        for (pixel, &point) in pixels.iter().zip(&scene.point_of_keypoint[pose]) {
            let (pose, point) = (pose as u32, point as u32);
            observations.push(BundleObservation { pose, point, pixel: *pixel });
        }
    }
    let poses = scene.cam_from_world.iter().map(|pose| {
        let mut cam_from_world = *pose;
        cam_from_world.translation.vector += 0.01 * rng.normal3();
        BundlePose {
            cam_from_world,
            camera: 0,
            constant: false,
            position_prior: None,
            gravity_prior: None,
        }
    });
    BundleProblem {
        cameras: vec![BundleCamera {
            camera,
            refine: IntrinsicsRefinement::FIXED,
            focal_prior: None,
        }],
        poses: poses.collect(),
        points: scene.points,
        constant_points: Vec::new(),
        observations,
    }
}

fn rendering() -> [String; 5] {
    let hall = Hall::furnished(Vector3::new(10.0, 8.0, 3.8), 0.006, 1);
    let camera = Camera::from_focal(CameraModel::Pinhole, 640, 480, 457.0);
    let renderer = Renderer::new(&camera.expect("constants are valid"));
    let photos = || {
        for k in 0..8 {
            let pose = cam_from_heading(&Point3::new(0.3, -0.4, 1.6), 0.8 * f64::from(k), 0.0, 0.0);
            Sensor::default().expose(&renderer.render(&hall, &pose), 1);
        }
    };
    let (_, cpu_s) = best_cpu_s(photos);
    let on = format!("640 x 480, {} surfaces, with sensor", hall.num_surfaces());
    row("Synthetic photo", figure(cpu_s / 8.0 * 1e3, 0, "ms"), "60 ms", "", on)
}
