//! Jobs and their events.

use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};
use uuid::Uuid;

use crate::{
    Camera, JobOptions, KnownDistance, OriginRule, PoseSource, Preset, Registration, StageGroup,
};

/// What a job does.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum JobKind {
    /// Photos to a map.
    #[default]
    Reconstruct,
    /// Maps that share a part to one map.
    RegisterMaps,
    /// Photos join a map.
    ExtendMap,
}

impl JobKind {
    /// Every kind.
    pub const ALL: [Self; 3] = [Self::Reconstruct, Self::RegisterMaps, Self::ExtendMap];

    /// Its name on the wire.
    pub fn name(self) -> &'static str {
        match self {
            Self::Reconstruct => "reconstruct",
            Self::RegisterMaps => "register_maps",
            Self::ExtendMap => "extend_map",
        }
    }

    /// By its name on the wire.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }
}

/// A job to do.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CreateJob {
    /// What to do.
    #[serde(default)]
    pub kind: JobKind,
    /// Whose images to use, in order: one at least, but for `register_maps`, which takes none.
    #[schema(max_items = 100)]
    #[serde(default)]
    pub imageset_ids: Vec<Uuid>,
    /// With `register_maps`, the maps to join, two at least; the result is in the frame of the
    /// first.
    #[schema(max_items = 16)]
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub map_ids: Vec<Uuid>,
    /// With `register_maps`, how.
    #[serde(default)]
    pub registration: Registration,
    /// The map that gets a new version; a new map when absent. With `extend_map`, the map that the
    /// photos join.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map_id: Option<Uuid>,
    /// Name of a new map.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map_name: Option<String>,
    /// Intrinsics of every image whose set names no camera; kept fixed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<Camera>,
    /// Measured distances between the cameras of two images.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub known_distances: Vec<KnownDistance>,
    /// How much work is spent.
    #[serde(default)]
    pub preset: Preset,
    /// Seed of every random choice.
    #[serde(default)]
    pub seed: u64,
    /// Which point is the origin.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub origin: Option<OriginRule>,
    /// Where the poses of the photos come from.
    #[serde(default)]
    pub poses: PoseSource,
    /// Numbers that differ from those of the preset.
    #[serde(default)]
    pub options: JobOptions,
    /// How far to go: to the last one named, with all before it; where the preset ends when empty.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stages: Vec<StageGroup>,
    /// Higher first.
    #[serde(default)]
    pub priority: i32,
}

/// Where a job stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum JobState {
    /// Waits.
    Queued,
    /// Works.
    Running,
    /// Done, with a good map of nearly all images.
    Succeeded,
    /// Done, with a map that misses a part or is doubtful.
    Partial,
    /// Ended without a map.
    Failed,
    /// Ended on request.
    Cancelled,
}

impl JobState {
    /// Every state.
    pub const ALL: [Self; 6] = [
        Self::Queued,
        Self::Running,
        Self::Succeeded,
        Self::Partial,
        Self::Failed,
        Self::Cancelled,
    ];

    /// Its name on the wire.
    pub fn name(self) -> &'static str {
        match self {
            Self::Queued => "queued",
            Self::Running => "running",
            Self::Succeeded => "succeeded",
            Self::Partial => "partial",
            Self::Failed => "failed",
            Self::Cancelled => "cancelled",
        }
    }

    /// By its name on the wire.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|state| state.name() == name)
    }

    /// Whether nothing more will happen.
    pub fn is_final(self) -> bool {
        !matches!(self, Self::Queued | Self::Running)
    }
}

/// How far a job is.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobProgress {
    /// Of the whole job, 0 to 1.
    pub fraction: f64,
    /// Finished units of the stage.
    pub done: u64,
    /// Units of the stage.
    pub total: u64,
    /// What is counted.
    pub unit: String,
    /// Seconds to the end of the stage at the measured rate.
    pub eta_s: Option<f64>,
}

