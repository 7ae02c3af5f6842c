//! The camera that sees what is not there.

use std::ops::Range;

use nalgebra::{Isometry3, Point2, Vector2};
use rayon::prelude::*;
use volery_geometry::{Camera, CameraModel, SimdLevel};

use crate::finder::Finder;
use crate::frame::Band;
use crate::simd::LANES;
use crate::{DrawableMesh, DrawablePoints, Rendering};

/// Edge of a block of pixels: one vector.
pub(crate) const BLOCK: usize = 4;
/// Rows of blocks of a band, the unit of work.
pub(crate) const BAND_ROWS: usize = 16;

/// See [`is_bilinear`].
const MAX_BLEND_ERROR_PX: f64 = 0.01;

/// A camera with the rays of its pixels, to be used for many images.
#[derive(Debug, Clone)]
pub struct VirtualCamera {
    camera: Camera,
    pub(crate) rays: Rays,
    /// Rays of the bands.
    pub(crate) bands: Vec<Bounds>,
    pub(crate) finder: Finder,
    /// Nothing nearer is drawn, meters.
    pub(crate) near: f32,
}

/// Normalized coordinates `(x/z, y/z)` of the pixel centers, block by block; NaN where the lens
/// model has none and beyond the rim of the image.
#[derive(Debug, Clone)]
pub(crate) struct Rays {
    pub(crate) columns: usize,
    pub(crate) rows: usize,
    pub(crate) bounds: Bounds,
    x: Vec<[f32; LANES]>,
    y: Vec<[f32; LANES]>,
}

/// A rectangle of normalized coordinates; without any, `low > high`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Bounds {
    pub(crate) low: [f32; 2],
    pub(crate) high: [f32; 2],
}

impl Bounds {
    const NONE: Self = Self { low: [f32::INFINITY; 2], high: [f32::NEG_INFINITY; 2] };
}

impl VirtualCamera {
    /// Depth of the near plane, meters.
    pub const NEAR: f32 = 0.02;

    /// Prepares a camera of any model.
    pub fn new(camera: &Camera) -> Self {
        let rays = Rays::new(camera);
        let finder = Finder::new(camera, &rays);
        let bands = (0..rays.rows)
            .step_by(BAND_ROWS)
            .map(|row| rays.bounds_of(0..rays.columns, row..(row + BAND_ROWS).min(rays.rows)))
            .collect();
        Self { camera: *camera, rays, bands, finder, near: Self::NEAR }
    }

    /// The camera.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// The image of a mesh (P63): its nearest surface, with the vertices' colors.
    pub fn draw_mesh(&self, mesh: &DrawableMesh, cam_from_world: &Isometry3<f64>) -> Rendering {
        self.draw_mesh_with(SimdLevel::detect(), mesh, cam_from_world)
    }

    /// [`Self::draw_mesh`] with an instruction set; all give the same image.
    pub fn draw_mesh_with(
        &self,
        level: SimdLevel,
        mesh: &DrawableMesh,
        cam_from_world: &Isometry3<f64>,
    ) -> Rendering {
        let focal = self.camera.mean_focal() as f32;
        let view = crate::raster::View::new(mesh, cam_from_world);
        self.draw_triangles(level, mesh, &view, |band| {
            crate::shade::shade(mesh, &view, &self.rays, focal, band);
        })
    }

    /// [`Rendering::depth`] of [`Self::draw_mesh`], without the colors.
    pub fn draw_depth(&self, mesh: &DrawableMesh, cam_from_world: &Isometry3<f64>) -> Vec<f32> {
        let view = crate::raster::View::new(mesh, cam_from_world);
        self.draw_triangles(SimdLevel::detect(), mesh, &view, |_| {}).depth
    }

    fn draw_triangles(
        &self,
        level: SimdLevel,
        mesh: &DrawableMesh,
        view: &crate::raster::View,
        shade: impl Fn(&mut Band) + Sync,
    ) -> Rendering {
        let shown = view.clusters_in(mesh, &self.rays.bounds, self.near);
        self.draw(|band| {
            crate::simd::raster(level, mesh, view, &shown, self, band);
            shade(band);
        })
    }

    /// The image of points as discs towards the camera, the nearest in front.
    pub fn draw_points(
        &self,
        points: &DrawablePoints,
        cam_from_world: &Isometry3<f64>,
    ) -> Rendering {
        let splats = crate::points::splats(self, points, cam_from_world);
        self.draw(|band| crate::points::splat(points, &splats, &self.camera, band))
    }

