//! Photos onto charts.

use nalgebra::{Point2, Point3};
use rayon::prelude::*;
use volery_scene::{Photo, Photos, Progress, Stage, Texture, TriangleMesh};

use super::charts::Chart;
use super::packing::Layout;
use super::view::View;
use crate::MeshingError;

/// Texels so far outside of a triangle are painted with it, so that none at its border mixes with
/// the background.
const MARGIN: f64 = 1.0;

/// A texture with what is painted of it.
pub(super) struct Canvas {
    pub(super) texture: Texture,
    pub(super) painted: Vec<bool>,
}

/// A texel of a chart: where it lies in the chart, its triangle, and the weights of the corners.
pub(super) struct Texel {
    pub(super) at: [u32; 2],
    pub(super) triangle: u32,
    pub(super) weights: [f64; 3],
}

impl Canvas {
    /// Paints all charts. Each photo is asked for once, and only if a chart shows it.
    pub(super) fn paint(
        mesh: &TriangleMesh,
        views: &[View],
        charts: &[Chart],
        layout: &Layout,
        photos: &dyn Photos,
        progress: &dyn Progress,
    ) -> Result<Self, MeshingError> {
        let num_texels = layout.width as usize * layout.height as usize;
        let mut canvas = Self {
            texture: Texture {
                width: layout.width,
                height: layout.height,
                pixels: vec![[0; 3]; num_texels],
            },
            painted: vec![false; num_texels],
        };
        let mut of_view = vec![Vec::new(); views.len()];
        for (index, chart) in charts.iter().enumerate() {
            of_view[chart.view as usize].push(index);
        }
        for (number, (view, indices)) in views.iter().zip(&of_view).enumerate() {
            progress.check()?;
            if !indices.is_empty() {
                let photo = load(photos, view)?;
                let patches: Vec<_> = indices
                    .par_iter()
                    .map(|&i| patch(mesh, view, &charts[i], layout, &photo))
                    .collect();
                for (&i, patch) in indices.iter().zip(patches) {
                    canvas.put(layout.places[i], &patch);
                }
            }
            progress.report(Stage::Texturing, views.len() + number + 1, 2 * views.len());
        }
        Ok(canvas)
    }

    pub(super) fn put(&mut self, [x, y]: [u32; 2], patch: &[([u32; 2], [u8; 3])]) {
        for &([dx, dy], color) in patch {
            let index = self.index(x + dx, y + dy);
            self.texture.pixels[index] = color;
            self.painted[index] = true;
        }
    }

    /// Between the four texels around a position.
    pub(super) fn color_at(&self, at: &Point2<f64>) -> [f64; 3] {
        let (width, height) = (self.texture.width as usize, self.texture.height as usize);
        between(at, width, height, |x, y| self.texture.pixels[y * width + x])
    }

    pub(super) fn index(&self, x: u32, y: u32) -> usize {
        y as usize * self.texture.width as usize + x as usize
    }
}

fn load(photos: &dyn Photos, view: &View) -> Result<Photo, MeshingError> {
    let image = view.image;
    let photo = photos.photo(image).ok_or(MeshingError::NoPhoto { image })?;
    let num_pixels = photo.gray.pixels().len();
    let is_of_camera =
        (photo.gray.width(), photo.gray.height()) == (view.camera.width, view.camera.height);
    if !is_of_camera || photo.colors.as_ref().is_some_and(|colors| colors.len() != num_pixels) {
        return Err(MeshingError::WrongSize { image });
    }
    Ok(photo)
}

/// The texels of a chart that lie in its triangles or within [`MARGIN`] of one.
pub(super) fn texels(chart: &Chart, layout: &Layout) -> Vec<Texel> {
    let [width, height] = layout.size(chart);
    let positions = layout.all_in_chart(chart);
    // Distance to the nearest side of the owner, and the owner.
    let mut owners = vec![(-MARGIN, u32::MAX); width as usize * height as usize];
    for (number, corners) in chart.triangles.iter().enumerate() {
        let [a, b, c] = corners.map(|v| positions[v as usize]);
        let area = (b - a).perp(&(c - a));
        let low = a.inf(&b).inf(&c).map(|v| (v - MARGIN).floor().max(0.0) as u32);
        let high = a.sup(&b).sup(&c).map(|v| (v + MARGIN).ceil() as u32);
        for y in low.y..high.y.min(height) {
            for x in low.x..high.x.min(width) {
                let p = Point2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                let inside = [(a, b), (b, c), (c, a)]
                    .map(|(p0, p1)| {
                        let side = p1 - p0;
                        side.perp(&(p - p0)) * area.signum() / side.norm().max(f64::MIN_POSITIVE)
                    })
                    .into_iter()
                    .fold(f64::INFINITY, f64::min);
                let owner = &mut owners[(y * width + x) as usize];
                if inside > owner.0 {
                    *owner = (inside, number as u32);
                }
            }
        }
    }
    let owned = owners.iter().enumerate().filter(|(_, (_, triangle))| *triangle != u32::MAX);
    owned
        .map(|(index, &(_, triangle))| {
            let at = [index as u32 % width, index as u32 / width];
            let corners = chart.triangles[triangle as usize].map(|v| positions[v as usize]);
            let texel = Point2::new(f64::from(at[0]) + 0.5, f64::from(at[1]) + 0.5);
            Texel { at, triangle, weights: barycentric(&corners, &texel) }
        })
        .collect()
}

