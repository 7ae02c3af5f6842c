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

/// A pixel of a map with its depth, which asks other maps.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Seen {
    u: f32,
    v: f32,
    depth: f32,
}

impl Seen {
    /// Pixel `index` of `map`, whose depth is known.
    pub(crate) fn of(map: &DepthMap, index: usize) -> Self {
        let (row, column) = (index / map.width(), index % map.width());
        Self { u: column as f32 + 0.5, v: row as f32 + 0.5, depth: map.depth[index] }
    }
}

/// Another depth map seen from a map.
#[derive(Debug, Clone)]
pub(crate) struct Related<'a> {
    pub(crate) map: &'a DepthMap,
    from_own: Transfer,
    to_own: Transfer,
    rotation_to_own: Matrix3<f32>,
}

/// Where a surface point lands in another map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Landing {
    /// Index of the pixel.
    pub(crate) pixel: usize,
    /// Position in that map's image.
    position: [f32; 2],
    /// Depth of the point, seen from there.
    pub(crate) depth: f32,
    /// Depth that the map has there, between its pixels where they show one surface.
    pub(crate) known: f32,
}

impl Landing {
    /// Whether the depths differ by at most the part `slack` of the map's.
    fn is_at(&self, slack: f32) -> bool {
        (self.depth - self.known).abs() <= slack * self.known
    }
}

/// What another map says of a surface.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Witness {
    /// Relative to the depth of the pixel that asked.
    depth: f32,
    /// Unit vector in the frame of the camera that asked.
    normal: Vector3<f32>,
    /// Width of a pixel there, see [`footprint`].
    footprint: f32,
    /// Whether its depth is the same.
    pub(crate) is_same_depth: bool,
}

impl<'a> Related<'a> {
    fn new(own: &DepthMap, map: &'a DepthMap) -> Self {
        let other_from_own = map.cam_from_world * own.cam_from_world.inverse();
        let own_from_other = other_from_own.inverse();
        Self {
            map,
            from_own: Transfer::new(&own.camera, &map.camera, &other_from_own),
            to_own: Transfer::new(&map.camera, &own.camera, &own_from_other),
            rotation_to_own: own_from_other.rotation.to_rotation_matrix().matrix().cast(),
        }
    }

    /// Where a pixel lands, `None` where the other map knows nothing.
    pub(crate) fn landing(&self, seen: &Seen) -> Option<Landing> {
        let [x, y, z] = self.from_own.apply(seen.u, seen.v, 1.0 / seen.depth);
        let (x, y) = (x / z, y / z);
        let (width, height) = (self.map.width(), self.map.height());
        let inside = z > 0.0 && x >= 0.0 && y >= 0.0 && x < width as f32 && y < height as f32;
        if !inside {
            return None;
        }
        let pixel = y as usize * width + x as usize;
        let is_known = self.map.depth[pixel] > 0.0;
        is_known.then(|| Landing {
            pixel,
            position: [x, y],
            depth: z * seen.depth,
            known: depth_at(self.map, pixel, x, y),
        })
    }

    /// What the map says where a pixel with `normal` lands, if that is the same surface: the normals
    /// agree, and the depths but for the part `slack`.
    #[inline]
    pub(crate) fn witness(
        &self,
        normal: &Vector3<f32>,
        landing: &Landing,
        slack: f32,
    ) -> Option<Witness> {
        if !landing.is_at(slack) {
            return None;
        }
        let theirs = self.rotation_to_own * Vector3::from(self.map.normals[landing.pixel]);
        (theirs.dot(normal) > SAME_NORMAL_COS).then(|| Witness {
            depth: landing.known / landing.depth,
            normal: theirs,
            footprint: footprint(self.map, landing.known),
            is_same_depth: landing.is_at(SAME_DEPTH),
        })
    }

    /// Whether a pixel comes back to itself, but for `slack` pixels, by the other map's depth.
    pub(crate) fn comes_back(&self, seen: &Seen, landing: &Landing, slack: f32) -> bool {
        let [x, y] = landing.position;
        let [x, y, z] = self.to_own.apply(x, y, 1.0 / landing.known);
        (x / z - seen.u).powi(2) + (y / z - seen.v).powi(2) < slack * slack
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
    own_footprint: f32,
    depths: f32,
    normals: Vector3<f32>,
    weights: f32,
}

impl SharedSurface {
    /// As the first map has it.
    pub(crate) fn new(map: &DepthMap, index: usize, normal: &Vector3<f32>) -> Self {
        let own_footprint = footprint(map, map.depth[index]);
        Self { own_footprint, depths: 1.0, normals: *normal, weights: 1.0 }
    }

    /// Hears another map, `part` of which counts.
    pub(crate) fn hear(&mut self, witness: &Witness, part: f32) {
        let weight = part * (self.own_footprint / witness.footprint).powi(2);
        self.depths += weight * witness.depth;
        self.normals += weight * witness.normal;
        self.weights += weight;
    }

    /// Relative to the first map's.
    pub(crate) fn depth(&self) -> f32 {
        self.depths / self.weights
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
            && relation.landing(&Seen::of(own, index)).is_some_and(|l| l.is_at(SAME))
    })
    .count()
}
