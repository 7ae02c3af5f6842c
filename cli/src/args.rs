//! The command line.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use volery_pipeline::{Preset, StageGroup};
use volery_scene::{KnownDistance, OriginRule};

/// Photos to metric maps, and photos to poses in them.
#[derive(Debug, Parser)]
#[command(name = "volery", version, propagate_version = true)]
#[command(after_help = "Exit codes: 0 done, 1 failed, 2 wrong usage, 3 done but not wholly \
    (a suspect map, photos left out, files that could not be read).")]
pub(crate) struct Cli {
    /// One JSON document on standard output instead of text; progress stays on standard error.
    #[arg(long, global = true)]
    pub(crate) json: bool,
    /// What to do.
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Turn photos into a map, without a server.
    Reconstruct(ReconstructArgs),
    /// Find the poses of photos in a map.
    Localize(LocalizeArgs),
    /// Do the job in a work folder; the server runs this.
    #[command(hide = true)]
    RunJob {
        /// Work folder with `job.json`.
        folder: PathBuf,
    },
    /// Decode images for the server.
    #[command(hide = true)]
    RunDecoder,
    /// Localize images for the server.
    #[command(hide = true)]
    RunLocalizer,
}

#[derive(Debug, Args)]
pub(crate) struct ReconstructArgs {
    /// A folder of JPEG and PNG photos, or the photos themselves.
    #[arg(required = true)]
    pub(crate) photos: Vec<PathBuf>,
    /// Map folder to write.
    #[arg(short, long)]
    pub(crate) out: PathBuf,
    /// Calibration of all photos; kept fixed. Without it EXIF is used and refined.
    #[arg(long)]
    pub(crate) camera: Option<PathBuf>,
    /// `image,time_s,yaw_deg,pitch_deg,roll_deg,height_m` of a flight.
    #[arg(long)]
    pub(crate) telemetry: Option<PathBuf>,
    /// Camera positions: `image,x,y,z[,sigma]`, or a `poses.csv`. The map takes their frame.
    #[arg(long)]
    pub(crate) positions: Option<PathBuf>,
    /// Standard deviation of positions without one, meters.
    #[arg(long, default_value_t = 0.05, value_parser = positive)]
    pub(crate) position_sigma: f64,
    /// Measured distance between the cameras of two photos; may be repeated.
    #[arg(long, value_name = "A,B,METERS", value_parser = known_distance)]
    pub(crate) known_distance: Vec<KnownDistance>,
    /// Parts of the pipeline to run.
    #[arg(long, value_delimiter = ',', value_enum)]
    pub(crate) stages: Vec<StageArg>,
    /// Effort.
    #[arg(long, value_enum, default_value = "balanced")]
    pub(crate) preset: PresetArg,
    /// Seed of all random choices: equal seeds give equal maps.
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
    /// Origin of the map; by default the frame of the positions if given, else the last camera.
    #[arg(long, value_enum)]
    pub(crate) origin: Option<OriginArg>,
    /// Photos are made smaller until no side is longer, pixels.
    #[arg(long, value_parser = clap::value_parser!(u32).range(64..=16384))]
    pub(crate) max_image_size: Option<u32>,
    /// Folder for finished units of work; kept. By default one inside OUT, removed at the end.
    #[arg(long)]
    pub(crate) work: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub(crate) struct LocalizeArgs {
    /// Map folder (unless --server is given), then photos or folders of photos.
    #[arg(required = true)]
    pub(crate) paths: Vec<PathBuf>,
    /// Calibration of the photos. Without it the map's own camera of this size, else EXIF.
    #[arg(long)]
    pub(crate) camera: Option<PathBuf>,
    /// Telemetry of the photos: the yaw narrows the search if the map was made with telemetry.
    #[arg(long)]
    pub(crate) telemetry: Option<PathBuf>,
    /// Poses of the photos answered `ok`: `image,qw,qx,qy,qz,tx,ty,tz`, camera to map.
    #[arg(short, long)]
    pub(crate) out: Option<PathBuf>,
    /// Seed of all random choices.
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(crate) enum PresetArg {
    Fast,
    Balanced,
    Best,
}

impl From<PresetArg> for Preset {
    fn from(preset: PresetArg) -> Self {
        match preset {
            PresetArg::Fast => Self::Fast,
            PresetArg::Balanced => Self::Balanced,
            PresetArg::Best => Self::Best,
        }
    }
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(crate) enum StageArg {
    Sfm,
}

impl From<StageArg> for StageGroup {
    fn from(stage: StageArg) -> Self {
        match stage {
            StageArg::Sfm => Self::Sfm,
        }
    }
}

#[derive(Debug, Clone, Copy, ValueEnum)]
pub(crate) enum OriginArg {
    LastCamera,
    MeanCameras,
    Given,
}

impl From<OriginArg> for OriginRule {
    fn from(origin: OriginArg) -> Self {
        match origin {
            OriginArg::LastCamera => Self::LastCamera,
            OriginArg::MeanCameras => Self::MeanCameras,
            OriginArg::Given => Self::Given,
        }
    }
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() && value > 0.0 => Ok(value),
        _ => Err("expected a positive number".to_owned()),
    }
}

fn known_distance(text: &str) -> Result<KnownDistance, String> {
    let fields: Vec<&str> = text.split(',').collect();
    let [a, b, meters] = fields[..] else {
        return Err("expected A,B,METERS: two image names and a distance".to_owned());
    };
    let meters = positive(meters).map_err(|e| format!("{meters:?}: {e}"))?;
    Ok(KnownDistance { image_a: a.to_owned(), image_b: b.to_owned(), meters })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        use clap::CommandFactory;
        Cli::command().debug_assert();
    }

    #[test]
    fn known_distances_are_checked() {
        assert_eq!(known_distance("a.jpg,b.jpg,3").unwrap().meters, 3.0);
        for bad in ["", "a,b", "a,b,0", "a,b,-1", "a,b,nan", "a,b,1,2"] {
            assert!(known_distance(bad).is_err(), "{bad}");
        }
    }
}
