//! nerfstudio's `transforms.json`.

use volery_scene::SparseModel;

/// Writes the posed images of a model; file paths are `image_folder/name`.
pub fn write_transforms_json(model: &SparseModel, image_folder: &str) -> String {
    let _ = (model, image_folder);
    todo!()
}
