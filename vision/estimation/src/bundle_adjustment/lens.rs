//! Projection in plain arithmetic: the common lens models without branches or matrices.

use volery_geometry::{Camera, CameraModel, MAX_CAMERA_PARAMS, Point3};

/// `a * b + c`, fused where the target has the instruction.
#[inline(always)]
pub(super) fn fma<const FMA: bool>(a: f64, b: f64, c: f64) -> f64 {
    if FMA { a.mul_add(b, c) } else { a * b + c }
}

/// Derivatives of a pixel by all intrinsics, one row per axis.
pub(super) type ParamJacobian = [[f64; MAX_CAMERA_PARAMS]; 2];

/// A pixel with its derivatives by the point in the camera frame.
pub(super) struct LensJacobian {
    pub(super) pixel: [f64; 2],
    pub(super) d_point: [[f64; 3]; 2],
}

/// A camera made ready for millions of projections.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lens {
    camera: Camera,
    /// Whether Brown's model with `k1, k2, p1, p2` holds (unused coefficients are zero).
    is_brown: bool,
    focal: [f64; 2],
    center: [f64; 2],
    k: [f64; 2],
    p: [f64; 2],
}

impl Lens {
    pub(super) fn new(camera: &Camera) -> Self {
        let (focal, center) = (camera.focal(), camera.principal_point());
        let distortion = &camera.params()[camera.model.distortion_start()..];
        let at = |index: usize| distortion.get(index).copied().unwrap_or(0.0);
        let is_brown =
            !matches!(camera.model, CameraModel::OpenCvFisheye | CameraModel::FullOpenCv);
        Self {
            camera: *camera,
            is_brown,
            focal: [focal.x, focal.y],
            center: [center.x, center.y],
            k: [at(0), at(1)],
            p: [at(2), at(3)],
        }
    }

    /// Pixel of a point in the camera frame, `None` unless it lies in front of the camera.
    #[inline(always)]
    pub(super) fn project<const FMA: bool>(&self, p: &[f64; 3]) -> Option<[f64; 2]> {
        if p[2] <= f64::EPSILON {
            return None;
        }
        if !self.is_brown {
            return self.camera.project(&Point3::from(*p)).map(|pixel| [pixel.x, pixel.y]);
        }
        let z_inv = 1.0 / p[2];
        let (x, y) = (p[0] * z_inv, p[1] * z_inv);
        let (xx, xy, yy) = (x * x, x * y, y * y);
        let r2 = xx + yy;
        let radial = fma::<FMA>(r2, fma::<FMA>(r2, self.k[1], self.k[0]), 1.0);
        let u = x * radial + 2.0 * self.p[0] * xy + self.p[1] * (r2 + 2.0 * xx);
        let v = y * radial + self.p[0] * (r2 + 2.0 * yy) + 2.0 * self.p[1] * xy;
        Some([
            fma::<FMA>(self.focal[0], u, self.center[0]),
            fma::<FMA>(self.focal[1], v, self.center[1]),
        ])
    }

