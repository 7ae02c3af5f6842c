//! Robust triangulation of a track from many views.

use nalgebra::{Isometry3, Matrix3, Point3, Unit, Vector2, Vector3};
use volery_geometry::triangulation::{camera_center, triangulate_midpoint, triangulation_angle};

/// Most two-view hypotheses per track.
const MAX_HYPOTHESES: usize = 24;
/// Gauss–Newton steps on the reprojection error.
const MAX_REFINE_STEPS: usize = 5;

/// One sighting of a point to be triangulated.
#[derive(Debug, Clone, Copy)]
pub(crate) struct View {
    pub(crate) cam_from_world: Isometry3<f64>,
    pub(crate) center: Point3<f64>,
    /// Undistorted normalized coordinates.
    pub(crate) xy: Vector2<f64>,
    /// Turns normalized coordinates into pixels.
    pub(crate) focal_px: f64,
}

impl View {
    pub(crate) fn new(cam_from_world: Isometry3<f64>, xy: Vector2<f64>, focal_px: f64) -> Self {
        Self { cam_from_world, center: camera_center(&cam_from_world), xy, focal_px }
    }

    fn ray_in_world(&self) -> Unit<Vector3<f64>> {
        let ray_in_cam = Vector3::new(self.xy.x, self.xy.y, 1.0);
        Unit::new_normalize(self.cam_from_world.rotation.inverse_transform_vector(&ray_in_cam))
    }

    /// Squared reprojection error, pixels², infinite behind the camera.
    fn squared_error(&self, point: &Point3<f64>) -> f64 {
        let p = self.cam_from_world * point;
        if p.z <= f64::EPSILON {
            return f64::INFINITY;
        }
        (Vector2::new(p.x / p.z, p.y / p.z) - self.xy).norm_squared()
            * (self.focal_px * self.focal_px)
    }
}

/// A triangulated point and which views see it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Triangulated {
    pub(crate) position: Point3<f64>,
    pub(crate) inliers: Vec<bool>,
}

/// The point that most of the `views` agree on.
///
/// Two-view hypotheses are scored by truncated squared reprojection errors, the best is refined
/// over its inliers. `None` if fewer than two views agree within `max_error_px` or no two of them
/// see the point under at least `min_angle`.
pub(crate) fn triangulate_track(
    views: &[View],
    max_error_px: f64,
    min_angle: f64,
) -> Option<Triangulated> {
    if views.len() < 2 {
        return None;
    }
    let limit = max_error_px * max_error_px;
    let score = |point: &Point3<f64>| -> f64 {
        views.iter().map(|view| view.squared_error(point).min(limit)).sum()
    };
    let rays: Vec<_> = views.iter().map(View::ray_in_world).collect();
    let mut best: Option<(f64, Point3<f64>)> = None;
    for (i, j) in hypothesis_pairs(views.len(), &rays) {
        let Some(midpoint) =
            triangulate_midpoint([&views[i].center, &views[j].center], [&rays[i], &rays[j]])
        else {
            continue;
        };
        let point = refine_point(midpoint, [&views[i], &views[j]].into_iter());
        let score = score(&point);
        if best.is_none_or(|(least, _)| score < least) {
            best = Some((score, point));
            // Everybody agrees well: no other pair will say anything else.
            if score < 0.05 * limit * views.len() as f64 {
                break;
            }
        }
    }
    let mut position = best?.1;
    let mut inliers: Vec<bool> =
        views.iter().map(|view| view.squared_error(&position) <= limit).collect();
    for _ in 0..2 {
        let seen_by = views.iter().zip(&inliers).filter(|(_, inlier)| **inlier).map(|(v, _)| v);
        position = refine_point(position, seen_by);
        inliers = views.iter().map(|view| view.squared_error(&position) <= limit).collect();
    }
    let centers: Vec<Point3<f64>> =
        views.iter().zip(&inliers).filter(|(_, inlier)| **inlier).map(|(v, _)| v.center).collect();
    (centers.len() >= 2 && has_angle(&centers, &position, min_angle))
        .then_some(Triangulated { position, inliers })
}

/// Whether two of the `centers` see `point` under at least `min_angle`.
pub(crate) fn has_angle(centers: &[Point3<f64>], point: &Point3<f64>, min_angle: f64) -> bool {
    centers
        .iter()
        .enumerate()
        .any(|(i, a)| centers[..i].iter().any(|b| triangulation_angle(a, b, point) >= min_angle))
}

