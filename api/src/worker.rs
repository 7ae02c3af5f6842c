//! What the service and its child processes say to each other.
//!
//! The service runs heavy work and the decoding of untrusted bytes in children of the same
//! program under resource limits.
//!
//! * `<program> run-job <workdir>` reads `<workdir>/job.json` ([`JobSpec`]), writes one
//!   [`JobLine`] of JSON per line to its standard output, and leaves the map folder in
//!   `<workdir>/out/`. The work folder lasts as long as the job: finished units found in
//!   `<workdir>/cache/<stage>/` are not computed again. A job that fails says so in its last line ([`JobLine::Result`]) and ends
//!   with exit code 0; any other end counts as a crash and is tried again. SIGTERM asks the child
//!   to stop at the next unit of work; what it has finished stays in the folder.
//! * Every child dies with the service: it leaves at once when its parent is not the process named
//!   by [`PARENT_VARIABLE`] or when its standard input ends. (A parent death signal would follow
//!   the thread that spawned the child, not the process.)
//! * `<program> run-decoder` and `<program> run-localizer` answer [`WorkerRequest`]s until their
//!   standard input ends. A message is, both ways, `u32` little-endian length of the header, the
//!   header in JSON, `u32` length of the payload, the payload. Every answer's header carries `ok`;
//!   with `ok: false` it is a [`WorkerFailure`]. A localizer keeps the indices of the map folders
//!   it has been asked about in memory.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::{
    AlignRequest, Camera, CameraPose, FrameTelemetry, JobKind, JobOptions, KnownDistance,
    Localization, LocalizeMethod, LocalizePrior, OriginRule, PoseSource, Preset, Prior,
    Registration, RenderRequest, StageGroup, Warning,
};

/// Name of the specification in a work folder.
pub const JOB_FILE: &str = "job.json";

/// Name of the map folder in a work folder.
pub const OUT_FOLDER: &str = "out";

/// Name of the folder in a work folder with the finished units, in a folder per stage.
pub const CACHE_FOLDER: &str = "cache";

/// Environment variable with the process id of the service.
pub const PARENT_VARIABLE: &str = "VOLERY_PARENT_PID";

/// Longest header of a message, bytes.
pub const MAX_WORKER_HEADER: usize = 16 << 20;

/// Files that tell the poses of another program's model: COLMAP's, nerfstudio's.
pub const MODEL_FILES: [&str; 5] =
    ["cameras.bin", "images.bin", "cameras.txt", "images.txt", "transforms.json"];

/// What a child does.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JobSpec {
    /// Which of the things a child can do.
    #[serde(default)]
    pub kind: JobKind,
    /// The maps to join; for `extend_map` the one that the photos join.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub maps: Vec<JobMap>,
    /// How they are joined.
    #[serde(default)]
    pub registration: Registration,
    /// In the order of the flight.
    pub images: Vec<JobImage>,
    /// Intrinsics of every image that has none of its own; kept fixed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<Camera>,
    /// Measured distances between the cameras of two images.
    #[serde(default)]
    pub known_distances: Vec<KnownDistance>,
    /// How much work is spent.
    #[serde(default)]
    pub preset: Preset,
    /// Seed of every random choice.
    #[serde(default)]
    pub seed: u64,
    /// Which point is the origin; `None` keeps the frame of position priors, else takes the last
    /// camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub origin: Option<OriginRule>,
    /// Where the poses of the photos come from.
    #[serde(default)]
    pub poses: PoseSource,
    /// Numbers that differ from those of the preset.
    #[serde(default)]
    pub options: JobOptions,
    /// How far to go: to the last one named, with all before it; where the preset ends when empty.
    #[serde(default)]
    pub stages: Vec<StageGroup>,
}

/// One map of a [`JobSpec`].
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JobMap {
    /// For the report, and for photos whose name is taken.
    pub name: String,
    /// Map folder.
    pub path: String,
    /// Files of its photos, and maybe of others: their content tells.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub photos: Vec<String>,
}

