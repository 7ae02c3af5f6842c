//! Undistorted correspondences and their scoring, shared by all models.
//!
//! Coordinates are scaled normalized ones, `x = f · (X/Z, Y/Z)` with each camera's mean focal
//! length, so that residuals are pixels and principal points are zero.

use nalgebra::{Matrix3, Point2, Vector2, Vector3};
use volery_geometry::Camera;

use crate::ransac::Score;

const LANES: usize = 16;

/// A pair of points with their rays.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pair {
    pub(super) x1: Vector3<f64>,
    pub(super) x2: Vector3<f64>,
    pub(super) bearing1: Vector3<f64>,
    pub(super) bearing2: Vector3<f64>,
}

/// Correspondences with the two focal lengths that scaled them.
pub(super) struct Correspondences {
    pub(super) pairs: Vec<Pair>,
    pub(super) focal1: f64,
    pub(super) focal2: f64,
    pub(super) squared_threshold: f64,
    /// x₁, y₁, x₂, y₂ in columns, padded by data that never fit.
    columns: [Vec<f32>; 4],
}

impl Correspondences {
    /// Of undistorted normalized coordinates.
    pub(super) fn new(
        normalized: impl Iterator<Item = (Vector2<f64>, Vector2<f64>)>,
        focal1: f64,
        focal2: f64,
        max_error_px: f64,
    ) -> Self {
        let pairs = normalized
            .map(|(n1, n2)| Pair {
                x1: Vector3::new(focal1 * n1.x, focal1 * n1.y, 1.0),
                x2: Vector3::new(focal2 * n2.x, focal2 * n2.y, 1.0),
                bearing1: Vector3::new(n1.x, n1.y, 1.0).normalize(),
                bearing2: Vector3::new(n2.x, n2.y, 1.0).normalize(),
            })
            .collect();
        Self::from_pairs(pairs, focal1, focal2, max_error_px * max_error_px)
    }

    fn from_pairs(pairs: Vec<Pair>, focal1: f64, focal2: f64, squared_threshold: f64) -> Self {
        let padded = pairs.len().next_multiple_of(LANES);
        let column = |value: &dyn Fn(&Pair) -> f64| {
            let mut column: Vec<f32> = pairs.iter().map(|p| value(p) as f32).collect();
            column.resize(padded, f32::NAN);
            column
        };
        let columns =
            [column(&|p| p.x1.x), column(&|p| p.x1.y), column(&|p| p.x2.x), column(&|p| p.x2.y)];
        Self { pairs, focal1, focal2, squared_threshold, columns }
    }

    /// Those of some indices.
    pub(super) fn subset(&self, indices: impl Iterator<Item = usize>) -> Self {
        let pairs = indices.map(|i| self.pairs[i]).collect();
        Self::from_pairs(pairs, self.focal1, self.focal2, self.squared_threshold)
    }

    /// The same under another threshold.
    pub(super) fn with_squared_threshold(&self, squared_threshold: f64) -> Self {
        Self::from_pairs(self.pairs.clone(), self.focal1, self.focal2, squared_threshold)
    }

    pub(super) fn len(&self) -> usize {
        self.pairs.len()
    }

    /// `diag(f₂, f₂, 1)⁻¹ E diag(f₁, f₁, 1)⁻¹`: E over normalized as F over scaled coordinates.
    pub(super) fn scaled_epipolar(&self, e: &Matrix3<f64>) -> Matrix3<f64> {
        scale(e, 1.0 / self.focal2, 1.0 / self.focal1)
    }

    /// `diag(f₂, f₂, 1) H diag(f₁, f₁, 1)⁻¹`.
    pub(super) fn scaled_homography(&self, h: &Matrix3<f64>) -> Matrix3<f64> {
        scale(h, self.focal2, 1.0 / self.focal1)
    }

    /// The inverse of [`Self::scaled_homography`].
    pub(super) fn normalized_homography(&self, h: &Matrix3<f64>) -> Matrix3<f64> {
        scale(h, 1.0 / self.focal2, self.focal1)
    }

    /// MSAC cost of the Sampson errors of `f`.
    pub(super) fn score_epipolar(&self, f: &Matrix3<f64>, bound: f64) -> Score {
        let f: Matrix3<f32> = (f / f.amax()).cast();
        self.score(bound, |x1, y1, x2, y2| {
            let a0 = f[(0, 0)] * x1 + f[(0, 1)] * y1 + f[(0, 2)];
            let a1 = f[(1, 0)] * x1 + f[(1, 1)] * y1 + f[(1, 2)];
            let a2 = f[(2, 0)] * x1 + f[(2, 1)] * y1 + f[(2, 2)];
            let b0 = f[(0, 0)] * x2 + f[(1, 0)] * y2 + f[(2, 0)];
            let b1 = f[(0, 1)] * x2 + f[(1, 1)] * y2 + f[(2, 1)];
            let c = x2 * a0 + y2 * a1 + a2;
            c * c / (a0 * a0 + a1 * a1 + b0 * b0 + b1 * b1)
        })
    }