/// One stage of a job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobStage {
    /// Its name.
    pub name: String,
    /// `running` or `done`.
    pub state: String,
    /// RFC 3339.
    pub started: String,
    /// RFC 3339.
    pub ended: Option<String>,
    /// Finished units.
    pub done: u64,
    /// Units.
    pub total: u64,
    /// What is counted.
    pub unit: String,
    /// Units that were found finished, from a run before.
    #[serde(default)]
    #[schema(required = true)]
    pub cached: u64,
}

/// Something that the user of a map should know.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Warning {
    /// Stable.
    pub code: String,
    /// For people, with the figures.
    pub detail: String,
    /// What to do about it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hint: Option<String>,
}

/// Why a job failed, or what its map lacks.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct JobError {
    /// Stable.
    pub code: String,
    /// For people, with the figures.
    pub detail: String,
    /// What to do about it.
    pub hint: Option<String>,
}

/// What a job made.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct JobOutputs {
    /// The map.
    pub map_id: Uuid,
    /// Its version.
    pub version: u32,
}

/// A job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Job {
    /// Its id.
    pub id: Uuid,
    /// What it does.
    pub kind: JobKind,
    /// Where it stands.
    pub state: JobState,
    /// The running stage.
    pub stage: Option<String>,
    /// How far it is.
    pub progress: JobProgress,
    /// Jobs before it; with `queued`.
    pub queue_position: Option<u64>,
    /// In the order they ran.
    pub stages: Vec<JobStage>,
    /// Runs so far.
    pub attempt: u32,
    /// Whether someone asked it to stop.
    pub cancel_requested: bool,
    /// What the user of its map should know.
    pub warnings: Vec<Warning>,
    /// Why it failed, or what its map lacks.
    pub error: Option<JobError>,
    /// What it made.
    pub outputs: Option<JobOutputs>,
    /// What was asked for.
    pub request: CreateJob,
    /// Number of its last event.
    pub last_event: u64,
    /// RFC 3339.
    pub created: String,
    /// RFC 3339.
    pub started: Option<String>,
    /// RFC 3339.
    pub finished: Option<String>,
}

/// Something that happened to a job. Numbers rise by one without gaps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobEvent {
    /// Number within the job, from 1.
    pub seq: u64,
    /// RFC 3339.
    pub time: String,
    /// `job.state`, `job.stage`, `job.progress`, `job.log`.
    #[serde(rename = "type")]
    pub kind: String,
    /// `state`: `{state, error?, outputs?}`; `stage`, `progress`: `{stage, done, total, unit,
    /// fraction, eta_s}`; `log`: `{level, message}`.
    pub data: serde_json::Value,
}

/// Events after a number.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobEvents {
    /// In order.
    pub items: Vec<JobEvent>,
    /// Ask again with `after` set to it.
    pub last: u64,
}

/// How a job runs again.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct RetryQuery {
    /// Does this stage and all after it anew, whatever is finished of them: `features`, `pairs`,
    /// `matching`, `mapping`, `align`, `export`, `depth_maps`, `fusion`, `meshing`, `texturing`.
    pub from_stage: Option<String>,
}

/// Which events.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct EventsQuery {
    /// Events with greater numbers only.
    pub after: Option<u64>,
    /// Most events to answer, 1 to 1000.
    #[param(minimum = 1, maximum = 1000)]
    pub limit: Option<u32>,
}

/// Which part of a log.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct LogQuery {
    /// Events with greater numbers only.
    pub after: Option<u64>,
    /// Most events but progress to look at, 1 to 1000; all when absent.
    #[param(minimum = 1, maximum = 1000)]
    pub limit: Option<u32>,
    /// Least weight of a line: `info`, `warn` or `error`.
    pub level: Option<String>,
}

/// Which jobs.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct JobsQuery {
    /// Only jobs in this state: `queued`, `running`, `succeeded`, `partial`, `failed`,
    /// `cancelled`.
    pub state: Option<String>,
    /// Only jobs of this kind: `reconstruct`, `register_maps`, `extend_map`.
    pub kind: Option<String>,
    /// Most items to answer, 1 to 1000; 100 when absent.
    #[param(minimum = 1, maximum = 1000)]
    pub limit: Option<u32>,
    /// `next_cursor` of the page before.
    pub cursor: Option<String>,
}