/// One photo of a [`JobSpec`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JobImage {
    /// Unique within the job; the name in every output.
    pub name: String,
    /// File with the bytes as they were uploaded.
    pub path: String,
    /// Intrinsics of this image, where they differ from the job's; kept fixed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<Camera>,
    /// Photos of one group, size and focal length share the camera that is estimated for them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera_group: Option<String>,
    /// What else is known of it.
    #[serde(default)]
    pub prior: Prior,
}

/// One line of a job's standard output.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum JobLine {
    /// `done` of `total` units of a stage are finished.
    Progress {
        /// Name of the stage.
        stage: String,
        /// Finished units.
        done: u64,
        /// Units in this stage.
        total: u64,
        /// What is counted: `images`, `pairs`, ...
        #[serde(default)]
        unit: String,
    },
    /// `units` of a stage that runs or has run were found finished.
    Reused {
        /// Name of the stage.
        stage: String,
        /// Finished units.
        units: u64,
    },
    /// Something to remember.
    Log {
        /// `info`, `warn` or `error`.
        level: String,
        /// One sentence.
        message: String,
    },
    /// The last line.
    Result(JobResult),
}

/// How a job ended.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct JobResult {
    /// Whether there is a map.
    pub ok: bool,
    /// `succeeded`, or `partial` when the map misses a part of the photos; with `ok`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub state: Option<String>,
    /// Folder of the map, relative to the work folder; with `ok`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map: Option<String>,
    /// Stable code of the failure, or of what makes the map partial.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub code: Option<String>,
    /// For people, with the figures.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub detail: Option<String>,
    /// What to do about it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hint: Option<String>,
    /// What the user of the map should know.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<Warning>,
}

/// Header of a message to a decoder or localizer. The payload is the encoded image, if any; an
/// answer has none unless the request says so.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "op", rename_all = "snake_case")]
pub enum WorkerRequest {
    /// Payload: an image. Decode it whole; answer [`ImageCheck`].
    CheckImage {},
    /// Payload: files of another program's model, one after the other. Answer [`ModelPoses`].
    ReadModel {
        /// Name and number of bytes of each: COLMAP's `cameras` and `images`, `.txt` or `.bin`, or a
        /// `transforms.json`.
        files: Vec<(String, u64)>,
        /// Names of the photos that may be in it.
        photos: BTreeSet<String>,
    },
    /// Payload: an image. Answer: `{"ok":true}`, with a small PNG of it as payload.
    Thumbnail {
        /// Longest side, pixels.
        max_side: u32,
    },
    /// Payload: an image. Answer [`Localization`], with `ok: true` beside its fields.
    Localize(Box<LocalizeTask>),
    /// Payload: the next frame of a stream. Answer [`TrackedFrame`](crate::TrackedFrame), with
    /// `ok: true` beside its fields.
    Track(Box<TrackTask>),
    /// Forget a stream. Answer: `{"ok":true}`.
    EndTrack {
        /// As in [`TrackTask`].
        stream: u64,
    },
    /// Turn a map folder into another. Answer: `{"ok":true,"residuals":{..}}`.
    Align {
        /// Map folder to read.
        map_dir: String,
        /// Folder to create.
        out_dir: String,
        /// What to do.
        align: AlignRequest,
    },
    /// Draw a view of a map. Answer: [`RenderReply`], with the picture as payload.
    Render {
        /// Map folder to read.
        map_dir: String,
        /// What to draw.
        render: RenderRequest,
    },
    /// Write an export that the map folder does not hold as a file. Answer: `{"ok":true}`.
    Export {
        /// Map folder to read.
        map_dir: String,
        /// `colmap_bin`, `map.glb`, `transforms.json`.
        format: String,
        /// File or, for `colmap_bin`, folder to create.
        out: String,
    },
}

/// Where to look for an image.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LocalizeTask {
    /// Map folder: `localization.bin` and what else a localizer needs.
    pub map_dir: String,
    /// Intrinsics; `None`: from EXIF, else the map's camera of the same size.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<Camera>,
    /// What is known of the pose.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prior: Option<LocalizePrior>,
    /// How.
    #[serde(default)]
    pub method: LocalizeMethod,
    /// How the payload is coded.
    #[serde(default)]
    pub encoding: ImageEncoding,
    /// Pixels; needed for raw encodings.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub width: Option<u32>,
    /// Pixels; needed for raw encodings.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height: Option<u32>,
}

