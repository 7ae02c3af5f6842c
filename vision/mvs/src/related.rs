//! Depth maps that show the same, and where the pixels of one land in another.

use nalgebra::{Matrix3, Vector3};
use volery_scene::DepthMap;

use crate::source::Transfer;

/// Pixels per row and column of the grid on which maps are compared.
const GRID: usize = 16;
/// Relative difference of depth up to which neighboring pixels show one surface.
const SMOOTH: f32 = 0.02;
/// Relative difference of depth within which two maps see the same surface.
pub(crate) const SAME_DEPTH: f32 = 0.01;
/// Least cosine between the normals of one surface in two maps.
const SAME_NORMAL_COS: f32 = 0.5;
/// Part of the grid that another map has to show.
const MIN_SHOWN: f64 = 0.03;

/// Another depth map seen from a map.
#[derive(Debug, Clone)]
pub(crate) struct Related<'a> {
    pub(crate) map: &'a DepthMap,
    from_own: Transfer,
    to_own: Transfer,
    rotation_from_own: Matrix3<f32>,
}

/// Where a surface point lands in another map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Landing {
    /// Index of the pixel.
    pub(crate) pixel: usize,
    /// Depth of the point, seen from there.
    pub(crate) depth: f32,
    /// Depth that the map has there, between its pixels where they show one surface.
    pub(crate) known: f32,
}

impl Landing {
    /// Between the depths, relative to the map's.
    pub(crate) fn difference(&self) -> f32 {
        (self.depth - self.known).abs() / self.known
    }
}

impl<'a> Related<'a> {
    fn new(own: &DepthMap, map: &'a DepthMap) -> Self {
        let other_from_own = map.cam_from_world * own.cam_from_world.inverse();
        Self {
            map,
            from_own: Transfer::new(&own.camera, &map.camera, &other_from_own),
            to_own: Transfer::new(&map.camera, &own.camera, &other_from_own.inverse()),
            rotation_from_own: other_from_own.rotation.to_rotation_matrix().matrix().cast(),
        }
    }

    /// Where pixel `index` of `own` with its depth lands, `None` where the other map knows nothing.
    pub(crate) fn landing(&self, own: &DepthMap, index: usize) -> Option<Landing> {
        let w = 1.0 / own.depth[index];
        let (u, v) = ((index % own.width()) as f32 + 0.5, (index / own.width()) as f32 + 0.5);
        let [x, y, z] = self.from_own.apply(u, v, w);
        let (x, y) = (x / z, y / z);
        let (width, height) = (self.map.width(), self.map.height());
        let inside = z > 0.0 && x >= 0.0 && y >= 0.0 && x < width as f32 && y < height as f32;
        if !inside {
            return None;
        }
        let pixel = y as usize * width + x as usize;
        let is_known = self.map.depth[pixel] > 0.0;
        is_known.then(|| Landing { pixel, depth: z / w, known: depth_at(self.map, pixel, x, y) })
    }

    /// Whether a pixel with `normal` and its landing agree in normal, and in depth but for the part
    /// `slack`.
    #[inline]
    pub(crate) fn is_same_surface(
        &self,
        normal: &Vector3<f32>,
        landing: &Landing,
        slack: f32,
    ) -> bool {
        landing.difference() <= slack && {
            let theirs = Vector3::from(self.map.normals[landing.pixel]);
            (self.rotation_from_own * normal).dot(&theirs) > SAME_NORMAL_COS
        }
    }

    /// Pixels between the own pixel and where it comes back to by the other map's depth.
    pub(crate) fn round_trip_px(&self, own: &DepthMap, index: usize, landing: &Landing) -> f32 {
        let (u, v) = ((index % own.width()) as f32 + 0.5, (index / own.width()) as f32 + 0.5);
        // The exact landing, not the center of its pixel: the surface is near enough the same.
        let [x, y, z] = self.from_own.apply(u, v, 1.0 / own.depth[index]);
        let [bx, by, bz] = self.to_own.apply(x / z, y / z, 1.0 / landing.known);
        (bx / bz - u).hypot(by / bz - v)
    }
}

