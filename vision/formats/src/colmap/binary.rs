//! The binary form, little endian.

use volery_scene::SparseModel;

use super::{ColmapError, ColmapFiles};

/// Writes the binary form; camera, image and point ids are written plus one.
pub fn write_colmap_binary(model: &SparseModel) -> ColmapFiles {
    let _ = model;
    todo!()
}

/// Reads the binary form.
pub fn read_colmap_binary(files: &ColmapFiles) -> Result<SparseModel, ColmapError> {
    let _ = files;
    todo!()
}
