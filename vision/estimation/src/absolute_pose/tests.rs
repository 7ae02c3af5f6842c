use nalgebra::{Isometry3, Point2, Point3, Vector2, Vector3, Vector6};
use volery_geometry::{Camera, CameraModel, Rng};

use super::*;
use crate::test_scene::*;

struct View {
    pixels: Vec<Point2<f64>>,
    points: Vec<Point3<f64>>,
    cam_from_world: Isometry3<f64>,
}

/// A random view of a room; the last `num_false` correspondences are wrong.
fn view(random: &mut Rng, camera: &Camera, num_true: usize, num_false: usize, noise: f64) -> View {
    let center = Vector3::from_fn(|i, _| random.range(-1.0, 1.0) * [2.0, 0.5, 1.5][i]);
    let yaw = random.range(-3.0, 3.0);
    let cam_from_world = pose(center, yaw, random.range(-0.2, 0.2), random.range(-0.2, 0.2));
    let (mut pixels, mut points) = (Vec::new(), Vec::new());
    while points.len() < num_true {
        let p = room_point(random);
        let pixel = camera.project(&(cam_from_world * p)).filter(|x| camera.contains(x));
        // A wide lens folds back what lies far outside its image.
        if let Some(pixel) = pixel.filter(|x| {
            let ray = camera.unproject(x).map(|xy| Point3::new(xy.x, xy.y, 1.0));
            let seen = cam_from_world * p;
            ray.is_some_and(|ray| (ray.coords - seen.coords / seen.z).norm() < 1e-6)
        }) {
            pixels.push(pixel + Vector2::new(random.normal(), random.normal()) * noise);
            points.push(p);
        }
    }
    let (w, h) = (f64::from(camera.width), f64::from(camera.height));
    for _ in 0..num_false {
        pixels.push(Point2::new(random.range(0.0, w), random.range(0.0, h)));
        points.push(room_point(random));
    }
    View { pixels, points, cam_from_world }
}

/// ξ with `exp(ξ) · found = truth`, to first order.
fn error(found: &Isometry3<f64>, truth: &Isometry3<f64>) -> Vector6<f64> {
    let d = truth * found.inverse();
    let (w, t) = (d.rotation.scaled_axis(), d.translation.vector);
    Vector6::new(w.x, w.y, w.z, t.x, t.y, t.z)
}

fn cameras() -> Vec<Camera> {
    let new = |model, params: &[f64]| Camera::new(model, 1280, 960, params).unwrap();
    vec![
        camera(),
        new(CameraModel::SimpleRadial, &[900.0, 630.0, 470.0, -0.08]),
        new(CameraModel::OpenCv, &[900.0, 905.0, 640.0, 480.0, -0.2, 0.05, 0.001, -0.002]),
        new(CameraModel::OpenCvFisheye, &[600.0, 600.0, 640.0, 480.0, 0.02, -0.005, 0.0, 0.0]),
    ]
}

#[test]
fn noise_free_gives_the_truth_back() {
    for camera in cameras() {
        let mut random = Rng::new(3);
        let view = view(&mut random, &camera, 60, 20, 0.0);
        let found = estimate_absolute_pose(
            &view.pixels,
            &view.points,
            &camera,
            &AbsolutePoseOptions::default(),
            5,
        )
        .unwrap();
        assert!(
            error(&found.cam_from_world, &view.cam_from_world).norm() < 1e-7,
            "{:?}",
            camera.model
        );
        assert!(found.inliers[..60].iter().all(|&i| i));
        assert_eq!(found.num_inliers, found.inliers.iter().filter(|&&i| i).count());
        assert!(found.covariance.cholesky().is_some());
    }
}

/// A covariance that is too small moves a real drone: the normalized squared error must follow
/// χ² with six degrees of freedom.
#[test]
fn covariance_is_honest() {
    for (noise, num_true, num_false) in
        [(0.5, 100, 0), (1.0, 60, 60), (0.7, 200, 300), (1.0, 25, 10)]
    {
        let camera = camera();
        let (mut inside, mut sum) = (0, 0.0);
        let runs = 200;
        for seed in 0..runs {
            let mut random = Rng::new(seed);
            let view = view(&mut random, &camera, num_true, num_false, noise);
            let found = estimate_absolute_pose(
                &view.pixels,
                &view.points,
                &camera,
                &AbsolutePoseOptions::default(),
                seed,
            )
            .unwrap();
            let e = error(&found.cam_from_world, &view.cam_from_world);
            let nees = e.dot(&(found.covariance.try_inverse().unwrap() * e));
            // The 95 % band of χ²₆.
            inside += usize::from((1.237..14.449).contains(&nees));
            sum += nees;
        }
        let (share, mean) = (inside as f64 / runs as f64, sum / runs as f64);
        println!("noise {noise} {num_true}+{num_false}: {share} in the band, mean {mean:.2}");
        assert!(share > 0.90, "{noise} {num_true}+{num_false}: {share}, mean {mean}");
        assert!((4.8..7.8).contains(&mean), "{noise} {num_true}+{num_false}: {share}, mean {mean}");
    }
}

