//! Arguments of `volery demo` and `volery compare-positioning`.

use std::path::PathBuf;

use clap::Args;

use super::values::positive;

#[derive(Debug, Args)]
pub(crate) struct DemoArgs {
    /// Folder of photos, data and report: a new one, or one whose earlier demo is replaced.
    #[arg(short, long, default_value = "volery-demo")]
    pub(crate) out: PathBuf,
    /// Of the hall and the flight.
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// Simulated drones that fly in the map; none ends the demo with the map.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u8).range(0..=6))]
    pub(crate) drones: u8,
    /// End with the report: the ground station does not run on to be watched.
    #[arg(long)]
    pub(crate) headless: bool,
}

#[derive(Debug, Args)]
pub(crate) struct CompareArgs {
    /// Folder of the map, the plots and the report: a new one, or one of an earlier comparison.
    #[arg(short, long, default_value = "volery-comparison")]
    pub(crate) out: PathBuf,
    /// Of the hall, the flight and all noise.
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// Places on the way.
    #[arg(long, default_value_t = 60, value_parser = clap::value_parser!(u16).range(3..=1000))]
    pub(crate) places: u16,
    /// Standard deviation of the strength of radio, decibels.
    #[arg(long, default_value_t = 4.0, value_parser = positive)]
    pub(crate) rssi_sigma_db: f64,
}
