//! Points drawn as discs.

use nalgebra::{Isometry3, Point3};
use rayon::prelude::*;
use volery_geometry::Camera;

use crate::VirtualCamera;
use crate::frame::Band;
use crate::simd::LANES;
use crate::virtual_camera::BLOCK;

/// Largest radius of a disc, pixels: nearer points do not hide all others.
const MAX_RADIUS_PX: f32 = 12.0;

/// Colored points of one size.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DrawablePoints {
    /// Positions; those that are not finite are not drawn.
    pub positions: Vec<Point3<f64>>,
    /// sRGB, one per position; positions without one are not drawn.
    pub colors: Vec<[u8; 3]>,
    /// Radius of the discs, meters; every point has a pixel at least.
    pub radius: f64,
}

/// A point in the image.
pub(crate) struct Splat {
    index: u32,
    pixel: [f32; 2],
    radius_px: f32,
    inverse_depth: f32,
}

/// The points in view, in their order.
pub(crate) fn splats(
    eye: &VirtualCamera,
    points: &DrawablePoints,
    cam_from_world: &Isometry3<f64>,
) -> Vec<Splat> {
    let camera = eye.camera();
    let focal = camera.mean_focal();
    let num = points.positions.len().min(points.colors.len());
    let bounds = &eye.rays.bounds;
    points.positions[..num]
        .par_iter()
        .enumerate()
        .filter_map(|(index, position)| {
            let p = cam_from_world * position;
            if p.z.is_nan() || p.z < f64::from(eye.near) {
                return None;
            }
            let radius_px = ((focal * points.radius / p.z) as f32).clamp(0.5, MAX_RADIUS_PX);
            // Beyond the rim of the image a lens model may say anything.
            let slack = 2.0 * radius_px / focal as f32;
            let (x, y) = ((p.x / p.z) as f32, (p.y / p.z) as f32);
            let is_within = x >= bounds.low[0] - slack
                && x <= bounds.high[0] + slack
                && y >= bounds.low[1] - slack
                && y <= bounds.high[1] + slack;
            let pixel = if is_within { camera.project(&p)? } else { return None };
            Some(Splat {
                index: index as u32,
                pixel: [pixel.x as f32, pixel.y as f32],
                radius_px,
                inverse_depth: (1.0 / p.z) as f32,
            })
        })
        .collect()
}

/// Draws the discs into a band.
pub(crate) fn splat(points: &DrawablePoints, splats: &[Splat], camera: &Camera, band: &mut Band) {
    let first_row = band.rows.start * BLOCK;
    let end_row = (band.rows.end * BLOCK).min(camera.height as usize);
    for splat in splats {
        let [u, v] = splat.pixel;
        let radius = splat.radius_px;
        // The pixel in which the point falls, and those whose centers the disc covers.
        let first = |at: f32| (at - radius - 0.5).ceil().min(at.floor()).max(0.0) as usize;
        let end = |at: f32| (at + radius + 0.5).floor().max(at.floor() + 1.0).max(0.0) as usize;
        for y in first(v).max(first_row)..end(v).min(end_row) {
            for x in first(u)..end(u).min(camera.width as usize) {
                let (dx, dy) = (x as f32 + 0.5 - u, y as f32 + 0.5 - v);
                let is_own = dx.abs() <= 0.5 && dy.abs() <= 0.5;
                if !is_own && dx * dx + dy * dy > radius * radius {
                    continue;
                }
                let block = (y - first_row) / BLOCK * band.columns + x / BLOCK;
                let lane = (y % BLOCK * BLOCK + x % BLOCK) % LANES;
                if splat.inverse_depth > band.inverse_depth[block][lane] {
                    band.inverse_depth[block][lane] = splat.inverse_depth;
                    band.colors[block][lane] = points.colors[splat.index as usize];
                }
            }
        }
    }
}