#[test]
fn nine_in_ten_may_be_wrong() {
    let camera = camera();
    for seed in 0..5 {
        let mut random = Rng::new(seed);
        let view = view(&mut random, &camera, 50, 450, 0.7);
        let found = estimate_absolute_pose(
            &view.pixels,
            &view.points,
            &camera,
            &AbsolutePoseOptions::default(),
            seed,
        )
        .unwrap();
        let e = error(&found.cam_from_world, &view.cam_from_world);
        assert!(e.norm() < 0.03, "{}", e.norm());
    }
}

#[test]
fn too_little_is_said_with_figures() {
    let camera = camera();
    let mut random = Rng::new(1);
    let good = view(&mut random, &camera, 30, 0, 0.5);
    let solve = |pixels: &[Point2<f64>], points: &[Point3<f64>]| {
        estimate_absolute_pose(pixels, points, &camera, &AbsolutePoseOptions::default(), 1)
    };
    let few = AbsolutePoseError::TooFewCorrespondences { got: 0, needed: 4 };
    assert_eq!(solve(&[], &[]), Err(few));
    let few = AbsolutePoseError::TooFewCorrespondences { got: 3, needed: 4 };
    assert_eq!(solve(&good.pixels[..3], &good.points), Err(few));
    let few = AbsolutePoseError::TooFewInliers { num_inliers: 10, total: 10, needed: 12 };
    assert_eq!(solve(&good.pixels[..10], &good.points), Err(few));
    let mut broken = good.points.clone();
    broken[7].y = f64::INFINITY;
    assert_eq!(solve(&good.pixels, &broken), Err(AbsolutePoseError::NotFinite));
    let garbage = view(&mut random, &camera, 0, 40, 0.0);
    let refused = solve(&garbage.pixels, &garbage.points).unwrap_err();
    assert!(
        matches!(refused, AbsolutePoseError::TooFewInliers { num_inliers, total: 40, needed: 12 } if num_inliers < 12)
    );
    let line: Vec<_> = (0..30).map(|i| Point3::new(f64::from(i), 0.0, 5.0)).collect();
    assert!(solve(&good.pixels, &line).is_err());
    let same = vec![Point3::new(1.0, 2.0, 5.0); 30];
    assert!(solve(&good.pixels, &same).is_err());
}

#[test]
fn same_seed_same_answer() {
    let camera = camera();
    let view = view(&mut Rng::new(2), &camera, 60, 60, 0.5);
    let solve = || {
        estimate_absolute_pose(
            &view.pixels,
            &view.points,
            &camera,
            &AbsolutePoseOptions::default(),
            9,
        )
    };
    assert_eq!(solve(), solve());
}

/// Far from the origin f32 scoring would lose the pixels if points were not centered.
#[test]
fn far_from_the_origin_is_as_good() {
    let camera = camera();
    let mut view = view(&mut Rng::new(2), &camera, 60, 30, 0.5);
    let shift = Vector3::new(4.5e5, 5.6e6, 120.0);
    view.points.iter_mut().for_each(|p| *p += shift);
    let found = estimate_absolute_pose(
        &view.pixels,
        &view.points,
        &camera,
        &AbsolutePoseOptions::default(),
        9,
    )
    .unwrap();
    let center = volery_geometry::triangulation::camera_center(&found.cam_from_world);
    let truth = volery_geometry::triangulation::camera_center(&view.cam_from_world) + shift;
    assert!((center - truth).norm() < 0.02, "{}", (center - truth).norm());
}

/// EXIF focal lengths are 5-8 % off, defaults more.
#[test]
fn a_wrong_focal_length_is_mended() {
    let truth = camera();
    for (seed, guess) in [(0, 914.0 * 0.94), (1, 914.0 * 1.3), (2, 914.0 * 0.7), (3, 914.0)] {
        let mut random = Rng::new(seed);
        let view = view(&mut random, &truth, 150, 80, 0.7);
        let guessed = Camera::from_focal(CameraModel::Pinhole, 1280, 960, guess).unwrap();
        let (found, camera) = estimate_absolute_pose_and_focal(
            &view.pixels,
            &view.points,
            &guessed,
            &AbsolutePoseOptions::default(),
            seed,
        )
        .unwrap();
        assert!((camera.mean_focal() / 914.0 - 1.0).abs() < 0.03, "{}", camera.mean_focal());
        let e = error(&found.cam_from_world, &view.cam_from_world);
        assert!(e.norm() < 0.15, "seed {seed}: {}", e.norm());
    }
}
