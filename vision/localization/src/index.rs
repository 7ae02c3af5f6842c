//! What localization needs of a map, made once per map version and shared by all requests.

use volery_features::GlobalDescriptor;
use volery_scene::{Descriptor, SparseModel};

/// Everything of a map that localization reads.
pub struct LocalizationIndex {}

impl LocalizationIndex {
    /// From a model (in the map frame) and, per image of `model.images` in order, the descriptors
    /// of all its keypoints and its global descriptor.
    pub fn new(
        model: &SparseModel,
        descriptors: &[Vec<Descriptor>],
        global_descriptors: &[GlobalDescriptor],
    ) -> Self {
        let _ = (model, descriptors, global_descriptors);
        todo!()
    }

    /// The bytes of the index, to be kept beside the map.
    pub fn to_bytes(&self) -> Vec<u8> {
        todo!()
    }

    /// The inverse of [`Self::to_bytes`]; untrusted bytes give an error, never a panic.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, IndexError> {
        let _ = bytes;
        todo!()
    }
}

/// Why bytes are not an index.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum IndexError {
    /// Truncated or inconsistent.
    #[error("localization index is damaged at byte {offset}")]
    Damaged {
        /// Where.
        offset: usize,
    },
}
