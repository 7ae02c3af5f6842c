//! Why there is no map.

use serde::{Deserialize, Serialize};

/// A failure that people and programs can act on.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
#[error("{detail}")]
pub struct PipelineError {
    /// Stable: see [`code`].
    pub code: String,
    /// What happened, with the figures.
    pub detail: String,
    /// What to do about it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hint: Option<String>,
}

/// Codes of [`PipelineError`]; stable.
pub mod code {
    /// The list of images is empty.
    pub const NO_IMAGES: &str = "no_images";
    /// Poses were to be given, but the images have none.
    pub const NO_GIVEN_POSES: &str = "no_given_poses";
    /// The model of another program cannot be read.
    pub const BAD_MODEL: &str = "bad_model";
    /// Fewer than two images could be decoded.
    pub const TOO_FEW_IMAGES: &str = "too_few_images";
    /// No two images show the same.
    pub const NO_OVERLAP: &str = "no_overlap";
    /// The camera only turned.
    pub const NO_PARALLAX: &str = "no_parallax";
    /// Nothing could be built although images match.
    pub const NO_MODEL: &str = "no_model";
    /// The images show too little to hold on to.
    pub const TOO_FEW_FEATURES: &str = "too_few_features";
    /// An argument makes no sense.
    pub const BAD_INPUT: &str = "bad_input";
    /// No image has another one that could tell its depth.
    pub const TOO_FEW_VIEWS: &str = "too_few_views";
    /// The depth maps do not confirm each other anywhere.
    pub const NO_DENSE_POINTS: &str = "no_dense_points";
    /// The dense cloud is too small for a surface.
    pub const TOO_FEW_POINTS: &str = "too_few_points";
    /// Nothing is left of the surface where points support it.
    pub const EMPTY_MESH: &str = "empty_mesh";
    /// The surface could not be made for another reason.
    pub const MESH_FAILED: &str = "mesh_failed";
    /// The surface is there, but not painted.
    pub const TEXTURE_FAILED: &str = "texture_failed";
    /// Asked to stop.
    pub const CANCELLED: &str = "cancelled";
    /// A file could not be read or written.
    pub const IO: &str = "io";
    /// A map folder is damaged or of another kind.
    pub const BAD_MAP: &str = "bad_map";
}

impl PipelineError {
    /// An error with a hint.
    pub fn new(code: &str, detail: impl Into<String>, hint: &str) -> Self {
        Self { code: code.to_owned(), detail: detail.into(), hint: Some(hint.to_owned()) }
    }

    /// An error that explains itself.
    pub fn plain(code: &str, detail: impl Into<String>) -> Self {
        Self { code: code.to_owned(), detail: detail.into(), hint: None }
    }

    /// A file operation on `path` failed.
    pub fn io(path: &std::path::Path, error: &std::io::Error) -> Self {
        Self::plain(code::IO, format!("{}: {error}", path.display()))
    }

    /// Whether the work was asked to stop.
    pub fn is_cancelled(&self) -> bool {
        self.code == code::CANCELLED
    }
}

impl From<volery_scene::Cancelled> for PipelineError {
    fn from(_: volery_scene::Cancelled) -> Self {
        Self::plain(code::CANCELLED, "cancelled")
    }
}