    /// MSAC cost of the transfer errors of `h`.
    pub(super) fn score_homography(&self, h: &Matrix3<f64>, bound: f64) -> Score {
        let h: Matrix3<f32> = (h / h.amax()).cast();
        self.score(bound, |x1, y1, x2, y2| {
            let w_inv = 1.0 / (h[(2, 0)] * x1 + h[(2, 1)] * y1 + h[(2, 2)]);
            let u = (h[(0, 0)] * x1 + h[(0, 1)] * y1 + h[(0, 2)]) * w_inv;
            let v = (h[(1, 0)] * x1 + h[(1, 1)] * y1 + h[(1, 2)]) * w_inv;
            let (j00, j01) = (h[(0, 0)] - u * h[(2, 0)], h[(0, 1)] - u * h[(2, 1)]);
            let (j10, j11) = (h[(1, 0)] - v * h[(2, 0)], h[(1, 1)] - v * h[(2, 1)]);
            let gain = 0.5 * (j00 * j00 + j01 * j01 + j10 * j10 + j11 * j11) * w_inv * w_inv;
            ((u - x2) * (u - x2) + (v - y2) * (v - y2)) / (1.0 + gain)
        })
    }

    #[inline(always)]
    fn score(&self, bound: f64, squared_error: impl Fn(f32, f32, f32, f32) -> f32) -> Score {
        let squared_threshold = self.squared_threshold as f32;
        let [(x1s, _), (y1s, _), (x2s, _), (y2s, _)] =
            self.columns.each_ref().map(|c| c.as_chunks::<LANES>());
        let (mut cost, mut num_inliers) = (0.0, 0);
        for ((x1, y1), (x2, y2)) in x1s.iter().zip(y1s).zip(x2s.iter().zip(y2s)) {
            let mut squared = [0.0f32; LANES];
            let mut inlier = [0u32; LANES];
            for i in 0..LANES {
                let e = squared_error(x1[i], y1[i], x2[i], y2[i]);
                // Not-a-number (padding) compares false.
                let good = e < squared_threshold;
                squared[i] = if good { e } else { squared_threshold };
                inlier[i] = u32::from(good);
            }
            cost += f64::from(squared.iter().sum::<f32>());
            num_inliers += inlier.iter().sum::<u32>() as usize;
            if cost > bound {
                break;
            }
        }
        Score { cost, num_inliers }
    }
}

/// Squared Sampson error of a pair, pixels².
pub(super) fn epipolar_error(f: &Matrix3<f64>, pair: &Pair) -> f64 {
    volery_geometry::epipolar::squared_sampson_error(f, &pair.x1.xy().into(), &pair.x2.xy().into())
}

/// Squared transfer error of a pair, pixels², spread over both images: divided by the variance
/// that unit noise in both leaves in image 2, so that it compares with Sampson errors.
pub(super) fn homography_error(h: &Matrix3<f64>, pair: &Pair) -> f64 {
    let p = h * pair.x1;
    let w_inv = 1.0 / p.z;
    let x = p.xy() * w_inv;
    let mut gain = 0.0;
    for column in 0..2 {
        for row in 0..2 {
            gain += ((h[(row, column)] - x[row] * h[(2, column)]) * w_inv).powi(2);
        }
    }
    let squared = (x - pair.x2.xy()).norm_squared() / (1.0 + 0.5 * gain);
    if squared.is_finite() { squared } else { f64::INFINITY }
}

/// `diag(left, left, 1) m diag(right, right, 1)`.
fn scale(m: &Matrix3<f64>, left: f64, right: f64) -> Matrix3<f64> {
    Matrix3::from_diagonal(&Vector3::new(left, left, 1.0))
        * m
        * Matrix3::from_diagonal(&Vector3::new(right, right, 1.0))
}

/// `K diag(f, f, 1)⁻¹`: pixels from scaled normalized coordinates.
pub(super) fn pixel_from_scaled(camera: &Camera) -> Matrix3<f64> {
    let f = 1.0 / camera.mean_focal();
    camera.calibration_matrix() * Matrix3::from_diagonal(&Vector3::new(f, f, 1.0))
}

/// Undistorted coordinates of the matched keypoints; `None` for a match that points past the
/// keypoints, is not finite, or lies where the lens model cannot be inverted.
pub(super) fn undistort(
    camera: &Camera,
    pixels: &[Point2<f64>],
    index: u32,
) -> Option<Vector2<f64>> {
    let pixel = pixels.get(index as usize)?;
    if !pixel.coords.iter().all(|v| v.is_finite()) {
        return None;
    }
    camera.unproject(pixel).filter(|xy| xy.iter().all(|v| v.is_finite()))
}

/// Positions of the errors below a limit.
pub(super) fn indices_below(errors: &[f64], limit: f64) -> impl Iterator<Item = usize> {
    errors.iter().enumerate().filter(move |(_, e)| **e < limit).map(|(i, _)| i)
}
