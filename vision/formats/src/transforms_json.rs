//! nerfstudio's `transforms.json`.

use nalgebra::{Matrix3, Matrix4};
use serde_json::{Value, json};
use volery_geometry::{Camera, CameraModel};
use volery_scene::SparseModel;

/// Writes the posed images of a model; file paths are `image_folder/name`.
///
/// `transform_matrix` is world from camera with OpenGL's camera axes (x right, y up, z back), as
/// nerfstudio wants it; the world is the model's. The principal point counts the first pixel
/// center as (0.5, 0.5).
pub fn write_transforms_json(model: &SparseModel, image_folder: &str) -> String {
    let cam_from_opengl = Matrix3::from_diagonal(&[1.0, -1.0, -1.0].into());
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
    fn distortion_has_its_names() {
        let model = crate::colmap::tests::model();
        let camera = intrinsics(&model.cameras[&volery_scene::CameraId(7)]);
        assert_eq!((&camera["k1"], &camera["p1"]), (&json!(-0.1), &json!(0.001)));
        assert_eq!(camera["fl_x"], json!(1200.5));
    }
}
