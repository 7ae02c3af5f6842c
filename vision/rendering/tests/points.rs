//! What a virtual camera sees of points.

mod support;

use nalgebra::{Point2, Point3};
use support::{camera, pose, seen_at};
use volery_geometry::{CameraModel, Rng};
use volery_rendering::{DrawablePoints, VirtualCamera};

/// Points without size take the pixel that the camera model says, for every model.
#[test]
fn points_take_their_pixels() {
    for model in CameraModel::ALL {
        let camera = camera(model);
        let mut rng = Rng::new(2);
        let mut in_cam = Vec::new();
        let mut pixels = Vec::new();
        for number in 0..60 {
            let (column, row) = (5 + 31 * (number % 10), 4 + 40 * (number / 10));
            let [x, y] = [column, row].map(|p| f64::from(p) + rng.range(0.01, 0.99));
            let xy = camera.unproject(&Point2::new(x, y)).unwrap();
            in_cam.push(Point3::new(xy.x, xy.y, 1.0) * rng.range(0.5, 9.0));
            pixels.push(row as usize * 321 + column as usize);
        }
        let points = DrawablePoints {
            positions: seen_at(&in_cam),
            colors: (0..60).map(|n| [n + 1, 0, 0]).collect(),
            radius: 0.0,
        };
        let drawn = VirtualCamera::new(&camera).draw_points(&points, &pose());
        for (number, (&pixel, point)) in pixels.iter().zip(&in_cam).enumerate() {
            assert_eq!(usize::from(drawn.colors[pixel][0]), number + 1, "{model:?}");
            assert!((f64::from(drawn.depth[pixel]) - point.z).abs() < 1e-5 * point.z);
        }
        assert_eq!(drawn.depth.iter().filter(|&&depth| depth > 0.0).count(), 60, "{model:?}");
    }
}

/// A disc is as large as it should be and hides what is behind it, in any order.
#[test]
fn near_discs_hide_far_ones() {
    let camera = camera(CameraModel::Pinhole);
    let at = |x: f64, z: f64| Point3::new(x * z, 0.0, z);
    let mut in_cam = vec![at(0.0, 2.0), at(0.005, 4.0), Point3::new(0.0, 0.0, -1.0)];
    let mut colors = vec![[1; 3], [2; 3], [3; 3]];
    let eye = VirtualCamera::new(&camera);
    let mut areas = Vec::new();
    for _ in 0..2 {
        let points =
            DrawablePoints { positions: seen_at(&in_cam), colors: colors.clone(), radius: 0.05 };
        let drawn = eye.draw_points(&points, &pose());
        areas.push([1, 2, 3].map(|c| drawn.colors.iter().filter(|v| v[0] == c).count()));
        in_cam.reverse();
        colors.reverse();
    }
    assert_eq!(areas[0], areas[1]);
    // π r², r = 0.05 · 240 / 2 pixels.
    assert!(areas[0][0].abs_diff(113) < 12 && areas[0][1] == 0 && areas[0][2] == 0, "{areas:?}");
}

#[test]
fn wild_points_are_not_drawn() {
    let camera = camera(CameraModel::SimpleRadial);
    // The last lies where the lens model folds back into the image.
    let in_cam = [
        Point3::new(f64::NAN, 0.0, 1.0),
        Point3::new(0.0, 0.0, f64::INFINITY),
        Point3::new(2.9, 0.0, 1.0),
    ];
    let points =
        DrawablePoints { positions: seen_at(&in_cam), colors: vec![[9; 3]; 3], radius: 0.1 };
    let drawn = VirtualCamera::new(&camera).draw_points(&points, &pose());
    assert_eq!(drawn.seen_part(), 0.0);
    assert!(drawn.colors.iter().all(|color| *color == [0; 3]));
}
