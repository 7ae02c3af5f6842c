//! COLMAP's sparse models, text and binary.

mod binary;
mod text;

pub use binary::{read_colmap_binary, write_colmap_binary};
pub use text::{read_colmap_text, write_colmap_text};

/// Contents of the three files `cameras`, `images`, `points3D`, `.txt` or `.bin`.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ColmapFiles {
    /// `cameras.txt` or `cameras.bin`.
    pub cameras: Vec<u8>,
    /// `images.txt` or `images.bin`.
    pub images: Vec<u8>,
    /// `points3D.txt` or `points3D.bin`.
    pub points: Vec<u8>,
}

/// Which of the three files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ColmapFile {
    /// `cameras`.
    Cameras,
    /// `images`.
    Images,
    /// `points3D`.
    Points,
}

/// Why a model was refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ColmapError {
    /// Cut off, or a count that cannot be true.
    #[error("{file:?} file ends too early, at byte {offset}")]
    Truncated {
        /// Which file.
        file: ColmapFile,
        /// Where.
        offset: usize,
    },
    /// A line or record that makes no sense.
    #[error("{file:?} file, line or record {record}: {detail}")]
    Invalid {
        /// Which file.
        file: ColmapFile,
        /// From 1.
        record: usize,
        /// What is wrong.
        detail: String,
    },
    /// An image or point names something that is not there.
    #[error("{file:?} file, line or record {record}: {what} {id} does not exist")]
    Dangling {
        /// Which file.
        file: ColmapFile,
        /// From 1.
        record: usize,
        /// What it names.
        what: &'static str,
        /// The id.
        id: u64,
    },
}
