//! `telemetry.csv`: what a drone reported per image.

use volery_scene::ImagePrior;

use crate::TableError;

/// One image's telemetry.
#[derive(Debug, Clone, PartialEq)]
pub struct TelemetryRow {
    /// File name.
    pub image: String,
    /// Its priors.
    pub prior: ImagePrior,
}

/// How far telemetry is trusted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TelemetrySigmas {
    /// Of yaw, radians.
    pub yaw: f64,
    /// Of pitch and roll, radians.
    pub tilt: f64,
    /// Of height, meters.
    pub height: f64,
}

impl Default for TelemetrySigmas {
    /// A small drone with magnetometer and range finder.
    fn default() -> Self {
        Self { yaw: 2.0_f64.to_radians(), tilt: 0.5_f64.to_radians(), height: 0.05 }
    }
}

/// Reads `image` and any of `time_s, yaw_deg, pitch_deg, roll_deg, height_m`, found by the names
/// in the header line; empty fields and missing columns are `None`.
pub fn read_telemetry_csv(
    bytes: &[u8],
    sigmas: &TelemetrySigmas,
) -> Result<Vec<TelemetryRow>, TableError> {
    let _ = (bytes, sigmas);
    todo!()
}
