//! Where a camera flies: the scans of the paper and a few more.
//!
//! All functions return `cam_from_world`, one per image, in the order of flight.

use std::f64::consts::{FRAC_PI_2, TAU};

use nalgebra::{Isometry3, Point3, Vector3};
use volery_geometry::frames::enu_from_camera;

use crate::{Rng, Room};

/// Standard deviation of pitch and roll of a hovering drone, radians.
const HOVER_TILT: f64 = 0.5 * std::f64::consts::PI / 180.0;

/// How the camera center moves while the drone turns in place (P34).
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CenterMotion {
    /// Not at all: no parallax.
    Spin,
    /// Randomly, with so many meters of standard deviation per axis.
    Wobble {
        /// Meters.
        sigma: f64,
    },
    /// On a horizontal circle, looking outward.
    Circle {
        /// Meters.
        radius: f64,
    },
}

/// Pose of a camera that looks along `yaw` (clockwise from +y), nose up by `pitch`, right side
/// down by `roll`, radians.
pub fn cam_from_heading(center: &Point3<f64>, yaw: f64, pitch: f64, roll: f64) -> Isometry3<f64> {
    Isometry3::from_parts(center.coords.into(), enu_from_camera(yaw, pitch, roll)).inverse()
}

/// `num_views` images, `step` radians of yaw apart, turning about `center`.
pub fn yaw_scan(
    center: &Point3<f64>,
    num_views: usize,
    step: f64,
    motion: CenterMotion,
    seed: u64,
) -> Vec<Isometry3<f64>> {
    let mut rng = Rng::fork(seed, 0x79);
    (0..num_views)
        .map(|index| {
            let yaw = index as f64 * step;
            let offset = match motion {
                CenterMotion::Spin => Vector3::zeros(),
                CenterMotion::Wobble { sigma } => sigma * rng.normal3(),
                CenterMotion::Circle { radius } => radius * heading(yaw),
            };
            tilted(&(center + offset), yaw, &mut rng)
        })
        .collect()
}

/// `num_views` images on a full circle, looking outward.
pub fn circle(
    center: &Point3<f64>,
    radius: f64,
    num_views: usize,
    seed: u64,
) -> Vec<Isometry3<f64>> {
    yaw_scan(center, num_views, TAU / num_views as f64, CenterMotion::Circle { radius }, seed)
}

/// `num_views` images on a full circle, looking at its center line.
pub fn ring(center: &Point3<f64>, radius: f64, num_views: usize, seed: u64) -> Vec<Isometry3<f64>> {
    let mut rng = Rng::fork(seed, 0x72);
    (0..num_views)
        .map(|index| {
            let angle = TAU * index as f64 / num_views as f64;
            let position = center + radius * heading(angle);
            tilted(&position, angle + TAU / 2.0, &mut rng)
        })
        .collect()
}

/// `num_views` images from `start`, `spacing` meters apart, moving to the right of the heading
/// `yaw` in which the camera looks (P35).
pub fn along_wall(
    start: &Point3<f64>,
    yaw: f64,
    spacing: f64,
    num_views: usize,
    seed: u64,
) -> Vec<Isometry3<f64>> {
    let mut rng = Rng::fork(seed, 0x77);
    let right = heading(yaw + FRAC_PI_2);
    (0..num_views)
        .map(|index| tilted(&(start + right * (spacing * index as f64)), yaw, &mut rng))
        .collect()
}

/// `num_views` images of a walk through the free space of `room`: steps of about `step` meters in
/// smoothly changing directions, looking near the direction of flight.
pub fn random_walk(room: &Room, step: f64, num_views: usize, seed: u64) -> Vec<Isometry3<f64>> {
    /// Clearance to every surface, meters.
    const CLEARANCE: f64 = 0.4;
    let mut rng = Rng::fork(seed, 0x52);
    let mut position = loop {
        let p = Point3::from(Vector3::from_fn(|i, _| room.size[i] * rng.range(-0.5, 0.5)));
        let p = p + Vector3::z() * (room.size.z / 2.0);
        if room.is_free(&p, CLEARANCE) {
            break p;
        }
    };
    let mut yaw = rng.range(0.0, TAU);
    let mut poses = Vec::with_capacity(num_views);
    while poses.len() < num_views {
        poses.push(tilted(&position, yaw, &mut rng));
        let mut spread = 0.15;
        loop {
            let turned = yaw + spread * rng.normal();
            let climb = Vector3::z() * (0.2 * step * rng.normal());
            let next = position + heading(turned) * step + climb;
            if room.is_free(&next, CLEARANCE) {
                (position, yaw) = (next, turned);
                break;
            }
            spread += 0.05;
        }
    }
    poses
}

/// Unit vector of a heading.
pub(crate) fn heading(yaw: f64) -> Vector3<f64> {
    Vector3::new(yaw.sin(), yaw.cos(), 0.0)
}

fn tilted(center: &Point3<f64>, yaw: f64, rng: &mut Rng) -> Isometry3<f64> {
    cam_from_heading(center, yaw, HOVER_TILT * rng.normal(), HOVER_TILT * rng.normal())
}

#[cfg(test)]
mod tests {
    use volery_geometry::triangulation::camera_center;

    use super::*;

    #[test]
    fn a_camera_looks_along_its_heading_with_the_sky_above() {
        let center = Point3::new(1.0, 2.0, 1.5);
        for yaw in [0.0, 0.4, 1.9, 3.5, 6.0] {
            let cam_from_world = cam_from_heading(&center, yaw, 0.0, 0.0);
            let ahead = cam_from_world * (center + heading(yaw) * 2.0);
            assert!((ahead.coords - Vector3::new(0.0, 0.0, 2.0)).norm() < 1e-12);
            let above = cam_from_world * (center + Vector3::z());
            assert!((above.coords + Vector3::y()).norm() < 1e-12);
        }
    }

    #[test]
    fn motions_move_as_they_say() {
        let center = Point3::new(0.0, 0.0, 1.5);
        for pose in yaw_scan(&center, 36, 0.1, CenterMotion::Spin, 1) {
            assert!((camera_center(&pose) - center).norm() < 1e-12);
        }
        for pose in circle(&center, 0.3, 36, 1) {
            let offset = camera_center(&pose) - center;
            assert!((offset.norm() - 0.3).abs() < 1e-12);
            // Outward: the axis of the circle is behind.
            assert!((pose * center).z < -0.29);
        }
        for pose in ring(&center, 2.0, 12, 1) {
            let seen = pose * center;
            assert!((seen.z - 2.0).abs() < 0.01, "{seen}");
        }
        let sigma = 0.05;
        let wobble = CenterMotion::Wobble { sigma };
        let sum: f64 = yaw_scan(&center, 2000, 0.1, wobble, 1)
            .iter()
            .map(|pose| (camera_center(pose) - center).norm_squared())
            .sum();
        assert!(((sum / 6000.0).sqrt() - sigma).abs() < 0.002);
    }

    #[test]
    fn a_walk_stays_in_the_free_space_and_moves() {
        let room = Room::standard();
        let walk = random_walk(&room, 0.2, 100, 4);
        assert_eq!(walk.len(), 100);
        for pair in walk.windows(2) {
            let (a, b) = (camera_center(&pair[0]), camera_center(&pair[1]));
            assert!(room.is_free(&a, 0.3));
            assert!((0.15..0.4).contains(&(a - b).norm()));
        }
    }
}
