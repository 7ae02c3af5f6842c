//! Maps that are joined.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use crate::{CreateJob, JobKind, JobOptions, Preset, StageGroup};

/// How maps are brought together.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum RegistrationMethod {
    /// By points that look the same; where they are too few, by the surfaces, if both maps have
    /// dense clouds and a metric scale.
    #[default]
    Auto,
    /// By points that look the same.
    Points,
    /// By the shape of the surfaces alone.
    Surfaces,
}

/// What `register_maps` may do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Registration {
    /// How maps are brought together.
    #[serde(default)]
    pub method: RegistrationMethod,
    /// Whether a map may be grown or shrunk; without, all maps must have one unit.
    #[serde(default = "yes")]
    pub with_scale: bool,
}

fn yes() -> bool {
    true
}

impl Default for Registration {
    fn default() -> Self {
        Self { method: RegistrationMethod::default(), with_scale: true }
    }
}

/// Maps to join.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RegisterMaps {
    /// Two maps or more; their active versions are joined in the frame of the first.
    #[schema(min_items = 2, max_items = 16)]
    pub maps: Vec<Uuid>,
    /// How they are brought together.
    #[serde(default)]
    pub method: RegistrationMethod,
    /// Whether a map may be grown or shrunk; without, all maps must have one unit.
    #[serde(default = "yes")]
    pub with_scale: bool,
    /// How much work is spent on the surface of the joined map.
    #[serde(default)]
    pub preset: Preset,
    /// Numbers that differ from those of the preset.
    #[serde(default)]
    pub options: JobOptions,
    /// How far to go: `sfm` joins the maps without their surfaces; where the preset ends when empty.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stages: Vec<StageGroup>,
    /// The map that gets the result as a new version; a new map when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map_id: Option<Uuid>,
    /// Name of a new map.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map_name: Option<String>,
    /// Seed of every random choice.
    #[serde(default)]
    pub seed: u64,
    /// Higher first.
    #[serde(default)]
    pub priority: i32,
}

impl Default for RegisterMaps {
    fn default() -> Self {
        Self {
            maps: Vec::new(),
            method: RegistrationMethod::default(),
            with_scale: true,
            preset: Preset::default(),
            options: JobOptions::default(),
            stages: Vec::new(),
            map_id: None,
            map_name: None,
            seed: 0,
            priority: 0,
        }
    }
}

impl From<RegisterMaps> for CreateJob {
    fn from(request: RegisterMaps) -> Self {
        Self {
            kind: JobKind::RegisterMaps,
            map_ids: request.maps,
            registration: Registration { method: request.method, with_scale: request.with_scale },
            preset: request.preset,
            options: request.options,
            stages: request.stages,
            map_id: request.map_id,
            map_name: request.map_name,
            seed: request.seed,
            priority: request.priority,
            ..Self::default()
        }
    }
}
