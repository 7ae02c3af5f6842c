//! `camera.json`: intrinsics of one camera.

use std::collections::BTreeMap;

use serde::Deserialize;
use serde_json::json;
use volery_geometry::{Camera, CameraError, CameraModel};

/// Name of OpenCV's radial-tangential model in calibration files: k1, k2, p1, p2, k3.
const OPENCV_RADTAN: &str = "OPENCV_RADTAN";

/// Why a camera file was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CameraFileError {
    /// Not JSON, or a field is missing, unknown or of the wrong type.
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
    Camera(#[from] CameraError),
}

/// Fields of the file. Those that are not known are ignored: calibration tools add notes.
#[derive(Deserialize)]
struct CameraFile {
    model: String,
    width: u32,
    height: u32,
    params: Option<Vec<f64>>,
    fx: Option<f64>,
    fy: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    distortion: Option<BTreeMap<String, f64>>,
    pixel_center: Option<f64>,
}

/// Reads `{model, width, height, fx, fy, cx, cy, distortion: {k1, ..}}` or COLMAP's
/// `{model, width, height, params: [..]}`.
///
/// A file with a `distortion` object comes from OpenCV, where the first pixel center is at (0, 0):
/// 0.5 is added to `cx, cy`. Without one, (0.5, 0.5) holds already. `"pixel_center": 0` or `0.5`
/// says it outright. `OPENCV_RADTAN` becomes `OPENCV`, or `FULL_OPENCV` with `k3`; a distortion
/// of zeros becomes `PINHOLE`.
///
/// # Errors
///
/// [`CameraFileError`] for what is not such a file, for an unknown model or coefficient, and for
/// numbers that make no camera.
pub fn read_camera_json(bytes: &[u8]) -> Result<Camera, CameraFileError> {
    let file: CameraFile =
        serde_json::from_slice(bytes).map_err(|error| CameraFileError::Json(error.to_string()))?;
    let shift = match file.pixel_center {
        Some(0.0) => 0.5,
        Some(0.5) => 0.0,
        Some(other) => return Err(CameraFileError::PixelCenter(other)),
        None if file.distortion.is_some() => 0.5,
        None => 0.0,
    };
    let (model, mut params) = match &file.params {
        Some(params) => (known_model(&file.model)?, params.clone()),
        None => from_named_values(&file)?,
    };
    if params.len() == model.num_params() {
        let center = model.num_focals();
        params[center] += shift;
        params[center + 1] += shift;
    }
    Ok(Camera::new(model, file.width, file.height, &params)?)
}

fn known_model(name: &str) -> Result<CameraModel, CameraFileError> {
    CameraModel::from_name(name).ok_or_else(|| {
        let names: Vec<&str> = CameraModel::ALL.iter().map(|model| model.name()).collect();
        CameraFileError::UnknownModel {
            model: name.chars().take(60).collect(),
            known: format!("{}, {OPENCV_RADTAN}", names.join(", ")),
        }
    })
}

/// Names of a model's distortion parameters in COLMAP's order.
fn coefficient_names(model: CameraModel) -> &'static [&'static str] {
    match model {
        CameraModel::SimplePinhole | CameraModel::Pinhole => &[],
        CameraModel::SimpleRadial => &["k1"],
        CameraModel::Radial => &["k1", "k2"],
        CameraModel::OpenCv => &["k1", "k2", "p1", "p2"],
        CameraModel::OpenCvFisheye => &["k1", "k2", "k3", "k4"],
        CameraModel::FullOpenCv => &["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"],
    }
}

fn from_named_values(file: &CameraFile) -> Result<(CameraModel, Vec<f64>), CameraFileError> {
    let no_distortion = BTreeMap::new();
    let distortion = file.distortion.as_ref().unwrap_or(&no_distortion);
    let is_set = |name: &str| distortion.get(name).is_some_and(|&value| value != 0.0);
    let is_zero = distortion.values().all(|&value| value == 0.0);
    let model = match file.model.as_str() {
        OPENCV_RADTAN if is_zero => CameraModel::Pinhole,
        OPENCV_RADTAN if ["k3", "k4", "k5", "k6"].iter().any(|name| is_set(name)) => {
            CameraModel::FullOpenCv
        }
        OPENCV_RADTAN => CameraModel::OpenCv,
        name => known_model(name)?,
    };
    let names = coefficient_names(model);
    if let Some(name) =
        distortion.keys().find(|name| is_set(name) && !names.contains(&name.as_str()))
    {
        let (model, name) = (file.model.clone(), name.chars().take(60).collect());
        return Err(CameraFileError::UnknownCoefficient { model, name });
    }
    let need = |value: Option<f64>, name: &str| {
        value.ok_or_else(|| CameraFileError::Json(format!("missing field `{name}`")))
    };
    let fx = need(file.fx, "fx")?;
    let mut params = vec![fx];
    if model.num_focals() == 2 {
        params.push(need(file.fy, "fy")?);
    } else if file.fy.is_some_and(|fy| fy != fx) {
        return Err(CameraFileError::Json(format!(
            "{} has one focal length: fx = fy",
            model.name()
        )));
    }
    params.extend([need(file.cx, "cx")?, need(file.cy, "cy")?]);
    params.extend(names.iter().map(|&name| distortion.get(name).copied().unwrap_or(0.0)));
    Ok((model, params))
}