    /// [`Self::project`] with derivatives; those by the intrinsics only where `d_params` is given.
    #[inline(always)]
    pub(super) fn project_with_jacobians<const FMA: bool>(
        &self,
        p: &[f64; 3],
        d_params: Option<&mut ParamJacobian>,
    ) -> Option<LensJacobian> {
        if p[2] <= f64::EPSILON {
            return None;
        }
        if !self.is_brown {
            return self.project_generally(p, d_params);
        }
        let z_inv = 1.0 / p[2];
        let (x, y) = (p[0] * z_inv, p[1] * z_inv);
        let (xx, xy, yy) = (x * x, x * y, y * y);
        let r2 = xx + yy;
        let ([k1, k2], [p1, p2], [fx, fy]) = (self.k, self.p, self.focal);
        let radial = fma::<FMA>(r2, fma::<FMA>(r2, k2, k1), 1.0);
        let d_radial = 2.0 * fma::<FMA>(2.0 * k2, r2, k1); // 2 d radial / d r²
        let u = x * radial + 2.0 * p1 * xy + p2 * (r2 + 2.0 * xx);
        let v = y * radial + p1 * (r2 + 2.0 * yy) + 2.0 * p2 * xy;

        let u_x = radial + xx * d_radial + 2.0 * p1 * y + 6.0 * p2 * x;
        let u_y = xy * d_radial + 2.0 * (p1 * x + p2 * y); // = v_x
        let v_y = radial + yy * d_radial + 6.0 * p1 * y + 2.0 * p2 * x;
        let (fx_z, fy_z) = (fx * z_inv, fy * z_inv);
        let row =
            |f_z: f64, dx: f64, dy: f64| [f_z * dx, f_z * dy, -f_z * fma::<FMA>(dx, x, dy * y)];
        if let Some(d) = d_params {
            let num_focals = self.camera.model.num_focals();
            (d[0][0], d[1][num_focals - 1]) = (u, v);
            (d[0][num_focals], d[1][num_focals + 1]) = (1.0, 1.0);
            let start = num_focals + 2;
            let num_distortion = self.camera.model.num_params() - start;
            let by_u = [x * r2, x * r2 * r2, 2.0 * xy, r2 + 2.0 * xx];
            let by_v = [y * r2, y * r2 * r2, r2 + 2.0 * yy, 2.0 * xy];
            for index in 0..num_distortion {
                d[0][start + index] = fx * by_u[index];
                d[1][start + index] = fy * by_v[index];
            }
        }
        Some(LensJacobian {
            pixel: [fma::<FMA>(fx, u, self.center[0]), fma::<FMA>(fy, v, self.center[1])],
            d_point: [row(fx_z, u_x, u_y), row(fy_z, u_y, v_y)],
        })
    }

    /// Through [`Camera::project_with_jacobians`], for the rarer models.
    #[inline(never)]
    fn project_generally(
        &self,
        p: &[f64; 3],
        d_params: Option<&mut ParamJacobian>,
    ) -> Option<LensJacobian> {
        let projection = self.camera.project_with_jacobians(&Point3::from(*p))?;
        if let Some(d) = d_params {
            for (axis, row) in d.iter_mut().enumerate() {
                for (index, value) in row.iter_mut().enumerate() {
                    *value = projection.d_params[(axis, index)];
                }
            }
        }
        let row = |axis: usize| std::array::from_fn(|column| projection.d_point[(axis, column)]);
        Some(LensJacobian {
            pixel: [projection.pixel.x, projection.pixel.y],
            d_point: [row(0), row(1)],
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The fast path is the camera's own projection for every model, with and without fused
    /// multiply-add.
    #[test]
    fn lens_equals_camera() {
        for model in CameraModel::ALL {
            let mut params = vec![500.0, 510.0];
            params.truncate(model.num_focals());
            params.extend([321.0, 238.0]);
            let distortion = [-0.12, 0.05, 0.002, -0.003, 0.02, 0.01, 0.003, 0.002];
            params.extend(&distortion[..model.num_params() - params.len()]);
            let camera = Camera::new(model, 640, 480, &params).unwrap();
            for point in [[0.3, -0.2, 1.5], [0.0, 0.0, 2.0], [-1.0, 0.7, 2.2]] {
                let expected = camera.project_with_jacobians(&Point3::from(point)).unwrap();
                let lens = Lens::new(&camera);
                let mut d_params = ParamJacobian::default();
                let fast =
                    lens.project_with_jacobians::<true>(&point, Some(&mut d_params)).unwrap();
                let plain = lens.project::<false>(&point).unwrap();
                for axis in 0..2 {
                    assert!((fast.pixel[axis] - expected.pixel[axis]).abs() < 1e-10);
                    assert!((plain[axis] - expected.pixel[axis]).abs() < 1e-10);
                    for column in 0..3 {
                        let difference =
                            fast.d_point[axis][column] - expected.d_point[(axis, column)];
                        assert!(difference.abs() < 1e-9, "{model:?} {axis} {column}");
                    }
                    for (index, found) in d_params[axis].iter().enumerate() {
                        let difference = found - expected.d_params[(axis, index)];
                        assert!(difference.abs() < 1e-9, "{model:?} parameter {index}");
                    }
                }
            }
        }
    }
}
