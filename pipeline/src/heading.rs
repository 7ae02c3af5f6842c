//! How a flight's compass lies in the map: lets the yaw of a query narrow the search.

use nalgebra::{Isometry3, Vector3};
use serde::{Deserialize, Serialize};
use volery_scene::{AttitudePrior, ImagePrior, SparseModel};

/// Fewest images with pose and attitude that tell the offset.
const MIN_IMAGES: usize = 3;

/// A compass indoors is off by more than it says; so much at least, radians.
const MIN_SIGMA: f64 = 0.1;

/// Yaw in the map of a camera that heads north, with the spread over the mapping images.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct NorthInMap {
    /// Radians, counter-clockwise from map x.
    pub yaw: f64,
    /// Standard deviation of one image, radians.
    pub sigma: f64,
}

impl NorthInMap {
    /// From the mapping images that have an attitude; `prior_of(id)` is theirs.
    pub(crate) fn estimate(model: &SparseModel, priors: &[ImagePrior]) -> Option<Self> {
        let offsets: Vec<f64> = model
            .images
            .iter()
            .filter_map(|(id, image)| {
                let attitude = priors.get(id.0 as usize)?.attitude?;
                Some(yaw_of(&image.cam_from_world.inverse())? + attitude.yaw)
            })
            .collect();
        if offsets.len() < MIN_IMAGES {
            return None;
        }
        let n = offsets.len() as f64;
        let (sin, cos) = offsets.iter().fold((0.0, 0.0), |(s, c), o| (s + o.sin(), c + o.cos()));
        let length = (sin.hypot(cos) / n).clamp(1e-9, 1.0);
        Some(Self { yaw: sin.atan2(cos), sigma: (-2.0 * length.ln()).sqrt() })
    }

    /// Yaw in the map with its sigma of a camera with this attitude, radians.
    pub fn yaw_of(&self, attitude: &AttitudePrior) -> (f64, f64) {
        let yaw = self.yaw - attitude.yaw;
        (yaw.sin().atan2(yaw.cos()), self.sigma.max(attitude.sigma_yaw).max(MIN_SIGMA))
    }
}

/// Yaw of the camera's forward axis; `None` when it looks almost straight up or down.
fn yaw_of(map_from_camera: &Isometry3<f64>) -> Option<f64> {
    let forward = map_from_camera.rotation * Vector3::z();
    (forward.xy().norm() > 0.2).then(|| forward.y.atan2(forward.x))
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use volery_geometry::frames::enu_from_camera;

    use super::*;

    /// In a map whose axes are east and north, a camera heading north has yaw 90 degrees, and one
    /// that has turned clockwise has less.
    #[test]
    fn clockwise_headings_are_negative_yaws() {
        let yaw_at = |heading: f64| {
            let rotation = enu_from_camera(heading, 0.1, 0.05);
            yaw_of(&Isometry3::from_parts(Vector3::zeros().into(), rotation)).unwrap()
        };
        let north = NorthInMap { yaw: FRAC_PI_2, sigma: 0.0 };
        for heading in [0.0, 0.4, -0.7] {
            let attitude = AttitudePrior {
                yaw: heading,
                pitch: 0.1,
                roll: 0.05,
                sigma_yaw: 0.01,
                sigma_tilt: 0.01,
            };
            assert!((north.yaw_of(&attitude).0 - yaw_at(heading)).abs() < 1e-9);
        }
    }
}
