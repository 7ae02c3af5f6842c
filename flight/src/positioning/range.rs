//! Distances to beacons.

use std::f64::consts::LN_10;

use nalgebra::Point3;

/// A measured distance to a beacon.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Range {
    /// Where the beacon is in the map.
    pub beacon: Point3<f64>,
    /// Distance to it. Meters.
    pub distance: f64,
    /// Its standard deviation. Meters.
    pub sigma: f64,
}

/// How the strength of a radio signal falls with distance.
///
/// ```text
/// RSSI(d) = RSSI(1 m) − 10 n log₁₀ d + ε,   ε ~ N(0, σ²)
/// ```
///
/// The log-distance model (Rappaport, Wireless Communications, eq. 4.69); 2 ≤ n ≤ 4 indoors, and
/// walls and people make σ a few decibels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathLoss {
    /// Strength at 1 m. dBm.
    pub at_1_m: f64,
    /// Exponent `n`.
    pub exponent: f64,
    /// Standard deviation `σ` of a reading. dB.
    pub sigma_db: f64,
}

impl Default for PathLoss {
    /// A beacon of -59 dBm at 1 m in a room with furniture.
    fn default() -> Self {
        Self { at_1_m: -59.0, exponent: 2.2, sigma_db: 4.0 }
    }
}

impl PathLoss {
    /// Strength expected at a distance. dBm.
    pub fn strength(&self, distance: f64) -> f64 {
        self.at_1_m - 10.0 * self.exponent * distance.log10()
    }

    /// Distance that explains a strength: an error in decibels is a factor of distance, so the far
    /// ranges are the bad ones, `σ_d = d σ ln 10 / 10 n`.
    pub fn range(&self, beacon: Point3<f64>, rssi_dbm: f64) -> Range {
        let distance = 10f64.powf((self.at_1_m - rssi_dbm) / (10.0 * self.exponent));
        let sigma = distance * self.sigma_db * LN_10 / (10.0 * self.exponent);
        Range { beacon, distance, sigma }
    }
}

#[cfg(test)]
mod tests;
