//! Points from rays.

use nalgebra::{Isometry3, Point3, Unit, Vector2, Vector3};

/// Linear (DLT) triangulation of one point from n ≥ 2 views.
///
/// * `cam_from_world[i]`, `xy[i]`: pose and undistorted normalized coordinates of view i.
/// * Returns the point in the world frame, `None` where the rays do not determine it.
///
/// Source: Hartley & Zisserman, Multiple View Geometry, 12.2; rows are scaled by the view's
/// normalized coordinates.
pub fn triangulate_linear(
    cam_from_world: &[Isometry3<f64>],
    xy: &[Vector2<f64>],
) -> Option<Point3<f64>> {
    let mut a_t_a = nalgebra::Matrix4::<f64>::zeros();
    for (pose, xy) in cam_from_world.iter().zip(xy) {
        let p = pose.to_homogeneous();
        for row in [p.row(2) * xy.x - p.row(0), p.row(2) * xy.y - p.row(1)] {
            a_t_a += row.transpose() * row;
        }
    }
    let eigen = a_t_a.symmetric_eigen();
    let h = eigen.eigenvectors.column(eigen.eigenvalues.imin());
    let point = Point3::new(h[0] / h[3], h[1] / h[3], h[2] / h[3]);
    point.coords.iter().all(|v| v.is_finite()).then_some(point)
}

/// The point closest to two rays (P42).
///
/// * `center`: ray origins, `ray`: directions, all in one frame.
/// * Returns `None` for parallel rays.
pub fn triangulate_midpoint(
    center: [&Point3<f64>; 2],
    ray: [&Unit<Vector3<f64>>; 2],
) -> Option<Point3<f64>> {
    let w = center[0] - center[1];
    let b = ray[0].dot(ray[1]);
    let denominator = 1.0 - b * b;
    if denominator < 1e-14 {
        return None;
    }
    let (d, e) = (ray[0].dot(&w), ray[1].dot(&w));
    let s = (b * e - d) / denominator;
    let t = (e - b * d) / denominator;
    Some(nalgebra::center(&(center[0] + ray[0].scale(s)), &(center[1] + ray[1].scale(t))))
}

/// Angle at a point between the rays to two camera centers, radians in [0, π].
pub fn triangulation_angle(
    center1: &Point3<f64>,
    center2: &Point3<f64>,
    point: &Point3<f64>,
) -> f64 {
    (point - center1).angle(&(point - center2))
}

/// Camera center in the world frame.
pub fn camera_center(cam_from_world: &Isometry3<f64>) -> Point3<f64> {
    Point3::from(
        -(cam_from_world.rotation.inverse() * cam_from_world.translation.vector),
    )
}
