//! What color each pixel shows.

use nalgebra::Vector3;

use crate::DrawableMesh;
use crate::frame::{Band, NOTHING};
use crate::raster::View;
use crate::simd::LANES;
use crate::texture::Paint;
use crate::virtual_camera::Rays;

/// Colors the pixels of a band by the triangles they see.
pub(crate) fn shade(mesh: &DrawableMesh, view: &View, rays: &Rays, focal: f32, band: &mut Band) {
    let (mut known, mut corners, mut colors) = (NOTHING, [[0.0; 3]; 3], [[0.0; 3]; 3]);
    let mut picture: Option<Picture> = None;
    for row in band.rows.clone() {
        for column in 0..band.columns {
            let at = (row - band.rows.start) * band.columns + column;
            let (xs, ys) = rays.block(column, row);
            let (ids, shown) = (&band.ids[at], &mut band.colors[at]);
            for lane in 0..LANES {
                let id = ids[lane];
                if id == NOTHING {
                    continue;
                }
                if id != known {
                    known = id;
                    let vertices = mesh.triangles[id as usize].map(|v| v as usize);
                    corners = vertices.map(|v| view.in_cam(mesh.positions[v]));
                    colors = vertices.map(|v| mesh.colors[v].map(f32::from));
                    picture = Picture::of(mesh, id as usize, &corners);
                }
                let [a, b, c] = weights(&corners, xs[lane], ys[lane]);
                if let Some(picture) = &picture {
                    let depth = 1.0 / band.inverse_depth[at][lane];
                    shown[lane] = picture.color([a, b, c], xs[lane], ys[lane], depth, focal);
                    continue;
                }
                for k in 0..3 {
                    let sum = a * colors[0][k] + b * colors[1][k] + c * colors[2][k] + 0.5;
                    shown[lane][k] = sum as u8;
                }
            }
        }
    }
}

/// A triangle's part of the texture.
struct Picture<'a> {
    paint: &'a Paint,
    corners: [[f32; 2]; 3],
    /// Unit, in the camera frame.
    normal: Vector3<f32>,
    /// Texels per meter.
    density: f32,
}

impl<'a> Picture<'a> {
    fn of(mesh: &'a DrawableMesh, triangle: usize, in_cam: &[[f32; 3]; 3]) -> Option<Self> {
        let paint = mesh.paint.as_ref().filter(|paint| paint.is_textured[triangle])?;
        let corners = mesh.triangles[triangle].map(|v| paint.positions[v as usize]);
        let [p, q, r] = in_cam.map(Vector3::from);
        let across = (q - p).cross(&(r - p));
        let area = across.norm();
        let [a, b, c] = corners;
        let texels = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
        let density = (texels.abs() / area).sqrt();
        let normal = across / area;
        // A sliver shows the colors of its corners.
        (area > 0.0).then_some(Self { paint, corners, normal, density })
    }

    fn color(&self, weights: [f32; 3], x: f32, y: f32, depth: f32, focal: f32) -> [u8; 3] {
        let at = |k: usize| {
            let [a, b, c] = self.corners;
            weights[0] * a[k] + weights[1] * b[k] + weights[2] * c[k]
        };
        let ray = Vector3::new(x, y, 1.0);
        let slant = (self.normal.dot(&ray).abs() / ray.norm()).max(0.05);
        // Between what a pixel covers along and across the slant.
        let texels = depth / focal * self.density / slant.sqrt();
        self.paint.color([at(0), at(1)], texels)
    }
}

/// Weights of a triangle's corners where the ray `(x, y, 1)` meets its plane:
/// λᵢ ∝ (pⱼ × pₖ) · ray, which holds on both sides of the camera.
#[inline(always)]
fn weights(corners: &[[f32; 3]; 3], x: f32, y: f32) -> [f32; 3] {
    // Relative to the ray the differences are small and keep their digits.
    let [p, q, r] = corners.map(|c| [c[0] - x * c[2], c[1] - y * c[2]]);
    let cross = |a: [f32; 2], b: [f32; 2]| a[0] * b[1] - a[1] * b[0];
    let [u, v, w] = [cross(q, r), cross(r, p), cross(p, q)];
    // Rounding at the rim of thin triangles is cut off.
    let scale = 1.0 / (u + v + w);
    let [u, v, w] = [u, v, w].map(|weight| (weight * scale).clamp(0.0, 1.0));
    let total = 1.0 / (u + v + w);
    [u * total, v * total, w * total]
}
