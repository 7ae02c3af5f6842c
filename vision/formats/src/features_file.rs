//! Features and two-view geometries as bytes, for the cache between stages.

use volery_scene::{Features, TwoViewGeometry};

/// Why cached bytes were refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum FeaturesFileError {
    /// Other bytes, or of another version.
    #[error("not a file of this kind and version")]
    WrongKind,
    /// Cut off or inconsistent.
    #[error("the file is damaged at byte {offset}")]
    Damaged {
        /// Where.
        offset: usize,
    },
}

/// Bytes of the features of one image.
pub fn write_features(features: &Features) -> Vec<u8> {
    let _ = features;
    todo!()
}

/// The inverse of [`write_features`].
pub fn read_features(bytes: &[u8]) -> Result<Features, FeaturesFileError> {
    let _ = bytes;
    todo!()
}

/// Bytes of a list of verified pairs.
pub fn write_two_view_geometries(pairs: &[TwoViewGeometry]) -> Vec<u8> {
    let _ = pairs;
    todo!()
}

/// The inverse of [`write_two_view_geometries`].
pub fn read_two_view_geometries(bytes: &[u8]) -> Result<Vec<TwoViewGeometry>, FeaturesFileError> {
    let _ = bytes;
    todo!()
}