/// All pairs of few views; of many views those with the widest angles between their rays.
fn hypothesis_pairs(num_views: usize, rays: &[Unit<Vector3<f64>>]) -> Vec<(usize, usize)> {
    let mut pairs: Vec<(usize, usize)> = Vec::with_capacity(num_views * (num_views - 1) / 2);
    // A stride keeps very long tracks linear.
    let stride = num_views.div_ceil(12).max(1);
    for j in 0..num_views {
        pairs.extend((0..j).step_by(stride).map(|i| (i, j)));
    }
    let dot = |&(i, j): &(usize, usize)| rays[i].dot(&rays[j]);
    pairs.sort_by(|a, b| dot(a).total_cmp(&dot(b)).then(a.cmp(b)));
    pairs.truncate(MAX_HYPOTHESES);
    pairs
}

/// Gauss–Newton on the reprojection error; gives `point` back where it cannot be improved.
pub(crate) fn refine_point<'a>(
    point: Point3<f64>,
    views: impl Iterator<Item = &'a View> + Clone,
) -> Point3<f64> {
    let cost = |point: &Point3<f64>| views.clone().map(|v| v.squared_error(point)).sum::<f64>();
    let mut best = (cost(&point), point);
    if !best.0.is_finite() {
        return point;
    }
    for _ in 0..MAX_REFINE_STEPS {
        let mut a = Matrix3::zeros();
        let mut b = Vector3::zeros();
        for view in views.clone() {
            let p = view.cam_from_world * best.1;
            let rotation = view.cam_from_world.rotation.to_rotation_matrix();
            let r = rotation.matrix();
            let z_inv = 1.0 / p.z;
            let residual = Vector2::new(p.x * z_inv, p.y * z_inv) - view.xy;
            let row_x = (r.row(0) - r.row(2) * (p.x * z_inv)) * (z_inv * view.focal_px);
            let row_y = (r.row(1) - r.row(2) * (p.y * z_inv)) * (z_inv * view.focal_px);
            a += row_x.transpose() * row_x + row_y.transpose() * row_y;
            b += (row_x.transpose() * residual.x + row_y.transpose() * residual.y) * view.focal_px;
        }
        let Some(step) = a.cholesky().map(|cholesky| cholesky.solve(&b)) else { break };
        let candidate = best.1 - step;
        let new_cost = cost(&candidate);
        if new_cost.is_nan() || new_cost >= best.0 {
            break;
        }
        let converged = new_cost > 0.999 * best.0;
        best = (new_cost, candidate);
        if converged {
            break;
        }
    }
    best.1
}

#[cfg(test)]
mod tests {
    use super::*;

    const FOCAL: f64 = 500.0;

    /// Views along a line that look at `point`, `errors_px[i]` off.
    fn views(point: &Point3<f64>, baseline: f64, errors_px: &[f64]) -> Vec<View> {
        errors_px
            .iter()
            .enumerate()
            .map(|(i, error)| {
                let center = Point3::new(baseline * i as f64, 0.02 * i as f64, 0.0);
                let pose = Isometry3::translation(-center.x, -center.y, -center.z);
                let p = pose * point;
                let xy = Vector2::new(p.x / p.z, p.y / p.z + error / FOCAL);
                View::new(pose, xy, FOCAL)
            })
            .collect()
    }

    #[test]
    fn exact_views_give_the_point_back() {
        let truth = Point3::new(0.3, -0.2, 4.0);
        let found = triangulate_track(&views(&truth, 0.3, &[0.0; 5]), 4.0, 0.02).unwrap();
        assert!((found.position - truth).norm() < 1e-9);
        assert!(found.inliers.iter().all(|&inlier| inlier));
    }

    /// Two of six views are wrong; the point and the verdict on each view are right.
    #[test]
    fn wrong_views_are_left_out() {
        let truth = Point3::new(0.3, -0.2, 4.0);
        let errors = [0.2, 60.0, -0.3, 0.1, -45.0, 0.2];
        let found = triangulate_track(&views(&truth, 0.3, &errors), 4.0, 0.02).unwrap();
        assert_eq!(found.inliers, [true, false, true, true, false, true]);
        assert!((found.position - truth).norm() < 0.02);
    }

    /// No angle, one view, contradicting views, a point behind: no point.
    #[test]
    fn undetermined_points_are_refused() {
        let truth = Point3::new(0.3, -0.2, 4.0);
        assert_eq!(triangulate_track(&views(&truth, 0.001, &[0.0; 5]), 4.0, 0.02), None);
        assert_eq!(triangulate_track(&views(&truth, 0.3, &[0.0]), 4.0, 0.02), None);
        assert_eq!(triangulate_track(&[], 4.0, 0.02), None);
        assert_eq!(triangulate_track(&views(&truth, 0.3, &[0.0, 80.0]), 4.0, 0.02), None);
        let behind = Point3::new(0.3, -0.2, -4.0);
        assert_eq!(triangulate_track(&views(&behind, 0.3, &[0.0; 3]), 4.0, 0.02), None);
    }
}
