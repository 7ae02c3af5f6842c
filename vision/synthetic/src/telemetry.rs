//! What a drone reports of itself while it takes photos.

use std::fmt::Write;

use nalgebra::Isometry3;
use volery_geometry::frames::yaw_pitch_roll;
use volery_geometry::triangulation::camera_center;
use volery_scene::{AttitudePrior, HeightPrior, ImagePrior, PositionPrior};

use crate::Rng;

/// Errors of telemetry. The yaw error of a compass indoors drifts slowly; the rest is white.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TelemetryNoise {
    /// Standard deviation of the slow part of yaw, radians.
    pub yaw_drift: f64,
    /// Standard deviation of the white part of yaw, radians.
    pub yaw: f64,
    /// Standard deviation of pitch and roll, radians.
    pub tilt: f64,
    /// Standard deviation of the height, meters.
    pub height: f64,
}

impl Default for TelemetryNoise {
    fn default() -> Self {
        let rad = std::f64::consts::PI / 180.0;
        Self { yaw_drift: 1.8 * rad, yaw: 0.87 * rad, tilt: 0.5 * rad, height: 0.03 }
    }
}

/// Attitude, height and time of images that are `interval_s` apart. No positions: indoors there
/// are none.
pub fn telemetry(
    cam_from_world: &[Isometry3<f64>],
    interval_s: f64,
    noise: &TelemetryNoise,
    seed: u64,
) -> Vec<ImagePrior> {
    /// Correlation of the slow yaw error from image to image.
    const MEMORY: f64 = 0.95;
    let mut rng = Rng::fork(seed, 0x74);
    let mut drift = noise.yaw_drift * rng.normal();
    let sigma_yaw = noise.yaw_drift.hypot(noise.yaw);
    let mut priors = Vec::with_capacity(cam_from_world.len());
    for (index, pose) in cam_from_world.iter().enumerate() {
        let [yaw, pitch, roll] = yaw_pitch_roll(&pose.rotation.inverse());
        let attitude = AttitudePrior {
            yaw: yaw + drift + noise.yaw * rng.normal(),
            pitch: pitch + noise.tilt * rng.normal(),
            roll: roll + noise.tilt * rng.normal(),
            sigma_yaw,
            sigma_tilt: noise.tilt,
        };
        let height = HeightPrior {
            height: camera_center(pose).z + noise.height * rng.normal(),
            sigma: noise.height,
        };
        priors.push(ImagePrior {
            attitude: Some(attitude),
            height: Some(height),
            time_s: Some(index as f64 * interval_s),
            ..ImagePrior::default()
        });
        drift = MEMORY * drift + noise.yaw_drift * (1.0 - MEMORY * MEMORY).sqrt() * rng.normal();
    }
    priors
}

/// Adds positions with `sigma` meters of noise per axis, as a motion-capture system gives.
pub fn add_positions(
    priors: &mut [ImagePrior],
    cam_from_world: &[Isometry3<f64>],
    sigma: f64,
    seed: u64,
) {
    let mut rng = Rng::fork(seed, 0x78);
    for (prior, pose) in priors.iter_mut().zip(cam_from_world) {
        let position = camera_center(pose) + sigma * rng.normal3();
        prior.position = Some(PositionPrior { position, sigma });
    }
}

/// `telemetry.csv` of named images: `image,time_s,yaw_deg,pitch_deg,roll_deg,height_m`.
pub fn telemetry_csv<'a>(rows: impl IntoIterator<Item = (&'a str, &'a ImagePrior)>) -> String {
    let mut text = "image,time_s,yaw_deg,pitch_deg,roll_deg,height_m\n".to_owned();
    for (name, prior) in rows {
        let time = prior.time_s.map(|t| format!("{t:.3}")).unwrap_or_default();
        let attitude = prior.attitude.map_or_else(Default::default, |a| {
            let yaw = a.yaw.to_degrees().rem_euclid(360.0);
            [yaw, a.pitch.to_degrees(), a.roll.to_degrees()].map(|v| format!("{v:.3}"))
        });
        let height = prior.height.map(|h| format!("{:.3}", h.height)).unwrap_or_default();
        let [yaw, pitch, roll] = attitude;
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{name},{time},{yaw},{pitch},{roll},{height}");
    }
    text
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::{CenterMotion, yaw_scan};

    #[test]
    fn errors_are_as_large_as_stated() {
        let center = Point3::new(0.0, 0.0, 1.5);
        let poses = yaw_scan(&center, 4000, 0.1, CenterMotion::Wobble { sigma: 0.1 }, 1);
        let noise = TelemetryNoise::default();
        let (mut yaw2, mut pitch2, mut height2) = (0.0, 0.0, 0.0);
        for (pose, prior) in poses.iter().zip(telemetry(&poses, 0.5, &noise, 1)) {
            let [yaw, pitch, _] = yaw_pitch_roll(&pose.rotation.inverse());
            let told = prior.attitude.unwrap();
            yaw2 += f64::sin(told.yaw - yaw).powi(2);
            pitch2 += (told.pitch - pitch).powi(2);
            height2 += (prior.height.unwrap().height - camera_center(pose).z).powi(2);
        }
        let rms = |sum: f64| (sum / 4000.0).sqrt();
        assert!((rms(yaw2).to_degrees() - 2.0).abs() < 0.3);
        assert!((rms(pitch2).to_degrees() - 0.5).abs() < 0.03);
        assert!((rms(height2) - 0.03).abs() < 0.002);
    }

    #[test]
    fn a_row_has_six_columns_even_if_nothing_is_known() {
        let text = telemetry_csv([("a.png", &ImagePrior::default())]);
        assert_eq!(text.lines().last(), Some("a.png,,,,,"));
    }
}
