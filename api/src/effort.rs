//! How much work a reconstruction spends, and where it ends.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// How much work a reconstruction may spend.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Preset {
    /// Fewer features, smaller images; ends with the sparse map, which is all that localization
    /// needs.
    Fast,
    /// The default; ends with a mesh.
    #[default]
    Balanced,
    /// Full resolution, most features; ends with a mesh.
    Best,
}

impl Preset {
    /// The part of the way that ends a job: the last one of `stages`, else the preset's own.
    pub fn last_stage(self, stages: &[StageGroup]) -> StageGroup {
        let own = if self == Self::Fast { StageGroup::Sfm } else { StageGroup::Mesh };
        stages.iter().copied().max().unwrap_or(own)
    }
}

/// Parts of the way from photos to a full environment map, in order; each needs those before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum StageGroup {
    /// Photos to a sparse metric map.
    Sfm,
    /// Depth maps, and the cloud they are fused to.
    Dense,
    /// The surface of the cloud.
    Mesh,
}
