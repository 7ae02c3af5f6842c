//! Arguments of `volery demo`.

use std::path::PathBuf;

use clap::Args;

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
