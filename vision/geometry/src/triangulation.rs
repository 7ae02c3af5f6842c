//! Points from rays.

use nalgebra::{Isometry3, Matrix2x3, Matrix3, Point3, Unit, Vector2, Vector3};

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

/// [`triangulate_linear`], then the point of least reprojection error (P42).
///
/// * Returns `None` where the rays do not determine it or it would lie behind a camera.
pub fn triangulate_refined(
    cam_from_world: &[Isometry3<f64>],
    xy: &[Vector2<f64>],
) -> Option<Point3<f64>> {
    let start = triangulate_linear(cam_from_world, xy)?;
    refine_point(cam_from_world, xy, &start)
}

/// Moves a point to the least `Σ ‖π(Tᵢ X) − xyᵢ‖²` by damped Gauss–Newton steps.
///
/// * `cam_from_world[i]`, `xy[i]`: pose and undistorted normalized coordinates of view i; views
///   past the shorter list are ignored.
/// * Returns `None` if the start lies behind a camera or the views leave the point undetermined.
pub fn refine_point(
    cam_from_world: &[Isometry3<f64>],
    xy: &[Vector2<f64>],
    start: &Point3<f64>,
) -> Option<Point3<f64>> {
    const MAX_STEPS: usize = 10;
    const TOLERANCE: f64 = 1e-10;
    let mut point = *start;
    let (mut cost, mut hessian, mut gradient) = reprojection_normal(cam_from_world, xy, &point)?;
    let mut damping = 0.0;
    for _ in 0..MAX_STEPS {
        let damped = hessian + Matrix3::from_diagonal(&(hessian.diagonal() * damping));
        let step = damped.cholesky()?.solve(&gradient);
        let candidate = point - step;
        match reprojection_normal(cam_from_world, xy, &candidate) {
            Some(next) if next.0 <= cost => {
                point = candidate;
                let converged = cost - next.0 <= TOLERANCE * cost;
                (cost, hessian, gradient) = next;
                damping *= 0.1;
                if converged {
                    break;
                }
            }
            _ => damping = (damping * 10.0).max(1e-3),
        }
    }
    point.coords.iter().all(|v| v.is_finite()).then_some(point)
}

/// Cost, `JᵀJ` and `Jᵀr`; `None` behind a camera.
fn reprojection_normal(
    cam_from_world: &[Isometry3<f64>],
    xy: &[Vector2<f64>],
    point: &Point3<f64>,
) -> Option<(f64, Matrix3<f64>, Vector3<f64>)> {
    let (mut cost, mut hessian, mut gradient) = (0.0, Matrix3::zeros(), Vector3::zeros());
    for (pose, xy) in cam_from_world.iter().zip(xy) {
        let p = pose * point;
        if p.z.is_nan() || p.z <= 0.0 {
            return None;
        }
        let (u, v) = (p.x / p.z, p.y / p.z);
        let residual = Vector2::new(u - xy.x, v - xy.y);
        let d_projection = Matrix2x3::new(1.0, 0.0, -u, 0.0, 1.0, -v) / p.z;
        let jacobian = d_projection * pose.rotation.to_rotation_matrix().into_inner();
        cost += residual.norm_squared();
        hessian += jacobian.tr_mul(&jacobian);
        gradient += jacobian.tr_mul(&residual);
    }
    Some((cost, hessian, gradient))
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
    Point3::from(-(cam_from_world.rotation.inverse() * cam_from_world.translation.vector))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn views() -> Vec<Isometry3<f64>> {
        (0..4)
            .map(|i| {
                let i = f64::from(i);
                Isometry3::new(
                    Vector3::new(-0.4 * i, 0.1 * i, 0.05 * i * i),
                    Vector3::new(0.02 * i, -0.08 * i, 0.01),
                )
            })
            .collect()
    }

    fn project(pose: &Isometry3<f64>, point: &Point3<f64>) -> Vector2<f64> {
        let p = pose * point;
        Vector2::new(p.x / p.z, p.y / p.z)
    }

    fn truth() -> Point3<f64> {
        Point3::new(0.3, -0.2, 4.0)
    }

    #[test]
    fn exact_rays_meet_in_the_point() {
        let views = views();
        let xy: Vec<_> = views.iter().map(|v| project(v, &truth())).collect();
        for n in 2..=4 {
            let linear = triangulate_linear(&views[..n], &xy[..n]).unwrap();
            let refined = triangulate_refined(&views[..n], &xy[..n]).unwrap();
            assert!((linear - truth()).norm() < 1e-9 && (refined - truth()).norm() < 1e-9);
        }
        let ray = |i: usize| {
            let ray = Vector3::new(xy[i].x, xy[i].y, 1.0);
            Unit::new_normalize(views[i].rotation.inverse() * ray)
        };
        let centers = [camera_center(&views[0]), camera_center(&views[1])];
        let middle = triangulate_midpoint([&centers[0], &centers[1]], [&ray(0), &ray(1)]).unwrap();
        assert!((middle - truth()).norm() < 1e-9);
    }

    /// P42: rays that do not meet give the point of least error; every step away costs more.
    #[test]
    fn refined_point_has_the_least_error() {
        let views = views();
        let noise = [(0.003, -0.001), (-0.002, 0.002), (0.001, 0.003), (-0.001, -0.002)];
        let xy: Vec<_> = views
            .iter()
            .zip(noise)
            .map(|(v, (a, b))| project(v, &truth()) + Vector2::new(a, b))
            .collect();
        let cost = |p: &Point3<f64>| -> f64 {
            views.iter().zip(&xy).map(|(v, xy)| (project(v, p) - xy).norm_squared()).sum()
        };
        let found = triangulate_refined(&views, &xy).unwrap();
        let linear = triangulate_linear(&views, &xy).unwrap();
        assert!(cost(&found) <= cost(&linear));
        for axis in 0..3 {
            for step in [1e-4, -1e-4] {
                let mut moved = found;
                moved[axis] += step;
                assert!(cost(&moved) > cost(&found));
            }
        }
    }

    /// The midpoint halves the shortest way between two skew lines.
    #[test]
    fn midpoint_of_skew_rays() {
        let centers = [Point3::origin(), Point3::new(0.0, 1.0, 0.0)];
        let rays = [Vector3::x_axis(), Vector3::z_axis()];
        let middle = triangulate_midpoint([&centers[0], &centers[1]], [&rays[0], &rays[1]]);
        assert!((middle.unwrap() - Point3::new(0.0, 0.5, 0.0)).norm() < 1e-12);
    }

    #[test]
    fn undetermined_points_are_refused() {
        let views = views();
        let x = Vector3::x_axis();
        assert_eq!(
            triangulate_midpoint([&Point3::origin(), &Point3::new(0.0, 1.0, 0.0)], [&x, &x]),
            None
        );
        let behind: Vec<_> =
            views.iter().map(|v| project(v, &Point3::new(0.3, -0.2, -4.0))).collect();
        assert_eq!(triangulate_refined(&views, &behind), None);
        assert_eq!(triangulate_refined(&[], &[]), None);
    }

    #[test]
    fn angle_at_the_point() {
        let (a, b) = (Point3::new(-1.0, 0.0, 0.0), Point3::new(1.0, 0.0, 0.0));
        let angle = triangulation_angle(&a, &b, &Point3::new(0.0, 0.0, 1.0));
        assert!((angle - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
    }
}
