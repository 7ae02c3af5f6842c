//! The environment map: a model that knows its frame, its scale and how far to trust it.

use serde::{Deserialize, Serialize};

use crate::{SparseModel, UnplacedImage};

/// Where the metric scale comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ScaleSource {
    /// Nothing: lengths have no unit.
    Unknown,
    /// Position priors.
    Positions,
    /// Height priors.
    Heights,
    /// Poses that were given in meters.
    Poses,
    /// A measured distance.
    KnownDistance,
    /// Surveyed points.
    ControlPoints,
    /// Whoever set it by hand.
    Given,
}

/// Metric scale with its proof.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Scale {
    /// Whether lengths are meters.
    pub metric: bool,
    /// What says so.
    pub source: ScaleSource,
    /// Standard deviation relative to 1; `None` when not metric, or not told with the source.
    pub sigma_rel: Option<f64>,
}

/// Where "up" comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GravitySource {
    /// Nothing better than the mean of the cameras' up axes.
    CameraUp,
    /// Attitude priors.
    Attitude,
    /// Position priors of a z-up frame.
    Positions,
    /// Poses that were given in a z-up frame.
    Poses,
    /// Surveyed points of a z-up frame.
    ControlPoints,
    /// Whoever turned the map by hand.
    Given,
}

/// Direction of gravity with its proof.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Gravity {
    /// What says so.
    pub source: GravitySource,
    /// Standard deviation, radians; `None` when it is a guess, or not told with the source.
    pub sigma: Option<f64>,
}

/// Which point is the origin (P50).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OriginRule {
    /// Position of the last mapping image.
    #[default]
    LastCamera,
    /// Mean of the camera positions.
    MeanCameras,
    /// The frame of the position priors, control points or given poses is kept as it is, or the
    /// map was moved by hand.
    Given,
}

/// How far a map may be trusted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Every check passed.
    Good,
    /// A map, but a check speaks against it.
    Suspect,
    /// No usable map.
    Failed,
}

/// A check that spoke against the map. `code` is stable.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct QualityReason {
    /// E.g. `weakly_tied`, `drift`, `loop_disagreement`, `absurd_intrinsics`, `wrong_calibration`,
    /// `contradicting_rotations`, `no_parallax`, `no_overlap`.
    pub code: String,
    /// For people, with the figures and what to do.
    pub detail: String,
}

/// The verdict with its reasons.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Quality {
    /// Worst of the checks.
    pub verdict: Verdict,
    /// Empty for [`Verdict::Good`].
    pub reasons: Vec<QualityReason>,
}

/// A sparse model in the map frame: x forward, y left, z up (meters when `scale.metric`).
#[derive(Debug, Clone, PartialEq)]
pub struct EnvironmentMap {
    /// In the map frame.
    pub model: SparseModel,
    /// Smaller components that could not be tied to the map, largest first, each in a frame of
    /// its own and without zones.
    pub zones: Vec<EnvironmentMap>,
    /// Images without a pose in `model`.
    pub unplaced: Vec<UnplacedImage>,
    /// Scale and its proof.
    pub scale: Scale,
    /// Gravity and its proof.
    pub gravity: Gravity,
    /// Rule of the origin.
    pub origin: OriginRule,
    /// Verdict.
    pub quality: Quality,
}
