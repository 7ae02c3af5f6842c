//! Nonlinear refinement of E, F, H and R over their inliers.

use nalgebra::{Isometry3, Matrix3, Rotation3, SMatrix, SVector, Unit, UnitQuaternion, Vector3};
use volery_geometry::epipolar::essential_from_pose;

use super::correspondences::{Correspondences, Pair};
use crate::ransac::least_squares::{Loss, Normal, levenberg_marquardt};

/// How long to refine.
#[derive(Debug, Clone, Copy)]
pub(super) struct Effort {
    pub(super) max_iterations: usize,
    pub(super) tolerance: f64,
}

impl Effort {
    /// Within RANSAC.
    pub(super) const LOCAL: Self = Self { max_iterations: 4, tolerance: 1e-2 };
    /// For the answer.
    pub(super) const FINAL: Self = Self { max_iterations: 30, tolerance: 1e-8 };
}

/// Pose of unit translation that minimizes the Sampson errors.
pub(super) fn refine_pose(
    data: &Correspondences,
    pose: &Isometry3<f64>,
    loss: Loss,
    effort: Effort,
) -> Isometry3<f64> {
    let linearize = |pose: &Isometry3<f64>| {
        let r = pose.rotation.to_rotation_matrix().into_inner();
        let t = pose.translation.vector;
        let t_cross = t.cross_matrix();
        let tangents = tangent_basis(&t);
        let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
        let derivatives: [Matrix3<f64>; 5] = std::array::from_fn(|k| {
            let d_e = if k < 3 {
                t_cross * axes[k].cross_matrix() * r
            } else {
                tangents[k - 3].cross_matrix() * r
            };
            data.scaled_epipolar(&d_e)
        });
        accumulate_sampson(data, &data.scaled_epipolar(&(t_cross * r)), &derivatives, loss)
    };
    let apply = |pose: &Isometry3<f64>, step: &SVector<f64, 5>| {
        let omega = UnitQuaternion::from_scaled_axis(step.fixed_rows::<3>(0).into_owned());
        let t = pose.translation.vector;
        let [a, b] = tangent_basis(&t);
        let moved = (t + a * step[3] + b * step[4]).normalize();
        Isometry3::from_parts(moved.into(), omega * pose.rotation)
    };
    levenberg_marquardt(*pose, effort.max_iterations, effort.tolerance, linearize, apply)
}

/// Fundamental matrix over scaled coordinates that minimizes the Sampson errors.
///
/// Parameters: `F = U diag(1, s, 0) Vᵀ` with U and V turned on the right, seven in all (Bartoli &
/// Sturm, "Nonlinear Estimation of the Fundamental Matrix with Minimal Parameters", PAMI 2004).
pub(super) fn refine_fundamental(
    data: &Correspondences,
    f: &Matrix3<f64>,
    loss: Loss,
    effort: Effort,
) -> Option<Matrix3<f64>> {
    type Parts = (Matrix3<f64>, f64, Matrix3<f64>);
    let svd = f.try_svd(true, true, f64::EPSILON, 100)?;
    let (u, v_t, s) = (svd.u?, svd.v_t?, svd.singular_values);
    let start: Parts = (u, s[1] / s[0], v_t.transpose());
    let compose =
        |(u, s, v): &Parts| u * Matrix3::from_diagonal(&Vector3::new(1.0, *s, 0.0)) * v.transpose();
    let linearize = |parts: &Parts| {
        let (u, s, v) = parts;
        let middle = Matrix3::from_diagonal(&Vector3::new(1.0, *s, 0.0));
        let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
        let derivatives: [Matrix3<f64>; 7] = std::array::from_fn(|k| match k {
            0..3 => u * axes[k].cross_matrix() * middle * v.transpose(),
            3..6 => u * middle * axes[k - 3].cross_matrix().transpose() * v.transpose(),
            _ => u.column(1) * v.column(1).transpose(),
        });
        accumulate_sampson(data, &compose(parts), &derivatives, loss)
    };
    let apply = |(u, s, v): &Parts, step: &SVector<f64, 7>| {
        let turn = |i| Rotation3::new(step.fixed_rows::<3>(i).into_owned()).into_inner();
        (u * turn(0), s + step[6], v * turn(3))
    };
    let parts =
        levenberg_marquardt(start, effort.max_iterations, effort.tolerance, linearize, apply);
    let f = compose(&parts);
    f.iter().all(|v| v.is_finite()).then_some(f)
}

/// Normal equations of Sampson errors `c / √D`, given F and its derivatives.
fn accumulate_sampson<const N: usize>(
    data: &Correspondences,
    f: &Matrix3<f64>,
    derivatives: &[Matrix3<f64>; N],
    loss: Loss,
) -> Normal<N> {
    let mut normal = Normal::zero();
    for Pair { x1, x2, .. } in &data.pairs {
        let (a, b) = (f * x1, f.tr_mul(x2));
        let c = x2.dot(&a);
        let denominator = a.x * a.x + a.y * a.y + b.x * b.x + b.y * b.y;
        let squared = c * c / denominator;
        let (rho, weight) = loss.evaluate(if squared.is_nan() { f64::INFINITY } else { squared });
        normal.cost += 0.5 * rho;
        if weight == 0.0 {
            continue;
        }
        let root_inv = 1.0 / denominator.sqrt();
        let residual = c * root_inv;
        let pull = residual / denominator;
        let jacobian = std::array::from_fn(|k| {
            let d = &derivatives[k];
            let d_a = d * x1;
            let d_b = d.tr_mul(x2);
            let d_c = x2.dot(&d_a);
            let d_half = a.x * d_a.x + a.y * d_a.y + b.x * d_b.x + b.y * d_b.y;
            d_c * root_inv - pull * d_half
        });
        normal.add(residual, &jacobian, weight);
    }
    normal.finish()
}