/// A frame of a stream.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrackTask {
    /// Frames of one number are of one camera.
    pub stream: u64,
    /// Map folder; the same for all frames of a stream.
    pub map_dir: String,
    /// Intrinsics; as with [`LocalizeTask`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<Camera>,
    /// How the payload is coded.
    #[serde(default)]
    pub encoding: ImageEncoding,
    /// Pixels; needed for raw encodings.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub width: Option<u32>,
    /// Pixels; needed for raw encodings.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height: Option<u32>,
    /// When it was taken, nanoseconds of one clock per stream.
    pub t_capture_ns: u64,
    /// Reported at that time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub telemetry: Option<FrameTelemetry>,
}

/// How an image is coded.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ImageEncoding {
    /// A file; its first bytes tell which.
    #[default]
    Auto,
    /// JPEG.
    Jpeg,
    /// PNG.
    Png,
    /// Row-major 8-bit gray, `width * height` bytes.
    Gray8,
    /// Row-major 8-bit RGB, `3 * width * height` bytes.
    Rgb8,
}

/// Answer to [`WorkerRequest::CheckImage`], beside `ok: true`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ImageCheck {
    /// Pixels, once turned upright.
    pub width: u32,
    /// Pixels, once turned upright.
    pub height: u32,
    /// `jpeg` or `png`.
    pub format: String,
    /// What EXIF tells: `focal_px`, `make`, `model`, `orientation`, `capture_time`, ...
    #[serde(default)]
    pub exif: BTreeMap<String, serde_json::Value>,
    /// What is wrong without being fatal.
    #[serde(default)]
    pub warnings: Vec<String>,
}

/// Answer to [`WorkerRequest::ReadModel`], beside `ok: true`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ModelPoses {
    /// By the name of the photo.
    pub images: BTreeMap<String, (CameraPose, Camera)>,
    /// Names in the model that are no photo's.
    pub unknown: Vec<String>,
}

/// Answer to [`WorkerRequest::Render`], beside `ok: true`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RenderReply {
    /// What was drawn: `mesh` or `points`.
    pub surface: String,
}

/// Answer to any request that could not be done, beside `ok: false`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct WorkerFailure {
    /// Stable: `not_an_image`, `unsupported`, `truncated`, `damaged`, `too_large`, `empty_file`,
    /// `bad_map`, `bad_request`, `unknown_image`, `degenerate`, ...
    pub code: String,
    /// For people.
    pub detail: String,
    /// What to do about it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hint: Option<String>,
}

/// Answer to [`WorkerRequest::Localize`].
pub type LocalizeReply = Localization;

/// An answer's header: `ok` and the fields of `T` or of a [`WorkerFailure`].
///
/// ```
/// use volery_api::worker::{ImageCheck, WorkerReply};
/// let text = r#"{"ok":false,"code":"truncated","detail":"ends after 10 bytes"}"#;
/// let reply: WorkerReply<ImageCheck> = WorkerReply::parse(text.as_bytes()).unwrap();
/// assert_eq!(reply.0.unwrap_err().code, "truncated");
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct WorkerReply<T>(pub Result<T, WorkerFailure>);

impl<T: Serialize + for<'de> Deserialize<'de>> WorkerReply<T> {
    /// From a header.
    pub fn parse(header: &[u8]) -> Result<Self, serde_json::Error> {
        let mut value: serde_json::Value = serde_json::from_slice(header)?;
        let ok = value.as_object_mut().and_then(|object| object.remove("ok"));
        Ok(Self(if ok == Some(serde_json::Value::Bool(true)) {
            Ok(serde_json::from_value(value)?)
        } else {
            Err(serde_json::from_value(value)?)
        }))
    }

    /// As a header.
    pub fn to_header(&self) -> Result<Vec<u8>, serde_json::Error> {
        let (ok, mut value) = match &self.0 {
            Ok(answer) => (true, serde_json::to_value(answer)?),
            Err(failure) => (false, serde_json::to_value(failure)?),
        };
        if let Some(object) = value.as_object_mut() {
            object.insert("ok".to_owned(), serde_json::Value::Bool(ok));
        }
        serde_json::to_vec(&value)
    }
}
