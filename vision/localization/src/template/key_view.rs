//! One wide view of the surfaces around the place where the search starts. Views from near it are
//! made of its points, far faster than of the whole mesh.

use nalgebra::{Isometry3, Matrix3, Vector3};
use volery_geometry::{Camera, CameraModel};
use volery_rendering::{Rendering, VirtualCamera};
use volery_scene::GrayImage;

use super::planes::{MEAN, normalized};
use super::working::Level;

/// Sides of the key view per side of the drone's view.
const WIDENING: f64 = 1.6;

/// A surface point that the key view shows.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ViewPoint {
    /// In the key view's camera frame, meters.
    pub(crate) position: Vector3<f32>,
    /// Normalized gray level.
    pub(crate) value: f32,
    /// Contrast of the surroundings: how much the point says about where it is.
    pub(crate) slope: f32,
}

/// The points that were seen from where the search starts.
#[derive(Debug, Clone)]
pub(crate) struct KeyView {
    pub(crate) cam_from_world: Isometry3<f64>,
    pub(crate) points: Vec<ViewPoint>,
    pub(crate) median_depth: f64,
}

impl KeyView {
    /// The camera of a wide view with the pixels of `level`.
    pub(crate) fn camera(level: &Level) -> Option<Camera> {
        let wide = |v: u32| (f64::from(v) * WIDENING).round();
        let (width, height) = (wide(level.camera.width), wide(level.camera.height));
        let (focal, center) = (level.camera.focal(), level.camera.principal_point());
        let shift = |wide: f64, v: u32| (wide - f64::from(v)) / 2.0;
        let params = [
            focal.x,
            focal.y,
            center.x + shift(width, level.camera.width),
            center.y + shift(height, level.camera.height),
        ];
        Camera::new(CameraModel::Pinhole, width as u32, height as u32, &params).ok()
    }

    /// From a drawn view.
    pub(crate) fn new(
        eye: &VirtualCamera,
        drawn: &Rendering,
        radius: usize,
        cam_from_world: &Isometry3<f64>,
    ) -> Self {
        let camera = eye.camera();
        let gray = normalized(&drawn.gray(), radius, |k| drawn.depth[k] > 0.0);
        let (focal, center) =
            (camera.focal().cast::<f32>(), camera.principal_point().cast::<f32>());
        let width = drawn.width as usize;
        let mut points = Vec::with_capacity(drawn.depth.len());
        let mut depths = Vec::with_capacity(drawn.depth.len());
        for (k, &depth) in drawn.depth.iter().enumerate() {
            if depth <= 0.0 {
                continue;
            }
            let (x, y) = (k % width, k / width);
            let [u, v] = [x, y].map(|c| c as f32 + 0.5);
            let ray = Vector3::new((u - center.x) / focal.x, (v - center.y) / focal.y, 1.0);
            points.push(ViewPoint {
                position: ray * depth,
                value: f32::from(gray.pixels()[k]),
                slope: slope(&gray, x, y),
            });
            depths.push(f64::from(depth));
        }
        let median_depth = volery_geometry::median(&mut depths).unwrap_or(0.0);
        Self { cam_from_world: *cam_from_world, points, median_depth }
    }

    /// What a pinhole camera sees of the points, [`MEAN`] where there are none, with their depth,
    /// infinite there.
    pub(crate) fn view(
        &self,
        camera: &Camera,
        cam_from_world: &Isometry3<f64>,
    ) -> (GrayImage, Vec<f32>) {
        let cam_from_key = cam_from_world * self.cam_from_world.inverse();
        let r: Matrix3<f32> = cam_from_key.rotation.to_rotation_matrix().into_inner().cast();
        let t: Vector3<f32> = cam_from_key.translation.vector.cast();
        let (focal, center) =
            (camera.focal().cast::<f32>(), camera.principal_point().cast::<f32>());
        let (width, height) = (camera.width as usize, camera.height as usize);
        let mut nearest = vec![f32::INFINITY; width * height];
        let mut pixels = vec![MEAN; width * height];
        for point in &self.points {
            let p = r * point.position + t;
            if p.z < 0.05 {
                continue;
            }
            let w = 1.0 / p.z;
            let (u, v) = (focal.x * p.x * w + center.x, focal.y * p.y * w + center.y);
            if u >= 0.0 && v >= 0.0 && u < width as f32 && v < height as f32 {
                let at = v as usize * width + u as usize;
                if p.z < nearest[at] {
                    nearest[at] = p.z;
                    pixels[at] = point.value as u8;
                }
            }
        }
        let gray = GrayImage::new(camera.width, camera.height, pixels);
        (gray.expect("as many as pixels"), nearest)
    }
}

fn slope(gray: &GrayImage, x: usize, y: usize) -> f32 {
    let (width, height) = (gray.width() as usize, gray.height() as usize);
    if x == 0 || y == 0 || x + 1 >= width || y + 1 >= height {
        return 0.0;
    }
    let at = |x: usize, y: usize| f32::from(gray.pixels()[y * width + x]);
    (at(x + 1, y) - at(x - 1, y)).abs().max((at(x, y + 1) - at(x, y - 1)).abs())
}