/// Weights of the corners at a point, which may lie outside.
fn barycentric([a, b, c]: &[Point2<f64>; 3], p: &Point2<f64>) -> [f64; 3] {
    let area = (b - a).perp(&(c - a));
    let [wb, wc] = [(p - a).perp(&(c - a)) / area, (b - a).perp(&(p - a)) / area];
    // The margin of a needle lies far outside of it.
    let weights = [1.0 - wb - wc, wb, wc].map(|w| w.clamp(-1.0, 2.0));
    if weights.iter().all(|w| w.is_finite()) { weights } else { [1.0, 0.0, 0.0] }
}

/// Colors of a chart's texels.
fn patch(
    mesh: &TriangleMesh,
    view: &View,
    chart: &Chart,
    layout: &Layout,
    photo: &Photo,
) -> Vec<([u32; 2], [u8; 3])> {
    let positions = layout.all_in_chart(chart);
    // A texel that covers several pixels is their mean.
    let per_side = (1.0 / layout.scale - 1e-9).ceil().max(1.0) as u32;
    let color = |texel: Texel| {
        let corners = chart.triangles[texel.triangle as usize];
        let in_texture = corners.map(|v| positions[v as usize]);
        let in_space = corners.map(|v| mesh.vertices[chart.vertices[v as usize] as usize]);
        let mut sum = [0.0; 3];
        for step in 0..per_side * per_side {
            let offset = |step: u32| (f64::from(step) + 0.5) / f64::from(per_side);
            let at = Point2::new(
                f64::from(texel.at[0]) + offset(step % per_side),
                f64::from(texel.at[1]) + offset(step / per_side),
            );
            let weights = barycentric(&in_texture, &at);
            let point = blend(&in_space, weights);
            let pixel = view.project(&point).map_or_else(Point2::origin, |(pixel, _)| pixel);
            sum.iter_mut().zip(bilinear(photo, &pixel)).for_each(|(sum, v)| *sum += v);
        }
        let scale = 1.0 / f64::from(per_side * per_side);
        (texel.at, sum.map(|v| (v * scale).round() as u8))
    };
    texels(chart, layout).into_iter().map(color).collect()
}

fn blend(corners: &[Point3<f64>; 3], weights: [f64; 3]) -> Point3<f64> {
    let [a, b, c] = corners;
    a + (b - a) * weights[1] + (c - a) * weights[2]
}

/// Color at an image position between the centers of four pixels.
fn bilinear(photo: &Photo, pixel: &Point2<f64>) -> [f64; 3] {
    let (width, height) = (photo.gray.width() as usize, photo.gray.height() as usize);
    between(pixel, width, height, |x, y| photo.color(y * width + x))
}

/// Mean of the four texels around a position.
pub(super) fn between(
    at: &Point2<f64>,
    width: usize,
    height: usize,
    color: impl Fn(usize, usize) -> [u8; 3],
) -> [f64; 3] {
    let [(x0, x1, fx), (y0, y1, fy)] = [(at.x, width), (at.y, height)].map(|(v, size)| {
        let v = (v - 0.5).clamp(0.0, (size - 1) as f64);
        let low = v as usize;
        (low, (low + 1).min(size - 1), v - low as f64)
    });
    let [a, b, c, d] = [(x0, y0), (x1, y0), (x0, y1), (x1, y1)].map(|(x, y)| color(x, y));
    std::array::from_fn(|k| {
        let [a, b, c, d] = [a[k], b[k], c[k], d[k]].map(f64::from);
        (a * (1.0 - fx) + b * fx) * (1.0 - fy) + (c * (1.0 - fx) + d * fx) * fy
    })
}
