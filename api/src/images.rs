//! Cameras, image sets and images.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};
use uuid::Uuid;

use crate::{Camera, Prior};

/// A camera to keep.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CreateCamera {
    /// For people.
    #[schema(min_length = 1, max_length = 200)]
    pub name: String,
    /// Intrinsics.
    pub camera: Camera,
}

/// A kept camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StoredCamera {
    /// Its id.
    pub id: Uuid,
    /// For people.
    pub name: String,
    /// Intrinsics.
    pub camera: Camera,
    /// RFC 3339.
    pub created: String,
}

/// An image set to make.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CreateImageSet {
    /// For people.
    #[schema(min_length = 1, max_length = 200)]
    pub name: String,
    /// Camera of all its images that have none of their own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera_id: Option<Uuid>,
    /// For people.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub notes: Option<String>,
}

/// What to change of an image set.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PatchImageSet {
    /// For people.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Camera of all its images that have none of their own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera_id: Option<Uuid>,
    /// For people.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub notes: Option<String>,
}

/// Photos that belong together: one flight, one camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ImageSet {
    /// Its id.
    pub id: Uuid,
    /// For people.
    pub name: String,
    /// Camera of all its images that have none of their own.
    pub camera_id: Option<Uuid>,
    /// For people.
    pub notes: Option<String>,
    /// Number of images.
    pub num_images: u64,
    /// RFC 3339.
    pub created: String,
}

/// One photo.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Image {
    /// Its id.
    pub id: Uuid,
    /// Where it belongs.
    pub imageset_id: Uuid,
    /// Unique in its set.
    pub name: String,
    /// Of its bytes, hex.
    pub sha256: String,
    /// Bytes.
    pub size: u64,
    /// `jpeg` or `png`.
    pub format: String,
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// What EXIF tells.
    pub exif: BTreeMap<String, serde_json::Value>,
    /// What is known of its pose.
    pub prior: Option<Prior>,
    /// Nanoseconds since the Unix epoch.
    pub capture_time_ns: Option<u64>,
    /// RFC 3339.
    pub created: String,
}

/// How large a thumbnail.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct ThumbnailQuery {
    /// Longest side, pixels: 64, 128, 256, 512 or 1024; 256 when absent.
    pub size: Option<u32>,
}

/// What became of one uploaded file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum UploadStatus {
    /// Kept, and safe against a crash.
    Stored,
    /// The set has these bytes already.
    Duplicate,
    /// Not kept.
    Rejected,
}

/// What became of one uploaded file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct UploadResult {
    /// As sent.
    pub name: String,
    /// What became of it.
    pub status: UploadStatus,
    /// Of the stored or the equal image.
    pub image_id: Option<Uuid>,
    /// Of the bytes, hex.
    pub sha256: Option<String>,
    /// Stable code of the rejection: `empty_file`, `not_an_image`, `truncated`, `too_large`,
    /// `name_taken`, `unsafe_name`, `archive_link`, `archive_ratio`, ...
    pub code: Option<String>,
    /// For people.
    pub detail: Option<String>,
    /// What is odd without being fatal.
    #[serde(default)]
    pub warnings: Vec<String>,
}

/// What became of an upload, file by file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct UploadReport {
    /// In the order sent.
    pub results: Vec<UploadResult>,
    /// Number of files kept.
    pub stored: u64,
    /// Number of files the set had.
    pub duplicates: u64,
    /// Number of files refused.
    pub rejected: u64,
}

/// Priors by image name.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PutPriors {
    /// By image name.
    pub priors: BTreeMap<String, Prior>,
}

/// What became of the poses of a model.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ModelReport {
    /// Number of images of the set that have the pose and the camera of the model now.
    pub updated: u64,
    /// Names in the model that no image of the set has.
    pub unknown: Vec<String>,
    /// Names of images of the set that the model does not have.
    pub missing: Vec<String>,
}

/// What became of the priors.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct PriorsReport {
    /// Number of images that have one now.
    pub updated: u64,
    /// Names that no image of the set has.
    pub unknown: Vec<String>,
}
