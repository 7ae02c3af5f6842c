//! Positions by radio and light: what vision is compared with.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// What is measured of a beacon.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BeaconReading {
    /// Where the beacon is, in the map, meters.
    pub beacon: [f64; 3],
    /// Strength of its signal, dBm; or `range_m`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rssi_dbm: Option<f64>,
    /// Distance to it, meters; or `rssi_dbm`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub range_m: Option<f64>,
    /// Standard deviation of the distance, meters; 0.05 when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sigma_m: Option<f64>,
}

/// How the strength of a signal falls: `RSSI(d) = at_1_m - 10 n log10(d)`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PathLossModel {
    /// Strength at 1 m, dBm.
    pub at_1_m: f64,
    /// Exponent n.
    pub exponent: f64,
    /// Standard deviation of a reading, dB.
    pub sigma_db: f64,
}

/// Readings of at least three beacons that do not stand on a line.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BeaconEstimateRequest {
    /// One per beacon.
    #[schema(min_items = 3, max_items = 100)]
    pub readings: Vec<BeaconReading>,
    /// For `rssi_dbm`; -59 dBm, 2.2, 4 dB when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub path_loss: Option<PathLossModel>,
    /// Height at which the position is sought, in the map, meters.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height: Option<f64>,
    /// Distance straight down to the floor, meters: makes the position three-dimensional.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height_tof_m: Option<f64>,
    /// Height of the floor in the map, meters.
    #[serde(default)]
    pub floor: f64,
}

/// A position by beacons.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct BeaconEstimate {
    /// In the map, meters: x and y, and z if a height was measured.
    pub position: Vec<f64>,
    /// Standard deviation of each coordinate, meters.
    pub sigma: Vec<f64>,
}