    /// Draws bands of rows, each for itself, and puts them together.
    fn draw(&self, draw_band: impl Fn(&mut Band) + Sync) -> Rendering {
        let (width, height) = (self.camera.width as usize, self.camera.height as usize);
        let mut colors = vec![[0; 3]; width * height];
        let mut depth = vec![0.0; width * height];
        let num_pixels = width * BAND_ROWS * BLOCK;
        let bands = colors.par_chunks_mut(num_pixels).zip(depth.par_chunks_mut(num_pixels));
        bands.enumerate().for_each(|(index, (colors, depth))| {
            let first = index * BAND_ROWS;
            let rows = first..(first + BAND_ROWS).min(self.rays.rows);
            let mut band = Band::new(rows, self.rays.columns);
            draw_band(&mut band);
            band.copy_to(width, colors, depth);
        });
        Rendering { width: self.camera.width, height: self.camera.height, colors, depth }
    }
}

impl Rays {
    fn new(camera: &Camera) -> Self {
        let columns = (camera.width as usize).div_ceil(BLOCK);
        let rows = (camera.height as usize).div_ceil(BLOCK);
        let is_linear = matches!(camera.model, CameraModel::SimplePinhole | CameraModel::Pinhole);
        let ray = |x: f64, y: f64| {
            camera.unproject(&Point2::new(x, y)).map_or([f64::NAN; 2], |xy| [xy.x, xy.y])
        };
        let corners: Vec<[f64; 2]> = (0..(columns + 1) * (rows + 1))
            .into_par_iter()
            .map(|k| [k % (columns + 1), k / (columns + 1)].map(|c| (c * BLOCK) as f64))
            .map(|[x, y]| ray(x, y))
            .collect();
        let block = |block: usize| {
            let (column, row) = (block % columns, block / columns);
            let start = row * (columns + 1) + column;
            let four = [0, 1, columns + 1, columns + 2].map(|k| corners[start + k]);
            let is_blended = is_linear || is_bilinear(camera, &four, [column, row]);
            let (mut xs, mut ys) = ([f32::NAN; LANES], [f32::NAN; LANES]);
            for lane in 0..LANES {
                let (i, j) = (lane % BLOCK, lane / BLOCK);
                let pixel = [column * BLOCK + i, row * BLOCK + j];
                if pixel[0] < camera.width as usize && pixel[1] < camera.height as usize {
                    let [u, v] = if is_blended {
                        blend(&four, [i, j].map(|k| (k as f64 + 0.5) / BLOCK as f64))
                    } else {
                        ray(pixel[0] as f64 + 0.5, pixel[1] as f64 + 0.5)
                    };
                    (xs[lane], ys[lane]) = (u as f32, v as f32);
                }
            }
            (xs, ys)
        };
        let (x, y) = (0..columns * rows).into_par_iter().map(block).unzip();
        let mut rays = Self { columns, rows, bounds: Bounds::NONE, x, y };
        rays.bounds = rays.bounds_of(0..columns, 0..rows);
        rays
    }

    /// Rays of a block.
    #[inline(always)]
    pub(crate) fn block(&self, column: usize, row: usize) -> (&[f32; LANES], &[f32; LANES]) {
        let index = row * self.columns + column;
        (&self.x[index], &self.y[index])
    }

    /// Bounds of the rays of some blocks.
    pub(crate) fn bounds_of(&self, columns: Range<usize>, rows: Range<usize>) -> Bounds {
        let mut bounds = Bounds::NONE;
        for row in rows {
            for column in columns.clone() {
                let (x, y) = self.block(column, row);
                for (axis, values) in [x, y].into_iter().enumerate() {
                    // NaN is passed over by min and max.
                    for &v in values {
                        bounds.low[axis] = bounds.low[axis].min(v);
                        bounds.high[axis] = bounds.high[axis].max(v);
                    }
                }
            }
        }
        bounds
    }
}

/// Whether the rays between a block's corners blend to less than [`MAX_BLEND_ERROR_PX`]: nearly
/// everywhere, and Newton's method need not run for every pixel.
fn is_bilinear(camera: &Camera, corners: &[[f64; 2]; 4], block: [usize; 2]) -> bool {
    let [x, y] = blend(corners, [0.5; 2]);
    let [u, v] = block.map(|b| (b * BLOCK + BLOCK / 2) as f64);
    let back = camera.pixel_from_normalized(&Vector2::new(x, y));
    // False for NaN.
    (back - Point2::new(u, v)).norm() < MAX_BLEND_ERROR_PX
}

fn blend(corners: &[[f64; 2]; 4], [fx, fy]: [f64; 2]) -> [f64; 2] {
    std::array::from_fn(|k| {
        let top = corners[0][k] + fx * (corners[1][k] - corners[0][k]);
        let bottom = corners[2][k] + fx * (corners[3][k] - corners[2][k]);
        top + fy * (bottom - top)
    })
}
