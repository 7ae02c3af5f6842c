//! Camera models under COLMAP's names and parameter order.

use nalgebra::{Matrix2, Matrix2x3, Point2, Point3, SMatrix, Unit, Vector2, Vector3};

pub use crate::camera_model::CameraModel;
use crate::distortion::{Distorted, distort};

/// Most parameters of any model ([`CameraModel::FullOpenCv`]).
pub const MAX_CAMERA_PARAMS: usize = 12;

/// Newton steps of [`Camera::unproject`]; it converges quadratically, so few are ever taken.
const MAX_UNDISTORT_ITERATIONS: usize = 50;

/// Why a camera was refused.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum CameraError {
    /// The parameter list has the wrong length for the model.
    #[error("{model} takes {expected} parameters, got {got}")]
    WrongNumParams {
        /// COLMAP's name.
        model: &'static str,
        /// What it takes.
        expected: usize,
        /// What came.
        got: usize,
    },
    /// A parameter is not finite or a focal length is not positive.
    #[error("camera parameter {index} is {value}: focal lengths must be positive, all finite")]
    BadParam {
        /// Position in the list.
        index: usize,
        /// Its value.
        value: f64,
    },
    /// The image has no pixels.
    #[error("camera image size {width} x {height} is empty")]
    EmptyImage {
        /// Pixels.
        width: u32,
        /// Pixels.
        height: u32,
    },
}

/// Intrinsics of one camera; pixels, first pixel center (0.5, 0.5).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// How directions become pixels.
    pub model: CameraModel,
    /// Image width, pixels.
    pub width: u32,
    /// Image height, pixels.
    pub height: u32,
    /// Parameters in COLMAP's order; those past [`CameraModel::num_params`] are zero.
    params: [f64; MAX_CAMERA_PARAMS],
}

/// A projection with its derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Projection {
    /// Pixels.
    pub pixel: Point2<f64>,
    /// d pixel / d point in the camera frame.
    pub d_point: Matrix2x3<f64>,
    /// d pixel / d parameters; columns past [`CameraModel::num_params`] are zero.
    pub d_params: SMatrix<f64, 2, MAX_CAMERA_PARAMS>,
}

impl Camera {
    /// A checked camera.
    ///
    /// # Errors
    ///
    /// [`CameraError`] for a wrong number of parameters, non-finite values, focal lengths that
    /// are not positive, or an empty image.
    pub fn new(
        model: CameraModel,
        width: u32,
        height: u32,
        params: &[f64],
    ) -> Result<Self, CameraError> {
        if params.len() != model.num_params() {
            return Err(CameraError::WrongNumParams {
                model: model.name(),
                expected: model.num_params(),
                got: params.len(),
            });
        }
        if width == 0 || height == 0 {
            return Err(CameraError::EmptyImage { width, height });
        }
        let mut all = [0.0; MAX_CAMERA_PARAMS];
        for (index, &value) in params.iter().enumerate() {
            if !value.is_finite() || (index < model.num_focals() && value <= 0.0) {
                return Err(CameraError::BadParam { index, value });
            }
            all[index] = value;
        }
        Ok(Self { model, width, height, params: all })
    }

    /// A camera of `model` with focal length `focal_px`, the principal point in the image center
    /// and no distortion (P21).
    ///
    /// # Errors
    ///
    /// As [`Self::new`].
    pub fn from_focal(
        model: CameraModel,
        width: u32,
        height: u32,
        focal_px: f64,
    ) -> Result<Self, CameraError> {
        let mut params = vec![0.0; model.num_params()];
        params[..model.num_focals()].fill(focal_px);
        params[model.num_focals()] = f64::from(width) / 2.0;
        params[model.num_focals() + 1] = f64::from(height) / 2.0;
        Self::new(model, width, height, &params)
    }

    /// Parameters in COLMAP's order.
    pub fn params(&self) -> &[f64] {
        &self.params[..self.model.num_params()]
    }

    /// Parameters in COLMAP's order, for an optimizer.
    pub fn params_mut(&mut self) -> &mut [f64] {
        &mut self.params[..self.model.num_params()]
    }

    /// Focal lengths `(fx, fy)`, pixels.
    pub fn focal(&self) -> Vector2<f64> {
        Vector2::new(self.params[0], self.params[self.model.num_focals() - 1])
    }

    /// Mean of the focal lengths, pixels: turns angles into pixels.
    pub fn mean_focal(&self) -> f64 {
        self.focal().mean()
    }

    /// Principal point, pixels.
    pub fn principal_point(&self) -> Point2<f64> {
        let start = self.model.num_focals();
        Point2::new(self.params[start], self.params[start + 1])
    }

