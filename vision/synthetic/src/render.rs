//! Exact images of a hall.

use nalgebra::{Isometry3, Vector2};
use rayon::prelude::*;
use volery_geometry::Camera;

use crate::Hall;
use crate::texture::Footprint;
use crate::tiles::{Hit, MISS, Region, View, candidates, nearest};

/// Edge of a tile, pixels.
const TILE: usize = 16;
/// Samples per edge of a pixel that shows more than one surface.
const EDGE_SAMPLES: usize = 4;
/// Part of a pixel whose mean is taken; a little less than all keeps detail.
const PIXEL_APERTURE: f64 = 0.8;

/// An ideal image: no noise, no blur, no quantization.
#[derive(Debug, Clone, PartialEq)]
pub struct Rendering {
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// Displayed colors 0..255, row by row.
    pub colors: Vec<[f32; 3]>,
    /// Depth along the camera's z at the pixel centers, meters; 0 where nothing is seen.
    pub depth: Vec<f32>,
    /// Where it was taken.
    pub cam_from_world: Isometry3<f64>,
}

/// A camera with the rays of its pixel corners, to be used for many images.
#[derive(Debug, Clone)]
pub struct Renderer {
    camera: Camera,
    /// `(x, y)` of the rays `(x, y, 1)` through the pixel corners, row by row; NaN where the lens
    /// model has none.
    corner_rays: Vec<[f64; 2]>,
}

impl Renderer {
    /// Prepares a camera of any model whose view is less than 180 degrees wide.
    pub fn new(camera: &Camera) -> Self {
        let columns = camera.width as usize + 1;
        let corner_rays = (0..columns * (camera.height as usize + 1))
            .into_par_iter()
            .map(|k| {
                let pixel = nalgebra::Point2::new((k % columns) as f64, (k / columns) as f64);
                camera.unproject(&pixel).map_or([f64::NAN; 2], |xy| [xy.x, xy.y])
            })
            .collect();
        Self { camera: *camera, corner_rays }
    }

    /// The camera.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// The image of `hall` at a pose.
    pub fn render(&self, hall: &Hall, cam_from_world: &Isometry3<f64>) -> Rendering {
        let (width, height) = (self.camera.width as usize, self.camera.height as usize);
        let views: Vec<View> = hall
            .surfaces
            .iter()
            .enumerate()
            .filter_map(|(index, surface)| View::new(surface, index, cam_from_world))
            .collect();
        let all: Vec<u32> = (0..views.len() as u32).collect();
        let mut colors = vec![[0.0; 3]; width * height];
        let mut depth = vec![0.0; width * height];
        let bands = colors.par_chunks_mut(width * TILE).zip(depth.par_chunks_mut(width * TILE));
        bands.enumerate().for_each(|(band, (colors, depth))| {
            let rows = band * TILE..(band * TILE + TILE).min(height);
            let Some(region) = self.region(0..width, rows.clone()) else { return };
            let in_band: Vec<u32> =
                all.iter().copied().filter(|&v| views[v as usize].may_show(&region)).collect();
            for start in (0..width).step_by(TILE) {
                let columns = start..(start + TILE).min(width);
                let Some(region) = self.region(columns.clone(), rows.clone()) else { continue };
                let shown = candidates(&views, &in_band, &region);
                self.render_tile(hall, &views, &shown, columns, rows.clone(), colors, depth);
            }
        });
        Rendering {
            width: self.camera.width,
            height: self.camera.height,
            colors,
            depth,
            cam_from_world: *cam_from_world,
        }
    }

    #[allow(clippy::too_many_arguments)]
    fn render_tile(
        &self,
        hall: &Hall,
        views: &[View],
        shown: &[u32],
        columns: std::ops::Range<usize>,
        rows: std::ops::Range<usize>,
        colors: &mut [[f32; 3]],
        depth: &mut [f32],
    ) {
        let width = self.camera.width as usize;
        let mut hits = [[MISS; TILE + 1]; TILE + 1];
        for (j, row) in (rows.start..=rows.end).enumerate() {
            for (i, column) in (columns.start..=columns.end).enumerate() {
                let [x, y] = self.corner_ray(column, row);
                hits[j][i] = nearest(views, shown, x, y);
            }
        }
        for (j, row) in rows.clone().enumerate() {
            for (i, column) in columns.clone().enumerate() {
                let corners = [hits[j][i], hits[j][i + 1], hits[j + 1][i], hits[j + 1][i + 1]];
                let rays = [
                    self.corner_ray(column, row),
                    self.corner_ray(column + 1, row),
                    self.corner_ray(column, row + 1),
                    self.corner_ray(column + 1, row + 1),
                ];
                let at = (row - rows.start) * width + column;
                (colors[at], depth[at]) = render_pixel(hall, views, shown, &corners, &rays);
            }
        }
    }

