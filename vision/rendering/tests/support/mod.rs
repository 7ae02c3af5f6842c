//! Cameras and shapes that several tests draw.
#![allow(dead_code, unreachable_pub, reason = "each test uses a part")]

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use volery_geometry::{Camera, CameraModel};
use volery_scene::TriangleMesh;

/// A camera of a model with all its distortion, 321 x 243 pixels: not whole blocks.
pub fn camera(model: CameraModel) -> Camera {
    let distortion: &[f64] = match model {
        CameraModel::SimplePinhole | CameraModel::Pinhole => &[],
        CameraModel::SimpleRadial => &[-0.12],
        CameraModel::Radial => &[-0.12, 0.05],
        CameraModel::OpenCv => &[-0.12, 0.05, 0.002, -0.003],
        CameraModel::OpenCvFisheye => &[-0.02, 0.01, -0.004, 0.001],
        CameraModel::FullOpenCv => &[-0.12, 0.05, 0.002, -0.003, 0.02, 0.01, 0.003, 0.002],
    };
    // The fisheye looks 120 degrees wide.
    let focal = if model == CameraModel::OpenCvFisheye { 150.0 } else { 240.0 };
    let mut params = vec![focal, 1.02 * focal];
    params.truncate(model.num_focals());
    params.extend([158.0, 124.0]);
    params.extend(distortion);
    Camera::new(model, 321, 243, &params).expect("constants are valid")
}

/// A pose that is no special case.
pub fn pose() -> Isometry3<f64> {
    Isometry3::from_parts(
        Translation3::new(0.4, -1.2, 2.3),
        UnitQuaternion::from_euler_angles(0.4, -1.0, 2.0),
    )
}

/// Puts positions given in the camera frame into the world of [`pose`].
pub fn seen_at(positions_in_cam: &[Point3<f64>]) -> Vec<Point3<f64>> {
    let world_from_cam = pose().inverse();
    positions_in_cam.iter().map(|p| world_from_cam * p).collect()
}

/// A parallelogram as two triangles, in the camera frame.
pub fn add_quad(
    mesh: &mut TriangleMesh,
    corner: Point3<f64>,
    u: Vector3<f64>,
    v: Vector3<f64>,
    color: [u8; 3],
) {
    let first = mesh.vertices.len() as u32;
    mesh.vertices.extend(seen_at(&[corner, corner + u, corner + v, corner + u + v]));
    mesh.colors.extend([color; 4]);
    mesh.triangles.extend([[0, 1, 2], [1, 3, 2]].map(|t| t.map(|k| first + k)));
}