    /// The calibration matrix `K` (without distortion).
    pub fn calibration_matrix(&self) -> nalgebra::Matrix3<f64> {
        let (f, c) = (self.focal(), self.principal_point());
        nalgebra::Matrix3::new(f.x, 0.0, c.x, 0.0, f.y, c.y, 0.0, 0.0, 1.0)
    }

    /// Horizontal field of view without distortion, radians.
    pub fn horizontal_fov(&self) -> f64 {
        2.0 * (f64::from(self.width) / (2.0 * self.focal().x)).atan()
    }

    /// The same lens behind an image scaled by `scale` (pixels of the new image per pixel).
    pub fn scaled(&self, scale: f64, width: u32, height: u32) -> Self {
        let mut camera = Self { width, height, ..*self };
        for value in &mut camera.params[..self.model.distortion_start()] {
            *value *= scale;
        }
        camera
    }

    /// Whether a pixel lies in the image.
    pub fn contains(&self, pixel: &Point2<f64>) -> bool {
        pixel.x >= 0.0
            && pixel.y >= 0.0
            && pixel.x < f64::from(self.width)
            && pixel.y < f64::from(self.height)
    }

    /// Pixel of a point in the camera frame, `None` unless it lies in front of the camera.
    pub fn project(&self, point_in_cam: &Point3<f64>) -> Option<Point2<f64>> {
        if point_in_cam.z <= f64::EPSILON {
            return None;
        }
        Some(self.pixel_from_normalized(&Vector2::new(
            point_in_cam.x / point_in_cam.z,
            point_in_cam.y / point_in_cam.z,
        )))
    }

    /// Pixel of undistorted normalized coordinates `(x/z, y/z)`.
    pub fn pixel_from_normalized(&self, xy: &Vector2<f64>) -> Point2<f64> {
        let uv = self.distort(xy).uv;
        self.principal_point() + uv.component_mul(&self.focal())
    }

    /// [`Self::project`] with derivatives; `None` where that has no pixel.
    pub fn project_with_jacobians(&self, point_in_cam: &Point3<f64>) -> Option<Projection> {
        if point_in_cam.z <= f64::EPSILON {
            return None;
        }
        let z_inv = 1.0 / point_in_cam.z;
        let xy = Vector2::new(point_in_cam.x * z_inv, point_in_cam.y * z_inv);
        let distorted = self.distort(&xy);
        let focal = self.focal();
        let pixel = self.principal_point() + distorted.uv.component_mul(&focal);

        let d_uv = Matrix2::from_diagonal(&focal) * distorted.d_xy;
        let d_xy_d_point = Matrix2x3::new(z_inv, 0.0, -xy.x * z_inv, 0.0, z_inv, -xy.y * z_inv);

        let mut d_params = SMatrix::<f64, 2, MAX_CAMERA_PARAMS>::zeros();
        let num_focals = self.model.num_focals();
        d_params[(0, 0)] = distorted.uv.x;
        d_params[(1, num_focals - 1)] = distorted.uv.y;
        d_params[(0, num_focals)] = 1.0;
        d_params[(1, num_focals + 1)] = 1.0;
        let start = self.model.distortion_start();
        for column in start..self.model.num_params() {
            d_params.set_column(column, &distorted.d_k[column - start].component_mul(&focal));
        }
        Some(Projection { pixel, d_point: d_uv * d_xy_d_point, d_params })
    }

    /// Undistorted normalized coordinates `(x/z, y/z)` of a pixel, `None` where the distortion
    /// cannot be inverted (outside the part of the image that the lens model describes).
    pub fn unproject(&self, pixel: &Point2<f64>) -> Option<Vector2<f64>> {
        let uv = (pixel - self.principal_point()).component_div(&self.focal());
        if matches!(self.model, CameraModel::SimplePinhole | CameraModel::Pinhole) {
            return Some(uv);
        }
        let mut xy = if self.model == CameraModel::OpenCvFisheye {
            // Start from the equidistant lens: r = tan θ_d.
            let theta = uv.norm().min(std::f64::consts::FRAC_PI_2 - 1e-3);
            if theta > 1e-9 { uv * (theta.tan() / uv.norm()) } else { uv }
        } else {
            uv
        };
        for _ in 0..MAX_UNDISTORT_ITERATIONS {
            let distorted = self.distort(&xy);
            let step = distorted.d_xy.try_inverse()? * (distorted.uv - uv);
            xy -= step;
            if !xy.x.is_finite() || !xy.y.is_finite() {
                return None;
            }
            if step.norm_squared() < 1e-20 * (1.0 + xy.norm_squared()) {
                // Past the fold of a polynomial the model maps two rays onto one pixel.
                // Both eigenvalues stay positive up to the fold.
                let d = self.distort(&xy).d_xy;
                return (d.determinant() > 0.0 && d.trace() > 0.0).then_some(xy);
            }
        }
        None
    }

