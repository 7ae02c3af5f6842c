//! Lens distortion of normalized coordinates.

use nalgebra::{Matrix2, Vector2};

use crate::camera_model::CameraModel;

/// Distorted normalized coordinates with derivatives.
pub(crate) struct Distorted {
    pub(crate) uv: Vector2<f64>,
    /// d uv / d xy.
    pub(crate) d_xy: Matrix2<f64>,
    /// d uv / d kᵢ; zero past the model's parameters, for pinholes all.
    pub(crate) d_k: [Vector2<f64>; 8],
}

/// Distorted `xy = (x/z, y/z)` with derivatives. `k` holds the distortion parameters of `model` in
/// COLMAP's order, at least as many as it has.
///
/// Source: the OpenCV manual, "Camera Calibration and 3D Reconstruction", whose models these are.
pub(crate) fn distort(model: CameraModel, k: &[f64], xy: &Vector2<f64>) -> Distorted {
    let (x, y) = (xy.x, xy.y);
    let r2 = x * x + y * y;
    let mut d_k = [Vector2::zeros(); 8];
    match model {
        CameraModel::SimplePinhole | CameraModel::Pinhole => {
            Distorted { uv: *xy, d_xy: Matrix2::identity(), d_k }
        }
        CameraModel::SimpleRadial | CameraModel::Radial => {
            let k2 = if model == CameraModel::Radial { k[1] } else { 0.0 };
            let radial = 1.0 + r2 * (k[0] + r2 * k2);
            let d_radial_d_r2 = k[0] + 2.0 * k2 * r2;
            d_k[0] = xy * r2;
            d_k[1] = xy * (r2 * r2);
            Distorted { uv: xy * radial, d_xy: radial_jacobian(xy, radial, d_radial_d_r2), d_k }
        }
        CameraModel::OpenCv => {
            let (k1, k2, p1, p2) = (k[0], k[1], k[2], k[3]);
            let radial = 1.0 + r2 * (k1 + r2 * k2);
            d_k[0] = xy * r2;
            d_k[1] = xy * (r2 * r2);
            let (tangential, d_tangential, d_p) = tangential(xy, p1, p2);
            [d_k[2], d_k[3]] = d_p;
            Distorted {
                uv: xy * radial + tangential,
                d_xy: radial_jacobian(xy, radial, k1 + 2.0 * k2 * r2) + d_tangential,
                d_k,
            }
        }
        CameraModel::FullOpenCv => {
            let (k1, k2, p1, p2, k3) = (k[0], k[1], k[2], k[3], k[4]);
            let (k4, k5, k6) = (k[5], k[6], k[7]);
            let numerator = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
            let denominator = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6));
            let radial = numerator / denominator;
            let d_numerator = k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3);
            let d_denominator = k4 + r2 * (2.0 * k5 + 3.0 * r2 * k6);
            let d_radial_d_r2 = (d_numerator - radial * d_denominator) / denominator;
            let powers = [r2, r2 * r2, r2 * r2 * r2];
            let (tangential, d_tangential, d_p) = tangential(xy, p1, p2);
            d_k[0] = xy * (powers[0] / denominator);
            d_k[1] = xy * (powers[1] / denominator);
            [d_k[2], d_k[3]] = d_p;
            d_k[4] = xy * (powers[2] / denominator);
            for (index, power) in powers.iter().enumerate() {
                d_k[5 + index] = xy * (-radial * power / denominator);
            }
            Distorted {
                uv: xy * radial + tangential,
                d_xy: radial_jacobian(xy, radial, d_radial_d_r2) + d_tangential,
                d_k,
            }
        }
        CameraModel::OpenCvFisheye => {
            // θ_d = θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸), uv = xy θ_d / r.
            let r = r2.sqrt();
            let theta = r.atan();
            let theta2 = theta * theta;
            let polynomial =
                1.0 + theta2 * (k[0] + theta2 * (k[1] + theta2 * (k[2] + theta2 * k[3])));
            let (ratio, d_ratio_d_r2, theta_over_r) = if r < 1e-6 {
                // Series of atan(r)/r; the quotient below loses its digits at the center.
                (1.0 + (k[0] - 1.0 / 3.0) * r2, k[0] - 1.0 / 3.0, 1.0)
            } else {
                let theta_d = theta * polynomial;
                let d_theta_d = 1.0
                    + theta2
                        * (3.0 * k[0]
                            + theta2 * (5.0 * k[1] + theta2 * (7.0 * k[2] + theta2 * 9.0 * k[3])));
                let d_theta_d_r = d_theta_d / (1.0 + r2);
                (theta_d / r, (d_theta_d_r - theta_d / r) / (2.0 * r2), theta / r)
            };
            let mut power = theta_over_r;
            for d in d_k.iter_mut().take(4) {
                power *= theta2;
                *d = xy * power;
            }
            Distorted { uv: xy * ratio, d_xy: radial_jacobian(xy, ratio, d_ratio_d_r2), d_k }
        }
    }
}

/// d (xy · radial(r²)) / d xy.
fn radial_jacobian(xy: &Vector2<f64>, radial: f64, d_radial_d_r2: f64) -> Matrix2<f64> {
    Matrix2::identity() * radial + (xy * xy.transpose()) * (2.0 * d_radial_d_r2)
}

/// Brown's tangential distortion, its Jacobian, and its derivatives by `p1`, `p2`.
fn tangential(
    xy: &Vector2<f64>,
    p1: f64,
    p2: f64,
) -> (Vector2<f64>, Matrix2<f64>, [Vector2<f64>; 2]) {
    let (x, y) = (xy.x, xy.y);
    let r2 = x * x + y * y;
    let d_p1 = Vector2::new(2.0 * x * y, r2 + 2.0 * y * y);
    let d_p2 = Vector2::new(r2 + 2.0 * x * x, 2.0 * x * y);
    let jacobian = Matrix2::new(
        2.0 * p1 * y + 6.0 * p2 * x,
        2.0 * p1 * x + 2.0 * p2 * y,
        2.0 * p1 * x + 2.0 * p2 * y,
        6.0 * p1 * y + 2.0 * p2 * x,
    );
    (d_p1 * p1 + d_p2 * p2, jacobian, [d_p1, d_p2])
}
