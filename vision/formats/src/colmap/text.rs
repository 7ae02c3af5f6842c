//! The text form.

use volery_scene::SparseModel;

use super::{ColmapError, ColmapFiles};

/// Writes the text form; camera, image and point ids are written plus one.
pub fn write_colmap_text(model: &SparseModel) -> ColmapFiles {
    let _ = model;
    todo!()
}

/// Reads the text form.
pub fn read_colmap_text(files: &ColmapFiles) -> Result<SparseModel, ColmapError> {
    let _ = files;
    todo!()
}
