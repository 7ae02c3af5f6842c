//! Plane hypotheses of pixels.

use nalgebra::Vector3;
use volery_geometry::Camera;

use crate::patch::Lanes;

/// Least cosine between a surface's normal and the ray back to the camera: no surface is seen
/// under a flatter angle than 80 degrees.
const MIN_COS: f32 = 0.17;

/// A plane seen through the pixel that holds it.
///
/// A plane `n·X = d` has the inverse depth `w(u, v) = n·K⁻¹(u, v, 1) / d`: a linear function of
/// the pixel. It is kept as its value and slopes at the pixel's center, so that it moves to a
/// neighbor by two products.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Plane {
    /// Inverse depth at the pixel center.
    pub(crate) w: f32,
    /// ∂w/∂u, per pixel.
    pub(crate) slope_u: f32,
    /// ∂w/∂v, per pixel.
    pub(crate) slope_v: f32,
}

impl Plane {
    /// The same plane held by the pixel `(du, dv)` away.
    pub(crate) fn moved(self, du: f32, dv: f32) -> Self {
        Self { w: self.w + self.slope_u * du + self.slope_v * dv, ..self }
    }

    /// The same plane in an image of twice the size.
    pub(crate) fn at_double_size(self) -> Self {
        Self { w: self.w, slope_u: 0.5 * self.slope_u, slope_v: 0.5 * self.slope_v }
    }
}

/// Planes of sixteen pixels: inverse depths and both slopes.
pub(crate) type Planes = [Lanes; 3];

/// Rays of a pinhole camera in single precision.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rays {
    focal: [f32; 2],
    inverse_focal: [f32; 2],
    center: [f32; 2],
}

impl Rays {
    pub(crate) fn new(camera: &Camera) -> Self {
        let (f, c) = (camera.focal(), camera.principal_point());
        let focal = [f.x as f32, f.y as f32];
        let inverse_focal = focal.map(|f| 1.0 / f);
        Self { focal, inverse_focal, center: [c.x as f32, c.y as f32] }
    }

    #[inline(always)]
    fn ray(&self, u: f32, v: f32) -> Vector3<f32> {
        let x = (u - self.center[0]) * self.inverse_focal[0];
        let y = (v - self.center[1]) * self.inverse_focal[1];
        Vector3::new(x, y, 1.0)
    }

    /// Unit normal in the camera frame, towards the camera.
    #[inline(always)]
    pub(crate) fn normal(&self, plane: &Plane, u: f32, v: f32) -> Vector3<f32> {
        let (su, sv) = (plane.slope_u, plane.slope_v);
        let z = plane.w - su * (u - self.center[0]) - sv * (v - self.center[1]);
        -Vector3::new(su * self.focal[0], sv * self.focal[1], z).normalize()
    }

    /// The plane with inverse depth `w` at `(u, v)` and a normal of any length and sign; a normal
    /// that is seen under too flat an angle is turned towards the camera.
    #[inline(always)]
    pub(crate) fn plane(&self, u: f32, v: f32, w: f32, normal: &Vector3<f32>) -> Plane {
        let ray = self.ray(u, v);
        let to_camera = -ray.normalize();
        let mut n = normal.normalize();
        let mut cos = n.dot(&to_camera);
        if cos < 0.0 {
            (n, cos) = (-n, -cos);
        }
        if cos < MIN_COS {
            n += to_camera * (2.0 * MIN_COS);
        }
        let scale = w / n.dot(&ray);
        Plane { w, slope_u: n.x * scale / self.focal[0], slope_v: n.y * scale / self.focal[1] }
    }

    /// Whether the surface is seen under an angle that a surface can be seen under.
    #[inline(always)]
    pub(crate) fn is_visible(&self, plane: &Plane, u: f32, v: f32) -> bool {
        // cos = w / (|n| |ray|) with the normal n of d = 1.
        let (du, dv) = (u - self.center[0], v - self.center[1]);
        let n = [
            plane.slope_u * self.focal[0],
            plane.slope_v * self.focal[1],
            plane.w - plane.slope_u * du - plane.slope_v * dv,
        ];
        let [x, y] = [du * self.inverse_focal[0], dv * self.inverse_focal[1]];
        let normal_squared = n[0] * n[0] + n[1] * n[1] + n[2] * n[2];
        let ray_squared = x * x + y * y + 1.0;
        plane.w > 0.0 && plane.w * plane.w >= MIN_COS * MIN_COS * normal_squared * ray_squared
    }
}

#[cfg(test)]
mod tests {
    use volery_geometry::CameraModel;

    use super::*;

    fn rays() -> Rays {
        let params = [500.0, 510.0, 321.0, 238.0];
        Rays::new(&Camera::new(CameraModel::Pinhole, 640, 480, &params).unwrap())
    }

    /// Points of the moved plane lie on the first one.
    #[test]
    fn a_plane_stays_itself_wherever_it_is_held() {
        let rays = rays();
        let normal = Vector3::new(0.3, -0.5, -1.0);
        let plane = rays.plane(100.0, 400.0, 0.5, &normal);
        let found = rays.normal(&plane, 100.0, 400.0);
        assert!((found - normal.normalize()).norm() < 1e-5);
        let point = rays.ray(100.0, 400.0) / plane.w;
        let moved = plane.moved(37.0, -55.0);
        let other = rays.ray(137.0, 345.0) / moved.w;
        assert!(normal.normalize().dot(&(other - point)).abs() < 1e-5);
        assert!((rays.normal(&moved, 137.0, 345.0) - found).norm() < 1e-5);
    }

    #[test]
    fn no_plane_is_seen_from_behind_or_edge_on() {
        let rays = rays();
        for normal in [[0.0, 0.0, 1.0], [1.0, 0.0, 0.01], [-0.3, 2.0, 0.4]] {
            let plane = rays.plane(10.0, 10.0, 0.2, &Vector3::from(normal));
            assert!(rays.is_visible(&plane, 10.0, 10.0), "{normal:?}");
        }
    }
}
