//! Which surfaces a small part of an image can show.

use nalgebra::{Isometry3, Vector3};

use crate::hall::Surface;

/// A surface as one camera sees it.
///
/// With a ray `(x, y, 1)` in the camera frame, `1 / z`, `u / z` and `v / z` of the surface are
/// linear in the ray: three dot products and no division decide visibility exactly.
pub(crate) struct View {
    inverse_depth: Vector3<f64>,
    u: Vector3<f64>,
    v: Vector3<f64>,
    width: f64,
    height: f64,
    corners: [Vector3<f64>; 4],
    pub(crate) surface: u32,
}

/// Region of rays: x from `min[0]` to `max[0]`, y from `min[1]` to `max[1]`, z = 1.
#[derive(Clone, Copy)]
pub(crate) struct Region {
    pub(crate) min: [f64; 2],
    pub(crate) max: [f64; 2],
}

/// Where a ray meets a surface.
#[derive(Clone, Copy)]
pub(crate) struct Hit {
    /// Index into the views.
    pub(crate) view: u32,
    pub(crate) inverse_depth: f64,
}

pub(crate) const MISS: Hit = Hit { view: u32::MAX, inverse_depth: 0.0 };

impl View {
    /// `None` for surfaces that face away.
    pub(crate) fn new(
        surface: &Surface,
        index: usize,
        cam_from_world: &Isometry3<f64>,
    ) -> Option<Self> {
        let origin = (cam_from_world * surface.origin).coords;
        let turn = |v: &Vector3<f64>| cam_from_world.rotation * v;
        let (u, v, n) = (turn(&surface.u), turn(&surface.v), turn(&surface.normal));
        let offset = n.dot(&origin);
        if offset >= -1e-9 {
            return None;
        }
        // z = offset / (n · ray), u = z (u · ray) − u · origin.
        let inverse_depth = n / offset;
        let edges = [
            (0.0, 0.0),
            (surface.width, 0.0),
            (surface.width, surface.height),
            (0.0, surface.height),
        ];
        Some(Self {
            inverse_depth,
            u: u - inverse_depth * u.dot(&origin),
            v: v - inverse_depth * v.dot(&origin),
            width: surface.width,
            height: surface.height,
            corners: edges.map(|(a, b)| origin + u * a + v * b),
            surface: index as u32,
        })
    }

    /// Inverse depth along a ray if the ray meets the rectangle.
    fn meet(&self, x: f64, y: f64) -> Option<f64> {
        let w = dot(&self.inverse_depth, x, y);
        let (u, v) = (dot(&self.u, x, y), dot(&self.v, x, y));
        (w > 0.0 && u >= 0.0 && v >= 0.0 && u <= self.width * w && v <= self.height * w)
            .then_some(w)
    }

    /// Position on the plane of the surface, meters, also outside of the rectangle.
    pub(crate) fn position(&self, x: f64, y: f64) -> [f64; 2] {
        let z = 1.0 / dot(&self.inverse_depth, x, y);
        [dot(&self.u, x, y) * z, dot(&self.v, x, y) * z]
    }

    /// Whether the rectangle may be seen in a region: no side plane of it has all corners outside.
    pub(crate) fn may_show(&self, region: &Region) -> bool {
        let all = |outside: &dyn Fn(&Vector3<f64>) -> bool| self.corners.iter().all(outside);
        !(all(&|c| c.z <= 0.0)
            || all(&|c| c.x < region.min[0] * c.z)
            || all(&|c| c.x > region.max[0] * c.z)
            || all(&|c| c.y < region.min[1] * c.z)
            || all(&|c| c.y > region.max[1] * c.z))
    }

    /// Least and greatest inverse depth of the plane in a region; linear, so the corners decide.
    fn inverse_depth_range(&self, region: &Region) -> [f64; 2] {
        let mut range = [f64::INFINITY, f64::NEG_INFINITY];
        for (x, y) in region.corners() {
            let w = dot(&self.inverse_depth, x, y);
            range = [range[0].min(w), range[1].max(w)];
        }
        range
    }

    fn covers(&self, region: &Region) -> bool {
        region.corners().iter().all(|&(x, y)| self.meet(x, y).is_some())
    }
}

impl Region {
    fn corners(&self) -> [(f64, f64); 4] {
        let ([x0, y0], [x1, y1]) = (self.min, self.max);
        [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    }
}

/// Views that a region may show, nearest planes first, without those hidden behind one that
/// covers it all.
pub(crate) fn candidates(views: &[View], among: &[u32], region: &Region) -> Vec<u32> {
    let mut shown: Vec<(u32, [f64; 2])> = Vec::new();
    let mut hidden_below = 0.0_f64;
    for &index in among {
        let view = &views[index as usize];
        if view.may_show(region) {
            let range = view.inverse_depth_range(region);
            if view.covers(region) {
                hidden_below = hidden_below.max(range[0]);
            }
            shown.push((index, range));
        }
    }
    shown.retain(|(_, range)| range[1] >= hidden_below);
    shown.sort_by(|a, b| b.1[1].total_cmp(&a.1[1]).then(a.0.cmp(&b.0)));
    shown.into_iter().map(|(index, _)| index).collect()
}

/// The nearest of the candidates along a ray.
pub(crate) fn nearest(views: &[View], candidates: &[u32], x: f64, y: f64) -> Hit {
    let mut hit = MISS;
    for &index in candidates {
        if let Some(inverse_depth) = views[index as usize].meet(x, y)
            && inverse_depth > hit.inverse_depth
        {
            hit = Hit { view: index, inverse_depth };
        }
    }
    hit
}

fn dot(a: &Vector3<f64>, x: f64, y: f64) -> f64 {
    a.x * x + a.y * y + a.z
}
