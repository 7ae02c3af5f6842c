//! P3P hypotheses, scored on normalized coordinates scaled to pixels.

use nalgebra::{
    Isometry3, Matrix3, Point2, Point3, SVector, Translation3, UnitQuaternion, Vector2, Vector3,
};
use volery_geometry::Camera;

use crate::ransac::least_squares::{Loss, Normal, levenberg_marquardt};
use crate::ransac::{Estimator, Hypotheses, Score};
use crate::solvers::p3p;

const LANES: usize = 16;
const LO_ITERATIONS: usize = 5;
const LO_TOLERANCE: f64 = 1e-3;

struct Correspondence {
    xy: Vector2<f64>,
    bearing: Vector3<f64>,
    /// Relative to the center of the points.
    point: Point3<f64>,
    /// Pixels per unit of xy at this place of the image.
    scale: f64,
}

/// The same in columns of f32, padded by data that never fit.
#[derive(Default)]
struct Columns {
    x: Vec<f32>,
    y: Vec<f32>,
    scale: Vec<f32>,
    point: [Vec<f32>; 3],
}

pub(super) struct PoseEstimator {
    data: Vec<Correspondence>,
    columns: Columns,
    center: Vector3<f64>,
    squared_threshold: f64,
}

impl PoseEstimator {
    /// Pixels the lens model cannot invert are left out.
    pub(super) fn new(
        pixels: &[Point2<f64>],
        points: &[Point3<f64>],
        camera: &Camera,
        max_error_px: f64,
    ) -> Self {
        let n_inv = 1.0 / points.len() as f64;
        let center = points.iter().map(|p| p.coords * n_inv).sum::<Vector3<f64>>();
        let data: Vec<_> = pixels
            .iter()
            .zip(points)
            .filter_map(|(pixel, point)| {
                let xy = camera.unproject(pixel)?;
                let ray = Vector3::new(xy.x, xy.y, 1.0);
                let d_xy = camera.project_with_jacobians(&Point3::from(ray))?.d_point;
                let scale = (d_xy[(0, 0)] * d_xy[(1, 1)] - d_xy[(0, 1)] * d_xy[(1, 0)]).sqrt();
                scale.is_finite().then(|| Correspondence {
                    xy,
                    bearing: ray.normalize(),
                    point: point - center,
                    scale,
                })
            })
            .collect();
        let mut columns = Columns::default();
        let padded = data.len().next_multiple_of(LANES);
        let column = |value: &dyn Fn(&Correspondence) -> f64| {
            let mut column: Vec<f32> = data.iter().map(|c| value(c) as f32).collect();
            column.resize(padded, f32::NAN);
            column
        };
        columns.x = column(&|c| c.xy.x);
        columns.y = column(&|c| c.xy.y);
        columns.scale = column(&|c| c.scale);
        columns.point = std::array::from_fn(|i| column(&|c| c.point[i]));
        Self { data, columns, center, squared_threshold: max_error_px * max_error_px }
    }

    /// The pose over world points from the pose over centered points.
    pub(super) fn to_world(&self, pose: &Isometry3<f64>) -> Isometry3<f64> {
        pose * Translation3::from(-self.center)
    }
}

impl Estimator for PoseEstimator {
    type Model = Isometry3<f64>;
    const SAMPLE_SIZE: usize = 3;

    fn num_data(&self) -> usize {
        self.data.len()
    }

    fn solve(&self, sample: &[usize], hypotheses: &mut Hypotheses<Self::Model>) {
        let d: [&Correspondence; 3] = std::array::from_fn(|i| &self.data[sample[i]]);
        hypotheses.extend(p3p(&d.map(|c| c.bearing), &d.map(|c| c.point)));
    }

    fn score(&self, model: &Self::Model, bound: f64) -> Score {
        let r: Matrix3<f32> = model.rotation.to_rotation_matrix().into_inner().cast();
        let t: Vector3<f32> = model.translation.vector.cast();
        let squared_threshold = self.squared_threshold as f32;
        let c = &self.columns;
        let (xs, _) = c.x.as_chunks::<LANES>();
        let (ys, _) = c.y.as_chunks::<LANES>();
        let (scales, _) = c.scale.as_chunks::<LANES>();
        let [(pxs, _), (pys, _), (pzs, _)] =
            std::array::from_fn(|i| c.point[i].as_chunks::<LANES>());
        let (mut cost, mut num_inliers) = (0.0, 0);
        for (((x, y), scale), ((px, py), pz)) in
            xs.iter().zip(ys).zip(scales).zip(pxs.iter().zip(pys).zip(pzs))
        {
            let mut squared = [0.0f32; LANES];
            let mut inlier = [0u32; LANES];
            for i in 0..LANES {
                let z = r[(2, 0)] * px[i] + r[(2, 1)] * py[i] + r[(2, 2)] * pz[i] + t.z;
                let z_inv = 1.0 / z;
                let u = (r[(0, 0)] * px[i] + r[(0, 1)] * py[i] + r[(0, 2)] * pz[i] + t.x) * z_inv;
                let v = (r[(1, 0)] * px[i] + r[(1, 1)] * py[i] + r[(1, 2)] * pz[i] + t.y) * z_inv;
                let (du, dv) = ((u - x[i]) * scale[i], (v - y[i]) * scale[i]);
                let e = du * du + dv * dv;
                // Not-a-number (padding) and points behind compare false.
                let good = (e < squared_threshold) & (z > 0.0);
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

    fn refine(&self, model: &Self::Model) -> Option<Self::Model> {
        let loss = Loss::Truncated { squared_threshold: self.squared_threshold };
        let linearize = |pose: &Isometry3<f64>| {
            let r = pose.rotation.to_rotation_matrix();
            let mut normal = Normal::<6>::zero();
            for c in &self.data {
                let turned = r * c.point.coords;
                let p = turned + pose.translation.vector;
                if p.z <= 0.0 {
                    normal.cost += 0.5 * self.squared_threshold;
                    continue;
                }
                let z_inv = 1.0 / p.z;
                let (u, v) = (p.x * z_inv, p.y * z_inv);
                let s = c.scale;
                let (ru, rv) = ((u - c.xy.x) * s, (v - c.xy.y) * s);
                let (rho, weight) = loss.evaluate(ru * ru + rv * rv);
                normal.cost += 0.5 * rho;
                if weight == 0.0 {
                    continue;
                }
                // d(u)/dp = (1, 0, −u)/z; dp = ω × turned + τ.
                let du = Vector3::new(s * z_inv, 0.0, -u * s * z_inv);
                let dv = Vector3::new(0.0, s * z_inv, -v * s * z_inv);
                let (wu, wv) = (turned.cross(&du), turned.cross(&dv));
                normal.add(ru, &[wu.x, wu.y, wu.z, du.x, du.y, du.z], weight);
                normal.add(rv, &[wv.x, wv.y, wv.z, dv.x, dv.y, dv.z], weight);
            }
            normal.finish()
        };
        Some(levenberg_marquardt(*model, LO_ITERATIONS, LO_TOLERANCE, linearize, perturb))
    }
}

/// Rotation turned by ω on the left, translation moved by τ.
fn perturb(pose: &Isometry3<f64>, step: &SVector<f64, 6>) -> Isometry3<f64> {
    let omega = Vector3::new(step[0], step[1], step[2]);
    let tau = Vector3::new(step[3], step[4], step[5]);
    let rotation = UnitQuaternion::from_scaled_axis(omega) * pose.rotation;
    Isometry3::from_parts((pose.translation.vector + tau).into(), rotation)
}
