//! Archives that are uploaded in parts.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

/// Header that says where in the file a part begins, and where the next one is to.
pub const UPLOAD_OFFSET: &str = "Upload-Offset";

/// An archive to be uploaded in parts.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CreateUpload {
    /// The image set that its photos go into.
    pub imageset_id: Uuid,
    /// Bytes of the whole file.
    #[schema(minimum = 1)]
    pub size: u64,
    /// SHA-256 of the whole file, 64 lower-case hex digits.
    #[schema(min_length = 64, max_length = 64)]
    pub sha256: String,
}

/// An archive on its way.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Upload {
    /// Its id.
    pub id: Uuid,
    /// The image set that its photos go into.
    pub imageset_id: Uuid,
    /// Bytes of the whole file.
    pub size: u64,
    /// SHA-256 of the whole file.
    pub sha256: String,
    /// Bytes that are safe on the disk: the next part begins there.
    pub offset: u64,
    /// RFC 3339.
    pub created: String,
}
