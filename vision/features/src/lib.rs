//! Keypoints, descriptors, matching and retrieval.

pub mod matching;
pub mod retrieval;
pub mod sift;
mod simd;

pub use matching::{
    MatchOptions, PackedDescriptors, match_features, match_guided, squared_distance,
};
pub use retrieval::{GlobalDescriptor, global_descriptor};
pub use sift::{SiftOptions, detect_and_describe};