    fn corner_ray(&self, column: usize, row: usize) -> [f64; 2] {
        self.corner_rays[row * (self.camera.width as usize + 1) + column]
    }

    /// Bounds of the rays of a block of pixels, from its rim; `None` where it has none.
    fn region(
        &self,
        columns: std::ops::Range<usize>,
        rows: std::ops::Range<usize>,
    ) -> Option<Region> {
        let mut region = Region { min: [f64::INFINITY; 2], max: [f64::NEG_INFINITY; 2] };
        let mut add = |[x, y]: [f64; 2]| {
            // NaN is passed over by min and max.
            region.min = [region.min[0].min(x), region.min[1].min(y)];
            region.max = [region.max[0].max(x), region.max[1].max(y)];
        };
        for column in columns.start..=columns.end {
            add(self.corner_ray(column, rows.start));
            add(self.corner_ray(column, rows.end));
        }
        for row in rows.start..=rows.end {
            add(self.corner_ray(columns.start, row));
            add(self.corner_ray(columns.end, row));
        }
        (region.min[0] < region.max[0]).then_some(region)
    }
}

/// Color and depth of a pixel from its four corner rays and what they hit.
fn render_pixel(
    hall: &Hall,
    views: &[View],
    shown: &[u32],
    corners: &[Hit; 4],
    rays: &[[f64; 2]; 4],
) -> ([f32; 3], f32) {
    let [x, y] = blend(rays, 0.5, 0.5);
    if corners.iter().all(|hit| hit.view == corners[0].view) {
        if corners[0].view == MISS.view || !x.is_finite() {
            return ([0.0; 3], 0.0);
        }
        // One surface: a single prefiltered sample is exact.
        let view = &views[corners[0].view as usize];
        let depth = 1.0 / nearest(views, &[corners[0].view], x, y).inverse_depth;
        return (shade(hall, view, rays, 0.5, 0.5, PIXEL_APERTURE), depth as f32);
    }
    let mut sum = [0.0; 3];
    for k in 0..EDGE_SAMPLES * EDGE_SAMPLES {
        let place = |k: usize| {
            let s = (k as f64 + 0.5) / EDGE_SAMPLES as f64;
            0.5 + PIXEL_APERTURE * (s - 0.5)
        };
        let (fx, fy) = (place(k % EDGE_SAMPLES), place(k / EDGE_SAMPLES));
        let [x, y] = blend(rays, fx, fy);
        let hit = nearest(views, shown, x, y);
        if let Some(view) = views.get(hit.view as usize) {
            let color = shade(hall, view, rays, fx, fy, PIXEL_APERTURE / EDGE_SAMPLES as f64);
            (0..3).for_each(|c| sum[c] += color[c] / (EDGE_SAMPLES * EDGE_SAMPLES) as f32);
        }
    }
    let center = nearest(views, shown, x, y);
    let depth = if center.view == MISS.view { 0.0 } else { 1.0 / center.inverse_depth };
    (sum, depth as f32)
}

/// Color of a surface around `(fx, fy)` of a pixel, averaged over `aperture` of the pixel.
fn shade(
    hall: &Hall,
    view: &View,
    rays: &[[f64; 2]; 4],
    fx: f64,
    fy: f64,
    aperture: f64,
) -> [f32; 3] {
    let position = |fx: f64, fy: f64| {
        let [x, y] = blend(rays, fx, fy);
        view.position(x, y)
    };
    let [u, v] = position(fx, fy);
    let half = aperture / 2.0;
    let [right, down] = [position(fx + half, fy), position(fx, fy + half)];
    let along = |to: [f64; 2]| Vector2::new((2.0 * (to[0] - u)) as f32, (2.0 * (to[1] - v)) as f32);
    let footprint = Footprint { along_x: along(right), along_y: along(down) };
    let texture = &hall.surfaces[view.surface as usize].texture;
    texture.sample(Vector2::new(u as f32, v as f32), &footprint)
}

fn blend(rays: &[[f64; 2]; 4], fx: f64, fy: f64) -> [f64; 2] {
    std::array::from_fn(|k| {
        let top = rays[0][k] + fx * (rays[1][k] - rays[0][k]);
        let bottom = rays[2][k] + fx * (rays[3][k] - rays[2][k]);
        top + fy * (bottom - top)
    })
}
