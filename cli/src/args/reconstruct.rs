//! Arguments of `volery reconstruct`, and of what else takes a model.

use std::path::PathBuf;

use clap::Args;
use volery_api::JobOptions;
use volery_pipeline::{PoseSource, Preset, StageGroup};
use volery_scene::KnownDistance;

use super::values::{OriginArg, PresetArg, StageArg, job_option, known_distance, positive};

/// Poses that another program found.
#[derive(Debug, Args)]
pub(crate) struct ModelArgs {
    /// Model of another program, whose poses and cameras are taken as they are: a folder with
    /// COLMAP's cameras and images, .txt or .bin, or a transforms.json.
    #[arg(long)]
    pub(crate) model: Option<PathBuf>,
    /// The model is in meters with z up: the map keeps its frame.
    #[arg(long, requires = "model")]
    pub(crate) model_is_metric: bool,
}

impl ModelArgs {
    /// Where poses come from.
    pub(crate) fn poses(&self) -> PoseSource {
        match (&self.model, self.model_is_metric) {
            (None, _) => PoseSource::Estimated,
            (Some(_), false) => PoseSource::Given,
            (Some(_), true) => PoseSource::GivenMetric,
        }
    }
}

/// How much is done.
#[derive(Debug, Args)]
pub(crate) struct EffortArgs {
    /// Effort.
    #[arg(long, value_enum, default_value = "balanced")]
    preset: PresetArg,
    /// How far to go: to the last one named, with all before it; where the preset ends by default.
    #[arg(long, value_delimiter = ',', value_enum)]
    stages: Vec<StageArg>,
    /// A number that differs from the preset's; may be repeated. `volery options` lists them.
    #[arg(long = "option", value_name = "NAME=NUMBER", value_parser = job_option)]
    options: Vec<JobOptions>,
}

impl EffortArgs {
    pub(crate) fn preset(&self) -> Preset {
        self.preset.into()
    }

    pub(crate) fn stages(&self) -> Vec<StageGroup> {
        self.stages.iter().map(|stage| (*stage).into()).collect()
    }

    /// The last one of a name counts.
    pub(crate) fn options(&self) -> JobOptions {
        self.options.iter().fold(JobOptions::default(), |all, one| one.over(&all))
    }
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
    #[command(flatten)]
    pub(crate) flight: FlightArgs,
    #[command(flatten)]
    pub(crate) given: ModelArgs,
    /// Measured distance between the cameras of two photos; may be repeated.
    #[arg(long, value_name = "A,B,METERS", value_parser = known_distance)]
    pub(crate) known_distance: Vec<KnownDistance>,
    #[command(flatten)]
    pub(crate) effort: EffortArgs,
    /// Seed of all random choices: equal seeds give equal maps.
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
    /// Origin of the map; by default the frame of the positions if given, else the last camera.
    #[arg(long, value_enum)]
    pub(crate) origin: Option<OriginArg>,
    /// Folder for finished units of work; kept. By default one inside OUT, removed at the end.
    #[arg(long)]
    pub(crate) work: Option<PathBuf>,
}

/// What a flight knew of its photos.
#[derive(Debug, Args)]
pub(crate) struct FlightArgs {
    /// `image,time_s,yaw_deg,pitch_deg,roll_deg,height_m,x_m,y_m,z_m` of a flight; all but `image` may
    /// be missing.
    #[arg(long)]
    pub(crate) telemetry: Option<PathBuf>,
    /// Camera positions: `image,x,y,z[,sigma]`, or a `poses.csv`. The map takes their frame.
    #[arg(long)]
    pub(crate) positions: Option<PathBuf>,
    /// Standard deviation of positions without one, meters.
    #[arg(long, default_value_t = 0.05, value_parser = positive)]
    pub(crate) position_sigma: f64,
}
