//! nerfstudio's `transforms.json`.

use nalgebra::{Isometry3, Matrix3, Matrix4, Rotation3, Translation3, UnitQuaternion};
use serde_json::{Value, json};
use volery_geometry::{Camera, CameraModel};
use volery_scene::{CameraId, ImageId, RegisteredImage, SparseModel};

/// Why a document was refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum TransformsError {
    /// No JSON, or none with `frames`.
    #[error("not a transforms.json: {0}")]
    NotTransforms(String),
    /// A frame that makes no sense.
    #[error("frame {frame} ({name}): {detail}")]
    Frame {
        /// From 0.
        frame: usize,
        /// Its `file_path`, if it has one.
        name: String,
        /// What is wrong.
        detail: String,
    },
}

/// Rows of a rotation may miss orthonormality by so much: documents are written with few digits.
const MAX_SKEW: f64 = 1e-2;

/// Writes the posed images of a model; file paths are `image_folder/name`.
///
/// `transform_matrix` is world from camera with OpenGL's camera axes (x right, y up, z back), as
/// nerfstudio wants it; the world is the model's. The principal point counts the first pixel
/// center as (0.5, 0.5).
pub fn write_transforms_json(model: &SparseModel, image_folder: &str) -> String {
    let cam_from_opengl = cam_from_opengl();
    let frames: Vec<Value> = model
        .images
        .values()
        .filter_map(|image| {
            let camera = model.cameras.get(&image.camera)?;
            let world_from_cam = image.cam_from_world.inverse();
            let rotation =
                world_from_cam.rotation.to_rotation_matrix().into_inner() * cam_from_opengl;
            let mut matrix = Matrix4::identity();
            matrix.fixed_view_mut::<3, 3>(0, 0).copy_from(&rotation);
            matrix.fixed_view_mut::<3, 1>(0, 3).copy_from(&world_from_cam.translation.vector);
            let rows: Vec<Vec<f64>> =
                (0..4).map(|row| matrix.row(row).iter().copied().collect()).collect();
            let mut frame = intrinsics(camera);
            frame["file_path"] = json!(match image_folder {
                "" => image.name.clone(),
                folder => format!("{folder}/{}", image.name),
            });
            frame["transform_matrix"] = json!(rows);
            Some(frame)
        })
        .collect();
    let mut document = json!({ "frames": frames, "ply_file_path": "sparse.ply" });
    // Shared intrinsics stand at the top too, where older readers look for them.
    if let (1, Some(camera)) = (model.cameras.len(), model.cameras.values().next()) {
        let shared = intrinsics(camera);
        for (key, value) in shared.as_object().into_iter().flatten() {
            document[key] = value.clone();
        }
    }
    format!("{document:#}\n")
}

/// Turns OpenGL's camera axes (x right, y up, z back) into ours, and back.
fn cam_from_opengl() -> Matrix3<f64> {
    Matrix3::from_diagonal(&[1.0, -1.0, -1.0].into())
}

/// Reads the posed images and their cameras; names are the file paths as written. There are no
/// points. Axes as with [`write_transforms_json`].
///
/// # Errors
///
/// [`TransformsError`], with the frame.
pub fn read_transforms_json(text: &str) -> Result<SparseModel, TransformsError> {
    let bad = |detail: &str| TransformsError::NotTransforms(detail.to_owned());
    let document: Value = serde_json::from_str(text).map_err(|e| bad(&e.to_string()))?;
    let frames = document["frames"].as_array().ok_or_else(|| bad("it has no array `frames`"))?;
    let mut cameras: Vec<Camera> = Vec::new();
    let mut model = SparseModel::default();
    for (index, frame) in frames.iter().enumerate() {
        let name = frame["file_path"].as_str().unwrap_or_default().to_owned();
        let wrong =
            |detail: String| TransformsError::Frame { frame: index, name: name.clone(), detail };
        if name.is_empty() {
            return Err(wrong("it has no file_path".to_owned()));
        }
        let camera = read_camera(frame, &document).map_err(wrong)?;
        let cam_from_world = read_pose(&frame["transform_matrix"]).map_err(wrong)?;
        let id = cameras.iter().position(|known| *known == camera).unwrap_or_else(|| {
            cameras.push(camera);
            cameras.len() - 1
        });
        let camera = CameraId(id as u32);
        let (keypoints, points) = (Vec::new(), Vec::new());
        let image = RegisteredImage { name, camera, cam_from_world, keypoints, points };
        model.images.insert(ImageId(index as u32), image);
    }
    model.cameras = (0..).map(CameraId).zip(cameras).collect();
    Ok(model)
}

