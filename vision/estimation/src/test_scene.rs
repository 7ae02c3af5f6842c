//! Scenes with known truth for the tests of this crate.

use nalgebra::{Isometry3, Point2, Point3, UnitQuaternion, Vector2, Vector3};
use volery_geometry::{Camera, CameraModel, Rng};
use volery_scene::FeatureMatch;

/// 70 degrees across 1280 pixels.
pub(crate) fn camera() -> Camera {
    Camera::from_focal(CameraModel::Pinhole, 1280, 960, 914.0).unwrap()
}

/// A random point of a room of 8 x 6 x 3 meters, the camera's y down, seen from its middle: three
/// in four on walls, floor or ceiling, the others on things in it.
pub(crate) fn room_point(random: &mut Rng) -> Point3<f64> {
    let half = Vector3::new(4.0, 1.5, 3.0);
    let mut p = Vector3::from_fn(|i, _| random.range(-half[i], half[i]));
    if random.uniform() < 0.25 && p.norm() > 1.0 {
        return Point3::from(p);
    }
    let axis = [0, 0, 2, 2, 2, 2, 1][random.index(7)];
    p[axis] = if random.uniform() < 0.5 { half[axis] } else { -half[axis] };
    Point3::from(p)
}

/// A pose with its center at `center`, turned by `yaw`, `pitch`, `roll`: `cam_from_world`.
pub(crate) fn pose(center: Vector3<f64>, yaw: f64, pitch: f64, roll: f64) -> Isometry3<f64> {
    let world_from_cam = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), yaw)
        * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), pitch)
        * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), roll);
    Isometry3::from_parts(center.into(), world_from_cam).inverse()
}

/// Two images of one scene with their putative matches.
pub(crate) struct Pair {
    pub(crate) pixels1: Vec<Point2<f64>>,
    pub(crate) pixels2: Vec<Point2<f64>>,
    pub(crate) matches: Vec<FeatureMatch>,
    /// Matches before this index are right.
    pub(crate) num_true: usize,
    pub(crate) cam2_from_cam1: Isometry3<f64>,
}

/// `num_true` points that both cameras see, with noise, then `num_false` random matches.
pub(crate) fn pair(
    random: &mut Rng,
    poses: [Isometry3<f64>; 2],
    mut point: impl FnMut(&mut Rng) -> Point3<f64>,
    num_true: usize,
    num_false: usize,
    noise_px: f64,
) -> Pair {
    let camera = camera();
    let (mut pixels1, mut pixels2) = (Vec::new(), Vec::new());
    let mut tries = 0;
    while pixels1.len() < num_true {
        tries += 1;
        assert!(tries < 1_000_000, "the cameras share no view");
        let p = point(random);
        let seen = |pose: &Isometry3<f64>| {
            camera.project(&(pose * p)).filter(|pixel| camera.contains(pixel))
        };
        if let (Some(a), Some(b)) = (seen(&poses[0]), seen(&poses[1])) {
            let noise = |r: &mut Rng| Vector2::new(r.normal(), r.normal()) * noise_px;
            pixels1.push(a + noise(random));
            pixels2.push(b + noise(random));
        }
    }
    for _ in 0..num_false {
        let anywhere = |r: &mut Rng| Point2::new(r.range(0.0, 1280.0), r.range(0.0, 960.0));
        pixels1.push(anywhere(random));
        pixels2.push(anywhere(random));
    }
    let matches =
        (0..pixels1.len() as u32).map(|i| FeatureMatch { feature1: i, feature2: i }).collect();
    let cam2_from_cam1 = poses[1] * poses[0].inverse();
    Pair { pixels1, pixels2, matches, num_true, cam2_from_cam1 }
}

/// Angle between two directions, degrees.
pub(crate) fn degrees_between(a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    a.angle(b).to_degrees()
}
