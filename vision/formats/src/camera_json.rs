//! `camera.json`: intrinsics of one camera.

use volery_geometry::Camera;

/// Why a camera file was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CameraFileError {
    /// Not JSON, or a field is missing or of the wrong type.
    #[error("camera file: {0}")]
    Json(String),
    /// A model that is not known.
    #[error("camera file: unknown model {model:?}, known are {known}")]
    UnknownModel {
        /// What came.
        model: String,
        /// What is understood.
        known: String,
    },
    /// A distortion coefficient that the model does not have.
    #[error("camera file: model {model} has no distortion coefficient {name:?}")]
    UnknownCoefficient {
        /// The model.
        model: String,
        /// The coefficient.
        name: String,
    },
    /// `pixel_center` is neither 0 nor 0.5.
    #[error("camera file: pixel_center is {0}, expected 0 or 0.5")]
    PixelCenter(f64),
    /// The numbers make no camera.
    #[error("camera file: {0}")]
    Camera(#[from] volery_geometry::CameraError),
}

/// Reads `{model, width, height, fx, fy, cx, cy, distortion: {k1, ..}}` or COLMAP's
/// `{model, width, height, params: [..]}`.
pub fn read_camera_json(bytes: &[u8]) -> Result<Camera, CameraFileError> {
    let _ = bytes;
    todo!()
}

/// Writes COLMAP's form with `"pixel_center": 0.5`; [`read_camera_json`] reads it back exactly.
pub fn write_camera_json(camera: &Camera) -> String {
    let _ = camera;
    todo!()
}
