//! The four models as RANSAC sees them.

use nalgebra::{Isometry3, Matrix3, Point2, UnitQuaternion};
use volery_geometry::epipolar::poses_from_essential;

use super::correspondences::Correspondences;
use super::refinement::{
    Effort, refine_fundamental, refine_homography, refine_pose, refine_rotation,
};
use crate::ransac::least_squares::Loss;
use crate::ransac::{Estimator, Hypotheses, Score};
use crate::solvers::{fundamental_7pt, homography_4pt, relpose_5pt, rotation_2pt};

fn truncated(data: &Correspondences) -> Loss {
    Loss::Truncated { squared_threshold: data.squared_threshold }
}

/// Essential matrices over normalized coordinates.
pub(super) struct EssentialEstimator<'a>(pub(super) &'a Correspondences);

impl Estimator for EssentialEstimator<'_> {
    type Model = Matrix3<f64>;
    const SAMPLE_SIZE: usize = 5;

    fn num_data(&self) -> usize {
        self.0.len()
    }

    fn solve(&self, sample: &[usize], hypotheses: &mut Hypotheses<Self::Model>) {
        let pairs = &self.0.pairs;
        let x1 = std::array::from_fn(|i| pairs[sample[i]].bearing1);
        let x2 = std::array::from_fn(|i| pairs[sample[i]].bearing2);
        hypotheses.extend(relpose_5pt(&x1, &x2));
    }

    fn score(&self, model: &Self::Model, bound: f64) -> Score {
        self.0.score_epipolar(&self.0.scaled_epipolar(model), bound)
    }

    fn refine(&self, model: &Self::Model) -> Option<Self::Model> {
        // Sampson errors do not see which of the four poses is the right one.
        let [pose, ..] = poses_from_essential(model)?;
        let refined: Isometry3<f64> = refine_pose(self.0, &pose, truncated(self.0), Effort::LOCAL);
        Some(volery_geometry::epipolar::essential_from_pose(&refined))
    }
}

/// Fundamental matrices over scaled coordinates.
pub(super) struct FundamentalEstimator<'a>(pub(super) &'a Correspondences);

impl Estimator for FundamentalEstimator<'_> {
    type Model = Matrix3<f64>;
    const SAMPLE_SIZE: usize = 7;

    fn num_data(&self) -> usize {
        self.0.len()
    }

    fn solve(&self, sample: &[usize], hypotheses: &mut Hypotheses<Self::Model>) {
        let data = self.0;
        // Coordinates of order one keep the null space well conditioned.
        let x1 = std::array::from_fn(|i| Point2::from(data.pairs[sample[i]].x1.xy() / data.focal1));
        let x2 = std::array::from_fn(|i| Point2::from(data.pairs[sample[i]].x2.xy() / data.focal2));
        hypotheses.extend(fundamental_7pt(&x1, &x2).iter().map(|f| data.scaled_epipolar(f)));
    }

    fn score(&self, model: &Self::Model, bound: f64) -> Score {
        self.0.score_epipolar(model, bound)
    }

    fn refine(&self, model: &Self::Model) -> Option<Self::Model> {
        refine_fundamental(self.0, model, truncated(self.0), Effort::LOCAL)
    }
}

/// Fundamental matrices `[e₂]ₓ H` of a plane and two points off it.
pub(super) struct ParallaxEstimator<'a> {
    pub(super) data: &'a Correspondences,
    /// Of the plane.
    pub(super) homography: Matrix3<f64>,
    /// Indices to draw from.
    pub(super) off_plane: Vec<usize>,
}

impl Estimator for ParallaxEstimator<'_> {
    type Model = Matrix3<f64>;
    const SAMPLE_SIZE: usize = 2;

    fn num_data(&self) -> usize {
        self.off_plane.len()
    }

    fn solve(&self, sample: &[usize], hypotheses: &mut Hypotheses<Self::Model>) {
        // Each point off the plane gives a line through the epipole of image 2.
        let line = |i: usize| {
            let pair = &self.data.pairs[self.off_plane[sample[i]]];
            (self.homography * pair.x1).cross(&pair.x2)
        };
        let epipole = line(0).cross(&line(1));
        if let Some(epipole) = epipole.try_normalize(0.0) {
            hypotheses.push(epipole.cross_matrix() * self.homography);
        }
    }

    fn score(&self, model: &Self::Model, bound: f64) -> Score {
        self.data.score_epipolar(model, bound)
    }

    fn refine(&self, model: &Self::Model) -> Option<Self::Model> {
        refine_fundamental(self.data, model, truncated(self.data), Effort::LOCAL)
    }
}

/// Homographies over scaled coordinates.
pub(super) struct HomographyEstimator<'a>(pub(super) &'a Correspondences);

impl Estimator for HomographyEstimator<'_> {
    type Model = Matrix3<f64>;
    const SAMPLE_SIZE: usize = 4;

    fn num_data(&self) -> usize {
        self.0.len()
    }

    fn solve(&self, sample: &[usize], hypotheses: &mut Hypotheses<Self::Model>) {
        let pairs = &self.0.pairs;
        let b1 = std::array::from_fn(|i| pairs[sample[i]].bearing1);
        let b2 = std::array::from_fn(|i| pairs[sample[i]].bearing2);
        if let Some(h) = homography_4pt(&b1, &b2) {
            hypotheses.push(self.0.scaled_homography(&h));
        }
    }

    fn score(&self, model: &Self::Model, bound: f64) -> Score {
        self.0.score_homography(model, bound)
    }

    fn refine(&self, model: &Self::Model) -> Option<Self::Model> {
        Some(refine_homography(self.0, model, truncated(self.0), Effort::LOCAL))
    }
}

/// Rotations `cam2_from_cam1` of a camera that stays in place.
pub(super) struct RotationEstimator<'a>(pub(super) &'a Correspondences);

impl Estimator for RotationEstimator<'_> {
    type Model = UnitQuaternion<f64>;
    const SAMPLE_SIZE: usize = 2;

    fn num_data(&self) -> usize {
        self.0.len()
    }

    fn solve(&self, sample: &[usize], hypotheses: &mut Hypotheses<Self::Model>) {
        let pairs = &self.0.pairs;
        let b1 = [pairs[sample[0]].bearing1, pairs[sample[1]].bearing1];
        let b2 = [pairs[sample[0]].bearing2, pairs[sample[1]].bearing2];
        // The angle between the rays survives a rotation.
        let tolerance = 4.0 * self.0.squared_threshold.sqrt() / self.0.focal1.min(self.0.focal2);
        if (b1[0].angle(&b1[1]) - b2[0].angle(&b2[1])).abs() > tolerance {
            return;
        }
        if let Some(r) = rotation_2pt(&b1, &b2) {
            hypotheses.push(UnitQuaternion::from_rotation_matrix(&r));
        }
    }

    fn score(&self, model: &Self::Model, bound: f64) -> Score {
        let r = model.to_rotation_matrix().into_inner();
        self.0.score_homography(&self.0.scaled_homography(&r), bound)
    }

    fn refine(&self, model: &Self::Model) -> Option<Self::Model> {
        Some(refine_rotation(self.0, model, truncated(self.0), Effort::LOCAL))
    }
}
