//! Alignment of a whole view with the photo: every point's gray level is a measurement.

use nalgebra::{Isometry3, Matrix3, SMatrix, SVector, Vector3, Vector6};
use volery_geometry::perturbed;

use super::key_view::{KeyView, ViewPoint};
use super::planes::{MEAN, sample};
use super::working::Level;

/// Points that take part at most: the sum is dense enough.
const MAX_POINTS: usize = 4000;
/// Least contrast of a point that takes part, levels of the normalized image.
const MIN_SLOPE: f32 = 6.0;
/// Residuals from which the loss grows linearly, levels (Huber).
const HUBER: f32 = 25.0;
const DAMPING: f64 = 1e-3;
/// Steps smaller than this, in radians and parts of the depth, end the iteration.
const SMALL_STEP: f64 = 2e-4;
/// Fewest points of an alignment.
const MIN_POINTS: usize = 100;

/// A pose with how well the points fit there.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Aligned {
    pub(crate) cam_from_world: Isometry3<f64>,
    /// Correlation of the points with the photo, −1 to 1.
    pub(crate) correlation: f64,
}

/// Points that say something, some thousand of them, evenly spread.
pub(crate) fn telling_points(key: &KeyView) -> Vec<ViewPoint> {
    let telling = || key.points.iter().filter(|point| point.slope >= MIN_SLOPE);
    let step = telling().count().div_ceil(MAX_POINTS).max(1);
    telling().step_by(step).copied().collect()
}

/// Gauss–Newton over pose, gain and offset: minimizes the loss of `g vᵢ + o − I(π(T xᵢ))`.
pub(crate) fn align(
    key: &KeyView,
    points: &[ViewPoint],
    level: &Level,
    initial: &Isometry3<f64>,
    max_iterations: usize,
) -> Option<Aligned> {
    let key_from_world = key.cam_from_world;
    let mut pose = initial * key_from_world.inverse();
    // Lengths in parts of the depth keep the equations balanced.
    let unit = key.median_depth.max(1e-3);
    let (mut gain, mut offset) = (1.0_f32, 0.0_f32);
    for _ in 0..max_iterations {
        let (normal, right, num) = equations(points, level, &pose, unit, gain, offset);
        if num < MIN_POINTS {
            return None;
        }
        let mut damped = normal;
        for k in 0..8 {
            damped[(k, k)] += DAMPING * normal[(k, k)] + 1e-9;
        }
        let step = damped.cholesky()?.solve(&right);
        let mut xi: Vector6<f64> = step.fixed_rows::<6>(0).into_owned();
        let size = xi.amax();
        xi.fixed_rows_mut::<3>(3).scale_mut(unit);
        // Far steps leave the part of the image in which the slopes hold.
        let limit = (0.1 / size.max(1e-12)).min(1.0);
        pose = perturbed(&pose, &(xi * limit));
        gain += (step[6] * limit) as f32;
        offset += (step[7] * limit) as f32;
        if size < SMALL_STEP {
            break;
        }
    }
    let correlation = correlation(points, level, &pose)?;
    Some(Aligned { cam_from_world: pose * key_from_world, correlation })
}

type Equations = (SMatrix<f64, 8, 8>, SVector<f64, 8>, usize);

fn equations(
    points: &[ViewPoint],
    level: &Level,
    cam_from_key: &Isometry3<f64>,
    unit: f64,
    gain: f32,
    offset: f32,
) -> Equations {
    let projector = Projector::new(level, cam_from_key);
    let unit = unit as f32;
    let mut sums = [[0.0_f32; 8]; 8];
    let mut right = [0.0_f32; 8];
    let mut num = 0;
    for point in points {
        let Some((p, w, [value, dx, dy])) = projector.look(point) else { continue };
        num += 1;
        let centered = point.value - f32::from(MEAN);
        let residual = value - f32::from(MEAN) - gain * centered - offset;
        let weight = if residual.abs() <= HUBER { 1.0 } else { HUBER / residual.abs() };
        // d I / d p, then by the rotation (p × d) and the translation.
        let (gx, gy) = (dx * projector.focal[0] * w, dy * projector.focal[1] * w);
        let d = Vector3::new(gx, gy, -(gx * p.x + gy * p.y) * w);
        let turn = p.cross(&d);
        let row = [turn.x, turn.y, turn.z, d.x * unit, d.y * unit, d.z * unit, -centered, -1.0];
        for i in 0..8 {
            let weighted = weight * row[i];
            right[i] -= weighted * residual;
            for j in 0..8 {
                sums[i][j] += weighted * row[j];
            }
        }
    }
    let normal = SMatrix::<f64, 8, 8>::from_fn(|i, j| f64::from(sums[i][j]));
    (normal, SVector::<f64, 8>::from_fn(|i, _| f64::from(right[i])), num)
}

/// Correlation of the points' values with what the photo shows at them.
fn correlation(points: &[ViewPoint], level: &Level, cam_from_key: &Isometry3<f64>) -> Option<f64> {
    let projector = Projector::new(level, cam_from_key);
    let (mut n, mut s) = (0.0, [0.0_f64; 5]);
    for point in points {
        let Some((_, _, [value, ..])) = projector.look(point) else { continue };
        let (a, b) = (f64::from(point.value), f64::from(value));
        n += 1.0;
        [a, b, a * a, b * b, a * b].iter().zip(&mut s).for_each(|(v, sum)| *sum += v);
    }
    if (n as usize) < MIN_POINTS {
        return None;
    }
    let [a, b, aa, bb, ab] = s.map(|v| v / n);
    let scale = (aa - a * a) * (bb - b * b);
    (scale > 0.0).then(|| (ab - a * b) / scale.sqrt())
}

struct Projector<'a> {
    level: &'a Level,
    rotation: Matrix3<f32>,
    translation: Vector3<f32>,
    focal: [f32; 2],
    center: [f32; 2],
}

impl<'a> Projector<'a> {
    fn new(level: &'a Level, cam_from_key: &Isometry3<f64>) -> Self {
        let (focal, center) = (level.camera.focal(), level.camera.principal_point());
        Self {
            level,
            rotation: cam_from_key.rotation.to_rotation_matrix().into_inner().cast(),
            translation: cam_from_key.translation.vector.cast(),
            focal: [focal.x as f32, focal.y as f32],
            center: [center.x as f32, center.y as f32],
        }
    }

    /// Position in the camera frame, inverse depth, and the photo's value and slopes there.
    #[inline]
    fn look(&self, point: &ViewPoint) -> Option<(Vector3<f32>, f32, [f32; 3])> {
        let p = self.rotation * point.position + self.translation;
        if p.z < 0.05 {
            return None;
        }
        let w = 1.0 / p.z;
        let u = self.focal[0] * p.x * w + self.center[0];
        let v = self.focal[1] * p.y * w + self.center[1];
        Some((p, w, sample(&self.level.normalized, u, v)?))
    }
}