/// The depth of `map` at an image position within `pixel`: between the four pixels around it if
/// they show one surface, else the pixel's own.
fn depth_at(map: &DepthMap, pixel: usize, x: f32, y: f32) -> f32 {
    let own = map.depth[pixel];
    let (x, y) = ((x - 0.5).max(0.0), (y - 0.5).max(0.0));
    let (left, top) = (x as usize, y as usize);
    if left + 1 >= map.width() || top + 1 >= map.height() {
        return own;
    }
    let first = top * map.width() + left;
    let [a, b, c, d] =
        [first, first + 1, first + map.width(), first + map.width() + 1].map(|k| map.depth[k]);
    if [a, b, c, d].iter().any(|depth| (depth - own).abs() > SMOOTH * own) {
        return own;
    }
    let (fx, fy) = (x - left as f32, y - top as f32);
    let (upper, lower) = (a + fx * (b - a), c + fx * (d - c));
    upper + fy * (lower - upper)
}

/// The surface of a pixel as several maps have it: the means of their depths, along the ray of the
/// first, and of their normals. Each is weighed by how large it shows the surface, as its error
/// grows with the size of its pixels.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SharedSurface {
    own: f32,
    own_footprint: f32,
    sum: f32,
    weights: f32,
    normals: Vector3<f32>,
}

impl SharedSurface {
    /// As the first map has it.
    pub(crate) fn new(map: &DepthMap, index: usize, normal: &Vector3<f32>) -> Self {
        let own = map.depth[index];
        let own_footprint = footprint(map, own);
        Self { own, own_footprint, sum: own, weights: 1.0, normals: *normal }
    }

    /// Hears another map, `part` of which counts.
    pub(crate) fn hear(&mut self, other: &Related<'_>, landing: &Landing, part: f32) {
        let weight = part * (self.own_footprint / footprint(other.map, landing.known)).powi(2);
        self.sum += weight * self.own * landing.known / landing.depth;
        self.weights += weight;
        let normal = Vector3::from(other.map.normals[landing.pixel]);
        self.normals += weight * other.rotation_from_own.tr_mul(&normal);
    }

    /// Seen from the first map.
    pub(crate) fn depth(&self) -> f32 {
        self.sum / self.weights
    }

    /// In the frame of the first map's camera.
    pub(crate) fn normal(&self) -> Vector3<f32> {
        self.normals.normalize()
    }
}

/// Width of a pixel on a surface at `depth` that faces the camera.
pub(crate) fn footprint(map: &DepthMap, depth: f32) -> f32 {
    depth / map.camera.focal().x as f32
}

/// Up to `max` of the `others` that show most of the same as `own`, the closest first; `own` itself
/// is none of them.
pub(crate) fn related<'a>(
    own: &DepthMap,
    others: impl Iterator<Item = &'a DepthMap>,
    max: usize,
) -> Vec<Related<'a>> {
    let mut relations: Vec<(usize, Related<'a>)> = others
        .filter(|other| other.image != own.image)
        .map(|other| {
            let relation = Related::new(own, other);
            (num_shown(own, &relation), relation)
        })
        .filter(|&(shown, _)| shown as f64 > MIN_SHOWN * (GRID * GRID) as f64)
        .collect();
    relations.sort_by_key(|(shown, relation)| (std::cmp::Reverse(*shown), relation.map.image));
    relations.truncate(max);
    relations.into_iter().map(|(_, relation)| relation).collect()
}

/// Pixels of a grid over `own` that the other shows at about the same depth.
fn num_shown(own: &DepthMap, relation: &Related<'_>) -> usize {
    /// Relative difference of depth that says nothing against the same surface.
    const SAME: f32 = 0.1;
    let at = |k: usize, size: usize| (2 * k + 1) * size / (2 * GRID);
    let grid = (0..GRID).flat_map(|j| (0..GRID).map(move |i| (i, j)));
    grid.filter(|&(i, j)| {
        let index = at(j, own.height()) * own.width() + at(i, own.width());
        own.depth[index] > 0.0
            && relation.landing(own, index).is_some_and(|l| l.difference() < SAME)
    })
    .count()
}
