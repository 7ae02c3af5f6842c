//! What color each pixel shows.

use crate::DrawableMesh;
use crate::frame::{Band, NOTHING};
use crate::raster::View;
use crate::simd::LANES;
use crate::virtual_camera::Rays;

/// Colors the pixels of a band by the triangles they see.
pub(crate) fn shade(mesh: &DrawableMesh, view: &View, rays: &Rays, band: &mut Band) {
    let (mut known, mut corners, mut colors) = (NOTHING, [[0.0; 3]; 3], [[0.0; 3]; 3]);
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
                }
                let [a, b, c] = weights(&corners, xs[lane], ys[lane]);
                for k in 0..3 {
                    let sum = a * colors[0][k] + b * colors[1][k] + c * colors[2][k] + 0.5;
                    shown[lane][k] = sum as u8;
                }
            }
        }
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