/// Homography over scaled coordinates that minimizes the transfer errors.
pub(super) fn refine_homography(
    data: &Correspondences,
    h: &Matrix3<f64>,
    loss: Loss,
    effort: Effort,
) -> Matrix3<f64> {
    // Unit columns in coordinates of order one keep the nine parameters alike; the free scale is
    // held by the damping.
    let unit = |h: &Matrix3<f64>| h / h[(2, 2)].abs().max(1e-9);
    let linearize = |h: &Matrix3<f64>| {
        accumulate_transfer::<8>(data, h, loss, |x1, w_inv, x| {
            let s = 1.0 / data.focal1;
            let (p, q) = (x1.x * s * w_inv, x1.y * s * w_inv);
            let f = data.focal2;
            [
                [f * p, f * q, f * w_inv, 0.0, 0.0, 0.0, -x.x * p, -x.x * q],
                [0.0, 0.0, 0.0, f * p, f * q, f * w_inv, -x.y * p, -x.y * q],
            ]
        })
    };
    let apply = |h: &Matrix3<f64>, step: &SVector<f64, 8>| {
        let mut n = data.normalized_homography(h);
        for k in 0..8 {
            n[(k / 3, k % 3)] += step[k];
        }
        data.scaled_homography(&n)
    };
    levenberg_marquardt(unit(h), effort.max_iterations, effort.tolerance, linearize, apply)
}

/// Rotation that minimizes the transfer errors.
pub(super) fn refine_rotation(
    data: &Correspondences,
    rotation: &UnitQuaternion<f64>,
    loss: Loss,
    effort: Effort,
) -> UnitQuaternion<f64> {
    let linearize = |q: &UnitQuaternion<f64>| {
        let r = q.to_rotation_matrix().into_inner();
        let h = data.scaled_homography(&r);
        let focal1_inv = 1.0 / data.focal1;
        accumulate_transfer::<3>(data, &h, loss, |x1, w_inv, x| {
            let p = r * Vector3::new(x1.x * focal1_inv, x1.y * focal1_inv, 1.0);
            // d(f X/Z) = (f, 0, −x)/Z; dp = ω × p
            let f = data.focal2;
            [Vector3::new(f, 0.0, -x.x), Vector3::new(0.0, f, -x.y)]
                .map(|d| (p.cross(&(d * w_inv))).into())
        })
    };
    let apply = |q: &UnitQuaternion<f64>, step: &SVector<f64, 3>| {
        UnitQuaternion::from_scaled_axis(*step) * q
    };
    levenberg_marquardt(*rotation, effort.max_iterations, effort.tolerance, linearize, apply)
}

/// Normal equations of transfer errors; `rows(x1, 1/w, x)` derives the transferred point x.
fn accumulate_transfer<const N: usize>(
    data: &Correspondences,
    h: &Matrix3<f64>,
    loss: Loss,
    rows: impl Fn(&Vector3<f64>, f64, &nalgebra::Vector2<f64>) -> [[f64; N]; 2],
) -> Normal<N> {
    let mut normal = Normal::zero();
    for pair in &data.pairs {
        let p = h * pair.x1;
        let w_inv = 1.0 / p.z;
        let x = p.xy() * w_inv;
        let linear: SMatrix<f64, 2, 2> =
            (h.fixed_view::<2, 2>(0, 0) - x * h.fixed_view::<1, 2>(2, 0)) * w_inv;
        // The same spread over both images as the score's.
        let spread = 1.0 / (1.0 + 0.5 * linear.norm_squared());
        let residual = x - pair.x2.xy();
        let squared = residual.norm_squared() * spread;
        let (rho, weight) = loss.evaluate(if squared.is_nan() { f64::INFINITY } else { squared });
        normal.cost += 0.5 * rho;
        if weight == 0.0 {
            continue;
        }
        let [u, v] = rows(&pair.x1, w_inv, &x);
        normal.add(residual.x, &u, weight * spread);
        normal.add(residual.y, &v, weight * spread);
    }
    normal.finish()
}

/// Two unit vectors that complete t to an orthogonal frame.
fn tangent_basis(t: &Vector3<f64>) -> [Vector3<f64>; 2] {
    let axis = match t.iamin() {
        0 => Vector3::x(),
        1 => Vector3::y(),
        _ => Vector3::z(),
    };
    let a = Unit::new_normalize(t.cross(&axis)).into_inner();
    [a, t.cross(&a)]
}

/// E of a pose over scaled coordinates.
pub(super) fn scaled_essential(data: &Correspondences, pose: &Isometry3<f64>) -> Matrix3<f64> {
    data.scaled_epipolar(&essential_from_pose(pose))
}
