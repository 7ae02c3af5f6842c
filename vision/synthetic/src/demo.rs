//! A small hall with a scan and queries: the stage of the demo and of end-to-end tests.

use std::f64::consts::TAU;

use nalgebra::{Isometry3, Point3, Vector3};
use volery_geometry::{Camera, CameraModel};
use volery_scene::ImagePrior;

use crate::flight::{along_wall, cam_from_heading, yaw_scan};
use crate::telemetry::{TelemetryNoise, telemetry};
use crate::{CenterMotion, Hall, Photo, Renderer, Rendering, Rng, Sensor};

/// Edge of a texel of the painted surfaces, meters.
const TEXEL: f64 = 0.006;
/// Seconds between two images.
const INTERVAL_S: f64 = 0.5;

/// A hall, a flight that scans it as the paper does (P34, P35), and photos to localize.
#[derive(Debug, Clone)]
pub struct DemoHall {
    /// What is seen.
    pub hall: Hall,
    /// One camera for all images.
    pub renderer: Renderer,
    /// Take-off, a yaw station, a circle and a run along the wall, in the order of flight.
    pub scan: Vec<Shot>,
    /// Other places, heights and headings.
    pub queries: Vec<Shot>,
}

/// One photo to be taken.
#[derive(Debug, Clone, PartialEq)]
pub struct Shot {
    /// File name.
    pub name: String,
    /// True pose.
    pub cam_from_world: Isometry3<f64>,
    /// Noisy telemetry.
    pub prior: ImagePrior,
    /// Lens and exposure.
    pub sensor: Sensor,
    /// Seed of the noise.
    pub seed: u64,
}

impl DemoHall {
    /// The hall of `seed`: 10 x 8 x 3.8 m, 52 scan images and 8 queries of 640x480 pixels.
    pub fn new(seed: u64) -> Self {
        Self {
            hall: Hall::furnished(Vector3::new(10.0, 8.0, 3.8), TEXEL, seed),
            renderer: Renderer::new(&Self::default_camera()),
            scan: shots("scan", scan_flight(seed), seed),
            queries: shots("query", query_poses(seed), seed ^ 0x5155_4552),
        }
    }

    /// The camera before any hall is built.
    pub fn default_camera() -> Camera {
        Camera::from_focal(CameraModel::Pinhole, 640, 480, 457.0).expect("constants are valid")
    }

    /// The camera.
    pub fn camera(&self) -> &Camera {
        self.renderer.camera()
    }

    /// The ideal image of a shot, with exact depth.
    pub fn render(&self, shot: &Shot) -> Rendering {
        self.renderer.render(&self.hall, &shot.cam_from_world)
    }

    /// The photo of a shot.
    pub fn photo(&self, shot: &Shot) -> Photo {
        shot.sensor.expose(&self.render(shot), shot.seed)
    }
}

/// Climbs by a meter, turns once at a station, flies a circle while looking outward, then along
/// the rack.
fn scan_flight(seed: u64) -> Vec<Isometry3<f64>> {
    let station = Point3::new(-0.6, 0.1, 1.6);
    let mut rng = Rng::fork(seed, 0x66);
    let mut poses: Vec<_> = (0..4)
        .map(|step| {
            let drift = 0.03 * Vector3::new(rng.normal(), rng.normal(), 0.0);
            let height = Vector3::z() * (0.28 * f64::from(step) - 1.1);
            cam_from_heading(
                &(station + drift + height),
                0.0,
                0.01 * rng.normal(),
                0.01 * rng.normal(),
            )
        })
        .collect();
    let wobble = CenterMotion::Wobble { sigma: 0.05 };
    poses.extend(yaw_scan(&station, 20, TAU / 20.0, wobble, seed));
    let circle = CenterMotion::Circle { radius: 0.9 };
    poses.extend(yaw_scan(&Point3::new(0.2, -0.1, 1.65), 18, TAU / 18.0, circle, seed ^ 1));
    poses.extend(along_wall(&Point3::new(-2.4, 0.7, 1.6), 0.0, 0.5, 10, seed));
    poses
}

fn query_poses(seed: u64) -> Vec<Isometry3<f64>> {
    let mut rng = Rng::fork(seed, 0x71);
    (0..8)
        .map(|index| {
            let place =
                Vector3::new(rng.range(-1.9, 1.9), rng.range(-1.2, 1.2), rng.range(1.1, 2.1));
            let yaw = TAU * (index as f64 + rng.uniform()) / 8.0;
            let (pitch, roll) = (0.03 * rng.normal(), 0.02 * rng.normal());
            cam_from_heading(&Point3::from(place), yaw, pitch, roll)
        })
        .collect()
}

fn shots(prefix: &str, poses: Vec<Isometry3<f64>>, seed: u64) -> Vec<Shot> {
    let priors = telemetry(&poses, INTERVAL_S, &TelemetryNoise::default(), seed);
    let mut rng = Rng::fork(seed, 0x73);
    poses
        .into_iter()
        .zip(priors)
        .enumerate()
        .map(|(index, (cam_from_world, prior))| Shot {
            name: format!("{prefix}_{index:04}.png"),
            cam_from_world,
            prior,
            sensor: Sensor { gain: rng.range(0.9, 1.1) as f32, ..Sensor::default() },
            seed: rng.bits(),
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use volery_geometry::triangulation::camera_center;

    use super::*;

    #[test]
    fn the_flight_stays_clear_and_climbs_a_meter() {
        let demo = DemoHall::new(7);
        assert_eq!((demo.scan.len(), demo.queries.len()), (52, 8));
        let mut heights = Vec::new();
        for shot in demo.scan.iter().chain(&demo.queries) {
            let center = camera_center(&shot.cam_from_world);
            assert!(demo.hall.room.is_free(&center, 0.3), "{}: {center}", shot.name);
            heights.push(center.z);
        }
        let climb = heights.iter().copied().fold(f64::MIN, f64::max)
            - heights.iter().copied().fold(f64::MAX, f64::min);
        assert!(climb > 1.0, "{climb}");
        let photo = demo.photo(&demo.queries[0]);
        assert_eq!(photo.gray().pixels().len(), 640 * 480);
    }
}