/// Intrinsics of a frame, from its own values and those that all frames share.
fn read_camera(frame: &Value, shared: &Value) -> Result<Camera, String> {
    let value = |name: &str| frame[name].as_f64().or_else(|| shared[name].as_f64());
    let need = |name: &str| value(name).ok_or_else(|| format!("{name} is missing"));
    let size = |name: &str| {
        let sides = need(name)?;
        if sides.fract() == 0.0 && (1.0..=f64::from(u32::MAX)).contains(&sides) {
            Ok(sides as u32)
        } else {
            Err(format!("{name} is {sides}"))
        }
    };
    let named = frame["camera_model"].as_str().or_else(|| shared["camera_model"].as_str());
    let fx = need("fl_x")?;
    let mut params = vec![fx, value("fl_y").unwrap_or(fx), need("cx")?, need("cy")?];
    let mut distortion = |names: &[&str]| {
        params.extend(names.iter().map(|name| value(name).unwrap_or(0.0)));
    };
    let has = |names: &[&str]| names.iter().any(|name| value(name).is_some_and(|k| k != 0.0));
    let model = match named {
        Some("OPENCV_FISHEYE") => {
            distortion(&["k1", "k2", "k3", "k4"]);
            CameraModel::OpenCvFisheye
        }
        None | Some("OPENCV" | "PINHOLE" | "SIMPLE_PINHOLE" | "SIMPLE_RADIAL" | "RADIAL")
            if has(&["k3", "k4", "k5", "k6"]) =>
        {
            distortion(&["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"]);
            CameraModel::FullOpenCv
        }
        None | Some("OPENCV" | "PINHOLE" | "SIMPLE_PINHOLE" | "SIMPLE_RADIAL" | "RADIAL") => {
            distortion(&["k1", "k2", "p1", "p2"]);
            CameraModel::OpenCv
        }
        Some(other) => return Err(format!("camera model {other:.40?} is not known")),
    };
    Camera::new(model, size("w")?, size("h")?, &params).map_err(|error| error.to_string())
}

/// `cam_from_world` of a `transform_matrix`.
fn read_pose(matrix: &Value) -> Result<Isometry3<f64>, String> {
    let at = |row: usize, column: usize| {
        matrix[row][column]
            .as_f64()
            .filter(|value| value.is_finite())
            .ok_or_else(|| format!("transform_matrix has no number in row {row}, column {column}"))
    };
    let (mut rotation, mut center) = (Matrix3::zeros(), nalgebra::Vector3::zeros());
    for row in 0..3 {
        for column in 0..3 {
            rotation[(row, column)] = at(row, column)?;
        }
        center[row] = at(row, 3)?;
    }
    let skew = (rotation.transpose() * rotation - Matrix3::identity()).norm();
    if skew > MAX_SKEW || rotation.determinant() < 0.0 {
        return Err("transform_matrix does not turn without stretching or mirroring".to_owned());
    }
    let world_from_cam = Rotation3::from_matrix(&(rotation * cam_from_opengl()));
    let world_from_cam = UnitQuaternion::from_rotation_matrix(&world_from_cam);
    Ok(Isometry3::from_parts(Translation3::from(center), world_from_cam).inverse())
}

