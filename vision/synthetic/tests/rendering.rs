//! Images of a hall against the geometry they show.

use nalgebra::{Isometry3, Point2, Point3, Vector3};
use volery_geometry::triangulation::camera_center;
use volery_geometry::{Camera, CameraModel};
use volery_synthetic::{Hall, Renderer, Rendering, Rng, Sensor, cam_from_heading};

fn hall() -> Hall {
    Hall::standard(0.006, 3)
}

fn pinhole() -> Camera {
    Camera::from_focal(CameraModel::Pinhole, 320, 240, 230.0).unwrap()
}

fn distorted() -> Camera {
    let params = [228.0, 231.0, 163.0, 117.0, -0.21, 0.06, 0.001, -0.0015];
    Camera::new(CameraModel::OpenCv, 320, 240, &params).unwrap()
}

fn pose(x: f64, y: f64, yaw: f64) -> Isometry3<f64> {
    cam_from_heading(&Point3::new(x, y, 1.5), yaw, 0.03, -0.02)
}

/// Depth is along the camera's z, by the slab method over all boxes (oracle).
fn true_depth(
    hall: &Hall,
    camera: &Camera,
    cam_from_world: &Isometry3<f64>,
    pixel: &Point2<f64>,
) -> f64 {
    let xy = camera.unproject(pixel).unwrap();
    let ray = cam_from_world.rotation.inverse() * Vector3::new(xy.x, xy.y, 1.0);
    let center = camera_center(cam_from_world);
    let (_, wall) = hall.room.shell().span(&center, &ray).unwrap();
    let boxes = hall.room.furniture.iter().filter_map(|cuboid| cuboid.span(&center, &ray));
    boxes.filter(|(enter, _)| *enter > 0.0).map(|(enter, _)| enter).fold(wall, f64::min)
}

#[test]
fn depth_is_exact_for_every_lens() {
    let hall = hall();
    let pose = pose(0.4, -0.3, 0.7);
    for camera in [pinhole(), distorted()] {
        let image = Renderer::new(&camera).render(&hall, &pose);
        for k in (0..320 * 240).step_by(7) {
            let pixel = Point2::new((k % 320) as f64 + 0.5, (k / 320) as f64 + 0.5);
            let truth = true_depth(&hall, &camera, &pose, &pixel);
            let depth = f64::from(image.depth[k]);
            assert!((depth / truth - 1.0).abs() < 1e-5, "{pixel}: {depth} is not {truth}");
        }
    }
}

fn luma(image: &Rendering, x: usize, y: usize) -> f64 {
    let c = image.colors[y * image.width as usize + x];
    f64::from(0.299 * c[0] + 0.587 * c[1] + 0.114 * c[2])
}

/// Bilinear luma at a pixel position, with its gradient.
fn luma_at(image: &Rendering, pixel: &Point2<f64>) -> Option<(f64, [f64; 2])> {
    let (x, y) = (pixel.x - 0.5, pixel.y - 0.5);
    let (i, j) = (x.floor(), y.floor());
    let inside = i >= 0.0
        && j >= 0.0
        && i + 2.0 < f64::from(image.width)
        && j + 2.0 < f64::from(image.height);
    inside.then(|| {
        let (fx, fy) = (x - i, y - j);
        let at = |di: usize, dj: usize| luma(image, i as usize + di, j as usize + dj);
        let (a, b, c, d) = (at(0, 0), at(1, 0), at(0, 1), at(1, 1));
        let value =
            a * (1.0 - fx) * (1.0 - fy) + b * fx * (1.0 - fy) + c * (1.0 - fx) * fy + d * fx * fy;
        (value, [(b - a) * (1.0 - fy) + (d - c) * fy, (c - a) * (1.0 - fx) + (d - b) * fx])
    })
}

