//! COLMAP's sparse models, text and binary.
//!
//! Our ids count from 0, COLMAP's from 1: ids are written plus one and read minus one.

mod binary;
mod build;
mod text;

use volery_scene::SparseModel;

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
    /// An image or point names something that is not there, or that does not name it back.
    #[error("{file:?} file: {what} {id} does not exist or does not point back")]
    Dangling {
        /// Which file.
        file: ColmapFile,
        /// What it names.
        what: &'static str,
        /// The id as written in the file.
        id: u64,
    },
}

/// Cameras and posed images of either form; who sees which point, and the points, are left out and
/// may be missing or wrong.
///
/// # Errors
///
/// [`ColmapError`] for files of cameras or images that are cut off or senseless.
pub fn read_colmap_poses(files: &ColmapFiles, is_binary: bool) -> Result<SparseModel, ColmapError> {
    let mut builder = build::Builder::of_poses();
    if is_binary {
        binary::read_cameras_and_images(files, &mut builder)?;
    } else {
        text::read_cameras_and_images(files, &mut builder)?;
    }
    builder.finish()
}

/// A file name as it may stand in a record: control characters would break it.
fn clean_name(name: &str) -> String {
    name.chars().map(|c| if c.is_control() { '_' } else { c }).collect()
}

#[cfg(test)]
pub(crate) mod tests;
