//! Maps, versions, localization answers.

use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};
use uuid::Uuid;

use crate::{Camera, CameraPose, Localization, LocalizeMethod};

/// A place. Its versions never change.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Map {
    /// Its id.
    pub id: Uuid,
    /// For people.
    pub name: String,
    /// The version that answers when none is named.
    pub active_version: u32,
    /// Newest version.
    pub latest_version: u32,
    /// The active version.
    pub active: MapVersion,
    /// RFC 3339.
    pub created: String,
}

/// What to change of a map.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PatchMap {
    /// For people.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
}

/// One immutable state of a map.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MapVersion {
    /// The map.
    pub map_id: Uuid,
    /// From 1.
    pub version: u32,
    /// The job that made it.
    pub job_id: Option<Uuid>,
    /// The version it was made from.
    pub parent_version: Option<u32>,
    /// The map folder's `map.json`: scale, gravity, origin, quality, cameras, bounds, ...
    #[schema(value_type = Object)]
    pub info: serde_json::Value,
    /// Files of the map folder.
    pub files: Vec<MapFile>,
    /// RFC 3339.
    pub created: String,
}

/// One file of a map version.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct MapFile {
    /// Relative to the map folder.
    pub path: String,
    /// Of its bytes, hex.
    pub sha256: String,
    /// Bytes.
    pub size: u64,
}

/// Which version answers from now on.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ActivateMap {
    /// An existing version.
    pub version: u32,
}

/// What an alignment made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Aligned {
    /// The new version; it is active.
    pub version: MapVersion,
    /// How well the measurements fit.
    #[schema(value_type = Object)]
    pub residuals: serde_json::Value,
}

/// Which version; the active one when absent.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct VersionQuery {
    /// The active one when absent.
    pub version: Option<u32>,
}

/// Which version, and how.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct LocalizeParams {
    /// The active one when absent.
    pub version: Option<u32>,
    /// `auto` when absent.
    #[param(inline)]
    pub method: Option<LocalizeMethod>,
}

/// What a virtual camera is to draw.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RenderRequest {
    /// `map_from_camera`.
    pub pose: CameraPose,
    /// Intrinsics and size of the picture; the map's first camera when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<Camera>,
    /// What the picture shows.
    #[serde(default)]
    pub what: RenderWhat,
}

/// What a drawn picture shows.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum RenderWhat {
    /// Colors: PNG.
    #[default]
    Color,
    /// Depth along the camera's z in thousandths of the map's unit (millimeters of a metric map):
    /// 16-bit gray PNG; 0 where nothing is seen.
    Depth,
    /// Depth along the camera's z: 32-bit floats, little endian, row by row; 0 where nothing is seen.
    DepthF32,
}

/// A posed image of a map.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MapCamera {
    /// Image name.
    pub image: String,
    /// `map_from_camera`.
    pub pose: CameraPose,
}

/// Posed images of a map.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MapCameras {
    /// The map.
    pub map_id: Uuid,
    /// Its version.
    pub version: u32,
    /// Intrinsics.
    pub cameras: Vec<Camera>,
    /// In the order of the map folder.
    pub images: Vec<MapCamera>,
}

/// Where an image was taken, or why that is unknown.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LocalizeAnswer {
    /// Always `map`: right-handed, z up.
    pub frame: String,
    /// The map.
    pub map_id: Uuid,
    /// Its version.
    pub map_version: u32,
    /// The answer proper.
    #[serde(flatten)]
    pub localization: Localization,
}

/// Which maps to look in.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct MapsQuery {
    /// Ids of 1 to 8 different maps, separated by commas; or as a part of the form.
    pub map_ids: Option<String>,
    /// `auto` when absent.
    #[param(inline)]
    pub method: Option<LocalizeMethod>,
}

/// Where in which of several maps an image was taken, or why that is unknown.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LocalizeManyAnswer {
    /// The answer of the map that knows the image best. If another map knows it nearly as well,
    /// this one is `ambiguous` for the reason `several_maps`, without a pose.
    #[serde(flatten)]
    pub best: LocalizeAnswer,
    /// Of each map, in the order asked.
    pub answers: Vec<LocalizeAnswer>,
}