/// Two views of one hall, lifted by depth and projected, show the same texture at the same
/// place: the least-squares shift between them vanishes. Dies if pixel centers are off by half.
#[test]
fn textures_stick_to_surfaces_to_a_fiftieth_of_a_pixel() {
    let hall = hall();
    let pose1 = pose(0.4, -0.3, 0.7);
    let (camera1, camera2) = (pinhole(), distorted());
    let image1 = Renderer::new(&camera1).render(&hall, &pose1);
    for (camera2, pose2) in [(camera1, pose(0.43, -0.28, 0.72)), (camera2, pose(0.2, -0.4, 0.6))] {
        let image2 = Renderer::new(&camera2).render(&hall, &pose2);
        // Normal equations of d · g = I₁ − I₂ over the shift d.
        let (mut g, mut r) = (nalgebra::Matrix2::zeros(), nalgebra::Vector2::zeros());
        let mut num = 0;
        for k in 0..320 * 240 {
            let pixel1 = Point2::new((k % 320) as f64 + 0.5, (k / 320) as f64 + 0.5);
            let xy = camera1.unproject(&pixel1).unwrap();
            let point = Point3::new(xy.x, xy.y, 1.0) * f64::from(image1.depth[k]);
            let seen = pose2 * (pose1.inverse() * point);
            let Some(pixel2) = camera2.project(&seen) else { continue };
            let Some((value, gradient)) = luma_at(&image2, &pixel2) else { continue };
            let truth = true_depth(&hall, &camera2, &pose2, &pixel2);
            if (truth / seen.z - 1.0).abs() > 1e-3 {
                continue; // hidden in view 2
            }
            let (gradient, residual) =
                (nalgebra::Vector2::from(gradient), luma(&image1, k % 320, k / 320) - value);
            if residual.abs() < 20.0 {
                g += gradient * gradient.transpose();
                r += gradient * residual;
                num += 1;
            }
        }
        assert!(num > 40_000, "{num}");
        let shift = g.try_inverse().unwrap() * r;
        assert!(shift.norm() < 0.02, "{shift}");
    }
}

#[test]
fn images_do_not_depend_on_the_number_of_threads() {
    let with_threads = |n: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
        pool.install(|| {
            let image = Renderer::new(&pinhole()).render(&hall(), &pose(0.0, 0.0, 2.0));
            Sensor::default().expose(&image, 5)
        })
    };
    assert_eq!(with_threads(1), with_threads(3));
}

#[test]
fn the_sensor_adds_the_stated_noise_and_gain() {
    let (width, height) = (200, 100);
    let flat = Rendering {
        width,
        height,
        colors: vec![[128.0; 3]; 20_000],
        depth: vec![1.0; 20_000],
        cam_from_world: Isometry3::identity(),
    };
    let sensor = Sensor { vignetting: 0.0, gain: 0.5, noise: 4.0, blur_px: 0.7 };
    let photo = sensor.expose(&flat, 1);
    let mean = photo.rgb.iter().map(|c| f64::from(c[1])).sum::<f64>() / 20_000.0;
    let variance =
        photo.rgb.iter().map(|c| (f64::from(c[1]) - mean).powi(2)).sum::<f64>() / 20_000.0;
    assert!((mean - 64.0).abs() < 0.15, "{mean}");
    // Half the light has 0.25 + 0.75 / 2 of the variance; rounding adds 1/12.
    let expected = 16.0 * 0.625 + 1.0 / 12.0;
    assert!((variance / expected - 1.0).abs() < 0.05, "{variance}");
    assert_ne!(photo, sensor.expose(&flat, 2));
}

/// Every direction shows enough to be matched: gradients everywhere, and no two walls alike.
#[test]
fn every_view_has_texture() {
    let hall = Hall::furnished(Vector3::new(10.0, 8.0, 3.8), 0.012, 1);
    let renderer = Renderer::new(&pinhole());
    let mut rng = Rng::new(1);
    for k in 0..12 {
        let center = Point3::new(rng.range(-1.0, 1.0), rng.range(-1.0, 1.0), 1.6);
        let image =
            renderer.render(&hall, &cam_from_heading(&center, 0.52 * f64::from(k), 0.0, 0.0));
        let mut textured = 0;
        for y in 0..239 {
            for x in 0..319 {
                let g = (luma(&image, x + 1, y) - luma(&image, x, y)).abs()
                    + (luma(&image, x, y + 1) - luma(&image, x, y)).abs();
                textured += usize::from(g > 6.0);
            }
        }
        assert!(textured > 320 * 240 / 6, "view {k}: {textured}");
        assert!(image.depth.iter().all(|d| *d > 0.3 && *d < 12.0));
    }
}