    /// Unit ray in the camera frame through a pixel.
    pub fn bearing(&self, pixel: &Point2<f64>) -> Option<Unit<Vector3<f64>>> {
        self.unproject(pixel).map(|xy| Unit::new_normalize(Vector3::new(xy.x, xy.y, 1.0)))
    }

    fn distort(&self, xy: &Vector2<f64>) -> Distorted {
        distort(self.model, &self.params[self.model.distortion_start()..], xy)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(model: CameraModel) -> Camera {
        let distortion: &[f64] = match model {
            CameraModel::SimplePinhole | CameraModel::Pinhole => &[],
            CameraModel::SimpleRadial => &[-0.12],
            CameraModel::Radial => &[-0.12, 0.05],
            CameraModel::OpenCv => &[-0.12, 0.05, 0.002, -0.003],
            CameraModel::OpenCvFisheye => &[-0.02, 0.01, -0.004, 0.001],
            CameraModel::FullOpenCv => &[-0.12, 0.05, 0.002, -0.003, 0.02, 0.01, 0.003, 0.002],
        };
        let mut params = vec![500.0, 510.0];
        params.truncate(model.num_focals());
        params.extend([321.0, 238.0]);
        params.extend(distortion);
        Camera::new(model, 640, 480, &params).unwrap()
    }

    const POINTS: [[f64; 3]; 4] =
        [[0.3, -0.2, 1.5], [0.0, 0.0, 2.0], [-1.0, 0.7, 2.2], [1e-8, 2e-8, 1.0]];

    #[test]
    fn jacobians_equal_central_differences() {
        for model in CameraModel::ALL {
            let camera = camera(model);
            for point in POINTS.map(Point3::from) {
                let projection = camera.project_with_jacobians(&point).unwrap();
                let plain = camera.project(&point).unwrap();
                assert!((projection.pixel - plain).norm() < 1e-10);
                let h = 1e-6;
                for axis in 0..3 {
                    let mut step = Vector3::zeros();
                    step[axis] = h;
                    let numeric = (camera.project(&(point + step)).unwrap()
                        - camera.project(&(point - step)).unwrap())
                        / (2.0 * h);
                    let analytic = projection.d_point.column(axis);
                    assert!((numeric - analytic).norm() < 1e-5, "{model:?} axis {axis}");
                }
                for index in 0..model.num_params() {
                    let (mut plus, mut minus) = (camera, camera);
                    plus.params[index] += h;
                    minus.params[index] -= h;
                    let numeric = (plus.project(&point).unwrap() - minus.project(&point).unwrap())
                        / (2.0 * h);
                    let analytic = projection.d_params.column(index);
                    assert!((numeric - analytic).norm() < 1e-5, "{model:?} parameter {index}");
                }
            }
        }
    }

    #[test]
    fn unproject_inverts_project() {
        for model in CameraModel::ALL {
            let camera = camera(model);
            for u in (0..=640).step_by(80) {
                for v in (0..=480).step_by(80) {
                    let pixel = Point2::new(f64::from(u), f64::from(v));
                    let xy = camera.unproject(&pixel).unwrap();
                    let back = camera.pixel_from_normalized(&xy);
                    assert!((back - pixel).norm() < 1e-7, "{model:?} {pixel}");
                }
            }
        }
    }

    /// A strong negative k1 folds the image over: no ray may be claimed beyond the fold.
    #[test]
    fn no_ray_beyond_the_fold() {
        let camera =
            Camera::new(CameraModel::SimpleRadial, 640, 480, &[300.0, 320.0, 240.0, -0.9]).unwrap();
        assert_eq!(camera.unproject(&Point2::new(640.0, 480.0)), None);
    }

    #[test]
    fn points_behind_have_no_pixel() {
        for model in CameraModel::ALL {
            assert_eq!(camera(model).project(&Point3::new(0.1, 0.1, -1.0)), None);
        }
    }

    #[test]
    fn bad_parameters_are_refused() {
        let refuse = |params: &[f64]| Camera::new(CameraModel::Pinhole, 640, 480, params).is_err();
        assert!(refuse(&[500.0, 500.0, 320.0]));
        assert!(refuse(&[0.0, 500.0, 320.0, 240.0]));
        assert!(refuse(&[f64::NAN, 500.0, 320.0, 240.0]));
        assert!(!refuse(&[500.0, 500.0, 320.0, 240.0]));
    }
}