/// Writes COLMAP's form with `"pixel_center": 0.5`; [`read_camera_json`] reads it back exactly.
pub fn write_camera_json(camera: &Camera) -> String {
    let value = json!({
        "model": camera.model.name(),
        "width": camera.width,
        "height": camera.height,
        "params": camera.params(),
        "pixel_center": 0.5,
    });
    format!("{value:#}\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Camera, CameraFileError> {
        read_camera_json(text.as_bytes())
    }

    const RADTAN: &str = r#"{"model": "OPENCV_RADTAN", "width": 640, "height": 480, "fx": 520.9,
        "fy": 521.0, "cx": 325.1, "cy": 249.7, "note": "calibrated",
        "distortion": {"k1": 0.2312, "k2": -0.7849, "p1": -0.0033, "p2": -0.0001, "k3": 0.9172}}"#;

    /// OpenCV counts pixel centers at integers, and writes k3 last.
    #[test]
    fn opencv_calibration() {
        let camera = read(RADTAN).unwrap();
        assert_eq!(camera.model, CameraModel::FullOpenCv);
        let expected =
            [520.9, 521.0, 325.6, 250.2, 0.2312, -0.7849, -0.0033, -0.0001, 0.9172, 0., 0., 0.];
        assert_eq!(camera.params(), expected);
        let without_k3 = read(&RADTAN.replace(r#", "k3": 0.9172"#, "")).unwrap();
        assert_eq!(without_k3.model, CameraModel::OpenCv);
    }

    /// An empty `distortion` still says that the file is OpenCV's; no such object, that it is not.
    #[test]
    fn pixel_center_follows_the_distortion_object() {
        let text = r#"{"model": "PINHOLE", "width": 640, "height": 480, "fx": 500.0, "fy": 500.0,
            "cx": 320.0, "cy": 240.0 EXTRA}"#;
        let cx = |extra: &str| read(&text.replace("EXTRA", extra)).unwrap().params()[2];
        assert_eq!(cx(""), 320.0);
        assert_eq!(cx(r#", "distortion": {}"#), 320.5);
        assert_eq!(cx(r#", "distortion": {}, "pixel_center": 0.5"#), 320.0);
        assert_eq!(cx(r#", "pixel_center": 0"#), 320.5);
        assert_eq!(
            read(&text.replace("EXTRA", r#", "pixel_center": 1"#)),
            Err(CameraFileError::PixelCenter(1.0))
        );
    }

    #[test]
    fn zero_distortion_is_a_pinhole() {
        let text = RADTAN.replace(
            r#""k1": 0.2312, "k2": -0.7849, "p1": -0.0033, "p2": -0.0001, "k3": 0.9172"#,
            r#""k1": 0.0, "k3": 0"#,
        );
        assert_eq!(read(&text).unwrap().model, CameraModel::Pinhole);
    }

    #[test]
    fn what_is_written_is_read_back() {
        for model in CameraModel::ALL {
            let mut params = vec![500.123_456_789; model.num_params()];
            for (i, value) in params.iter_mut().enumerate().skip(model.distortion_start()) {
                *value = 0.1 / (i as f64 + 3.0);
            }
            let camera = Camera::new(model, 640, 480, &params).unwrap();
            assert_eq!(read(&write_camera_json(&camera)), Ok(camera));
        }
    }

    #[test]
    fn refusals_name_the_cause() {
        let message = |text: &str| read(text).unwrap_err().to_string();
        assert!(message("{").contains("EOF"));
        assert!(
            message(&RADTAN.replace("OPENCV_RADTAN", "MAGIC")).contains("unknown model \"MAGIC\"")
        );
        assert!(message(&RADTAN.replace("\"fy\": 521.0,", "")).contains("missing field `fy`"));
        assert!(message(&RADTAN.replace("520.9", "-1")).contains("must be positive"));
        assert!(message(&RADTAN.replace("520.9", "1e999")).contains("number out of range"));
        assert!(
            message(&RADTAN.replace("OPENCV_RADTAN", "RADIAL").replace("521.0", "520.9"))
                .contains("no distortion coefficient \"k3\"")
        );
    }
}
