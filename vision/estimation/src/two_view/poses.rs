//! Poses behind E and H, and what they put in front of the cameras.

use nalgebra::{Isometry3, Matrix3, Vector3};
use volery_geometry::epipolar::poses_from_essential;
use volery_geometry::homography::poses_from_homography;

use super::correspondences::{Correspondences, Pair, epipolar_error, homography_error};
use super::refinement::{Effort, refine_pose, scaled_essential};
use super::verification::Verification;
use crate::ransac::least_squares::Loss;

impl Verification<'_> {
    /// Of the four poses of E the one that has the points in front of both cameras (P24). A point
    /// counts by its parallax, up to the threshold: far points vote at random.
    pub(super) fn choose_pose(
        &self,
        support: &Correspondences,
        e: &Matrix3<f64>,
    ) -> Option<Isometry3<f64>> {
        poses_from_essential(e)?
            .into_iter()
            .map(|pose| (self.votes_in_front(support, &pose), pose))
            .max_by(|(a, _), (b, _)| a.total_cmp(b))
            .map(|(_, pose)| pose)
    }

    pub(super) fn votes_in_front(&self, support: &Correspondences, pose: &Isometry3<f64>) -> f64 {
        let limit = self.data.squared_threshold.sqrt() / self.data.focal2;
        support
            .pairs
            .iter()
            .map(|pair| {
                let (front, parallax) = depth_signs(pose, &pair.bearing1, &pair.bearing2);
                if front { parallax.min(limit) } else { 0.0 }
            })
            .sum()
    }

    /// The best of the pose from E and the motions behind H, each refined.
    ///
    /// Where one plane holds most points, two motions explain it equally well and only the few
    /// points off the plane tell them apart; a search over E ends at either.
    pub(super) fn best_refined(
        &self,
        support: &Correspondences,
        from_e: Isometry3<f64>,
        homography: Option<&Matrix3<f64>>,
        loss: Loss,
    ) -> Isometry3<f64> {
        let data = &self.data;
        let motions =
            homography.and_then(|h| poses_from_homography(&data.normalized_homography(h)));
        let seen = |normal: &Vector3<f64>| {
            let count = |p: &&Pair| normal.dot(&p.bearing1) > 0.0;
            support.pairs.iter().filter(count).count() * 2 > support.len()
        };
        let from_h = motions.iter().flatten().filter(|m| seen(&m.normal_in_cam1)).filter_map(|m| {
            let t = m.cam2_from_cam1.translation.vector.try_normalize(1e-9)?;
            Some(Isometry3::from_parts(t.into(), m.cam2_from_cam1.rotation))
        });
        let mut best = (f64::INFINITY, from_e);
        for start in std::iter::once(from_e).chain(from_h) {
            let pose = refine_pose(data, &start, loss, Effort::FINAL);
            let f = scaled_essential(data, &pose);
            let cost: f64 = data
                .pairs
                .iter()
                .map(|pair| loss.evaluate(self.error_in_front(&pose, &f, pair)).0)
                .sum();
            if cost < best.0 {
                best = (cost, pose);
            }
        }
        best.1
    }

    /// Squared Sampson error, infinite for a point that is clearly behind a camera.
    pub(super) fn error_in_front(
        &self,
        pose: &Isometry3<f64>,
        f: &Matrix3<f64>,
        pair: &Pair,
    ) -> f64 {
        let limit = self.data.squared_threshold.sqrt() / self.data.focal2;
        let (front, parallax) = depth_signs(pose, &pair.bearing1, &pair.bearing2);
        if front || parallax < limit { epipolar_error(f, pair) } else { f64::INFINITY }
    }
}

/// Whether the rays meet in front of both cameras, and the sine of their angle once the rotation
/// is taken out.
fn depth_signs(
    pose: &Isometry3<f64>,
    bearing1: &Vector3<f64>,
    bearing2: &Vector3<f64>,
) -> (bool, f64) {
    // λ₂ q = λ₁ p + t; the cross products by q and p leave one depth each.
    let (p, q) = (pose.rotation * bearing1, bearing2);
    let t = pose.translation.vector;
    let normal = p.cross(q);
    let depth1 = q.cross(&t).dot(&normal);
    let depth2 = p.cross(&t).dot(&normal);
    (depth1 > 0.0 && depth2 > 0.0, normal.norm())
}

/// Whether most points lie on a plane that camera 2 sees from behind: surfaces are opaque, so
/// this is a mirror image or a coincidence.
pub(super) fn is_mirrored(support: &Correspondences, h: &Matrix3<f64>) -> bool {
    let determinant = h.determinant();
    let flipped = support
        .pairs
        .iter()
        .filter(|pair| homography_error(h, pair) < support.squared_threshold)
        .filter(|pair| determinant * (h * pair.x1).z < 0.0)
        .count();
    2 * flipped > support.len()
}