/// Intrinsics under nerfstudio's names.
fn intrinsics(camera: &Camera) -> Value {
    let k = camera.calibration_matrix();
    let is_fisheye = camera.model == CameraModel::OpenCvFisheye;
    let mut value = json!({
        "camera_model": if is_fisheye { "OPENCV_FISHEYE" } else { "OPENCV" },
        "w": camera.width,
        "h": camera.height,
        "fl_x": k[(0, 0)],
        "fl_y": k[(1, 1)],
        "cx": k[(0, 2)],
        "cy": k[(1, 2)],
    });
    let names: &[&str] = match camera.model {
        CameraModel::OpenCvFisheye => &["k1", "k2", "k3", "k4"],
        _ => &["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"],
    };
    let distortion = &camera.params()[camera.model.distortion_start()..];
    for (name, coefficient) in names.iter().zip(distortion) {
        value[name] = json!(coefficient);
    }
    value
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A point in front of the camera has negative z in OpenGL's camera axes.
    #[test]
    fn cameras_look_along_minus_z() {
        let model = crate::colmap::tests::model();
        let text = write_transforms_json(&model, "images");
        let document: Value = serde_json::from_str(&text).unwrap();
        let frame = &document["frames"][0];
        let image = model.images.values().next().unwrap();
        assert_eq!(frame["file_path"], "images/a b.jpg");
        let m = |r: usize, c: usize| frame["transform_matrix"][r][c].as_f64().unwrap();
        let center = image.center();
        for axis in 0..3 {
            assert!((m(axis, 3) - center[axis]).abs() < 1e-12);
        }
        let ahead = image.cam_from_world.inverse() * nalgebra::Point3::new(0.0, 0.0, 1.0) - center;
        for axis in 0..3 {
            assert!((m(axis, 2) + ahead[axis]).abs() < 1e-12);
        }
    }

    #[test]
    fn poses_and_cameras_come_back() {
        let model = crate::colmap::tests::model();
        let back = read_transforms_json(&write_transforms_json(&model, "images")).unwrap();
        assert_eq!(back.images.len(), model.images.len());
        for (image, again) in model.images.values().zip(back.images.values()) {
            assert_eq!(again.name, format!("images/{}", image.name));
            let difference = image.cam_from_world * again.cam_from_world.inverse();
            assert!(difference.translation.vector.norm() < 1e-9, "{difference}");
            assert!(difference.rotation.angle() < 1e-6, "{difference}");
            let (camera, read) = (&model.cameras[&image.camera], &back.cameras[&again.camera]);
            let ray = nalgebra::Point3::new(0.2, -0.1, 1.0);
            let (a, b) = (camera.project(&ray).unwrap(), read.project(&ray).unwrap());
            assert!((a - b).norm() < 1e-9, "{a} {b}");
        }
    }

    #[test]
    fn senseless_documents_are_named() {
        let frame = |matrix: Value| {
            json!({"frames": [{"file_path": "a.jpg", "w": 4, "h": 4,
            "fl_x": 4.0, "cx": 2.0, "cy": 2.0, "transform_matrix": matrix}]})
        };
        let eye = json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]);
        assert!(read_transforms_json(&frame(eye.clone()).to_string()).is_ok());
        let mut no_focal = frame(eye.clone());
        no_focal["frames"][0]["fl_x"] = Value::Null;
        let mut fraction = frame(eye.clone());
        fraction["frames"][0]["w"] = json!(4.5);
        let mut unnamed = frame(eye);
        unnamed["frames"][0]["file_path"] = Value::Null;
        let mirror = json!([[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]);
        let short = json!([[1, 0, 0, 0], [0, 1, 0, 0]]);
        for (document, word) in [
            (json!({}), "frames"),
            (no_focal, "fl_x"),
            (fraction, "w is 4.5"),
            (unnamed, "file_path"),
            (frame(mirror), "mirroring"),
            (frame(short), "row 2"),
        ] {
            let error = read_transforms_json(&document.to_string()).unwrap_err().to_string();
            assert!(error.contains(word), "{error}");
        }
    }

    #[test]
    fn distortion_has_its_names() {
        let model = crate::colmap::tests::model();
        let camera = intrinsics(&model.cameras[&volery_scene::CameraId(7)]);
        assert_eq!((&camera["k1"], &camera["p1"]), (&json!(-0.1), &json!(0.001)));
        assert_eq!(camera["fl_x"], json!(1200.5));
    }
}
