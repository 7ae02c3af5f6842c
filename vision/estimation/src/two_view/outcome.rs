//! The inliers of a model and the answer made of them.

use nalgebra::{Isometry3, Matrix3, Translation3, UnitQuaternion};
use volery_geometry::median;
use volery_scene::{FeatureMatch, ImageId, TwoViewGeometry, TwoViewKind};

use super::correspondences::{homography_error, indices_below, pixel_from_scaled};
use super::refinement::scaled_essential;
use super::turn::Turn;
use super::verification::Verification;

impl Verification<'_> {
    pub(super) fn rotation_only(
        &self,
        turn: UnitQuaternion<f64>,
        h: &Matrix3<f64>,
    ) -> Option<TwoViewGeometry> {
        let errors = self.errors(|pair| homography_error(h, pair));
        let inliers = self.inliers(&errors);
        let pose = Isometry3::from_parts(Translation3::identity(), turn);
        self.geometry(TwoViewKind::RotationOnly, Some(pose), None, Some(h), &inliers, &turn)
    }

    /// A turn whose angle depends on the focal length, which is unknown.
    pub(super) fn turn_of_unknown_angle(&self, turn: &Turn) -> Option<TwoViewGeometry> {
        let h = &turn.homography;
        let inliers = self.inliers(&self.errors(|pair| homography_error(h, pair)));
        self.geometry(TwoViewKind::RotationOnly, None, None, Some(h), &inliers, &turn.rotation)
    }

    pub(super) fn with_pose(
        &self,
        kind: TwoViewKind,
        pose: Isometry3<f64>,
        homography: Option<&Matrix3<f64>>,
    ) -> Option<TwoViewGeometry> {
        let f = scaled_essential(&self.data, &pose);
        let errors = self.errors(|pair| self.error_in_front(&pose, &f, pair));
        let inliers = self.inliers(&errors);
        self.geometry(kind, Some(pose), Some(f), homography, &inliers, &pose.rotation)
    }

    /// Indices within the threshold, the best first, one per feature.
    pub(super) fn inliers(&self, errors: &[f64]) -> Vec<usize> {
        let mut order: Vec<usize> = indices_below(errors, self.data.squared_threshold).collect();
        order.sort_by(|&a, &b| {
            errors[a].total_cmp(&errors[b]).then(self.matches[a].cmp(&self.matches[b]))
        });
        let largest = |f: fn(&FeatureMatch) -> u32| {
            self.matches.iter().map(|m| f(m) as usize + 1).max().unwrap_or(0)
        };
        let mut used1 = vec![false; largest(|m| m.feature1)];
        let mut used2 = vec![false; largest(|m| m.feature2)];
        order.retain(|&i| {
            let m = self.matches[i];
            let (one, two) = (&mut used1[m.feature1 as usize], &mut used2[m.feature2 as usize]);
            let free = !*one && !*two;
            if free {
                (*one, *two) = (true, true);
            }
            free
        });
        order
    }

    pub(super) fn geometry(
        &self,
        kind: TwoViewKind,
        cam2_from_cam1: Option<Isometry3<f64>>,
        scaled_fundamental: Option<Matrix3<f64>>,
        scaled_homography: Option<&Matrix3<f64>>,
        inliers: &[usize],
        turn: &UnitQuaternion<f64>,
    ) -> Option<TwoViewGeometry> {
        if inliers.len() < self.min_inliers {
            return None;
        }
        let mut parallax: Vec<f64> = inliers
            .iter()
            .map(|&i| {
                let pair = &self.data.pairs[i];
                (turn * pair.bearing1).cross(&pair.bearing2).norm().min(1.0).asin()
            })
            .collect();
        let median_parallax = median(&mut parallax)?;
        let k1 = pixel_from_scaled(self.camera1).try_inverse()?;
        let k2 = pixel_from_scaled(self.camera2);
        let k2_inv_t = k2.try_inverse()?.transpose();
        let unit = |m: Matrix3<f64>| m / m.norm();
        let mut matches: Vec<FeatureMatch> = inliers.iter().map(|&i| self.matches[i]).collect();
        matches.sort_unstable();
        Some(TwoViewGeometry {
            image1: ImageId(0),
            image2: ImageId(0),
            kind,
            matches,
            num_putative: self.num_putative,
            cam2_from_cam1,
            fundamental: scaled_fundamental.map(|f| unit(k2_inv_t * f * k1)),
            homography: scaled_homography.map(|h| unit(k2 * h * k1)),
            median_parallax,
        })
    }
}
