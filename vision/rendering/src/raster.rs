//! Which triangle each pixel sees.

use nalgebra::{Isometry3, Matrix3, Vector3};

use crate::clip::clip;
use crate::frame::Band;
use crate::mesh::{CLUSTER, Cluster};
use crate::simd::LANES;
use crate::triangle::Triangle;
use crate::virtual_camera::{BAND_ROWS, Bounds};
use crate::{DrawableMesh, VirtualCamera};

/// From the mesh's axes around its origin to the camera.
pub(crate) struct View {
    rotation: Matrix3<f32>,
    translation: Vector3<f32>,
}

impl View {
    pub(crate) fn new(mesh: &DrawableMesh, cam_from_world: &Isometry3<f64>) -> Self {
        Self {
            rotation: cam_from_world.rotation.to_rotation_matrix().into_inner().cast(),
            translation: (cam_from_world * mesh.origin).coords.cast(),
        }
    }

    /// Clusters that may be seen within `bounds`.
    pub(crate) fn clusters_in(&self, mesh: &DrawableMesh, bounds: &Bounds, near: f32) -> Vec<u32> {
        let all = 0..mesh.clusters.len() as u32;
        all.filter(|&c| self.may_show(&mesh.clusters[c as usize], bounds, near)).collect()
    }

    /// Whether a cluster's box reaches into the pyramid of rays within `bounds`.
    fn may_show(&self, cluster: &Cluster, bounds: &Bounds, near: f32) -> bool {
        let middle = self.rotation * cluster.middle + self.translation;
        let planes = [
            (Vector3::z(), near),
            (Vector3::new(1.0, 0.0, -bounds.low[0]), 0.0),
            (Vector3::new(-1.0, 0.0, bounds.high[0]), 0.0),
            (Vector3::new(0.0, 1.0, -bounds.low[1]), 0.0),
            (Vector3::new(0.0, -1.0, bounds.high[1]), 0.0),
        ];
        // A hair wider than rounding errs.
        let slack = 1e-5 * (middle.abs().max() + cluster.half.max());
        planes.iter().all(|(normal, offset)| {
            let reach = self.rotation.tr_mul(normal).abs().dot(&cluster.half);
            normal.dot(&middle) + reach + slack * normal.abs().max() >= *offset
        })
    }

    /// A position of the mesh in the camera frame.
    #[inline(always)]
    pub(crate) fn in_cam(&self, position: [f32; 3]) -> [f32; 3] {
        let [x, y, z] = position;
        let (r, t) = (&self.rotation, &self.translation);
        std::array::from_fn(|k| r[(k, 0)] * x + r[(k, 1)] * y + r[(k, 2)] * z + t[k])
    }
}

/// A cluster's vertices in the camera frame and projected.
struct Vertices {
    in_cam: [[f32; CLUSTER]; 3],
    projected: [[f32; CLUSTER]; 3],
}

impl Vertices {
    const EMPTY: Self = Self { in_cam: [[0.0; CLUSTER]; 3], projected: [[0.0; CLUSTER]; 3] };

    #[inline(always)]
    fn fill(&mut self, cluster: &Cluster, view: &View) {
        let [xs, ys, zs] = &cluster.positions;
        let chunks = xs.chunks_exact(LANES).zip(ys.chunks_exact(LANES)).zip(zs.chunks_exact(LANES));
        for (chunk, ((xs, ys), zs)) in chunks.enumerate() {
            let start = chunk * LANES;
            for lane in 0..LANES {
                let p = view.in_cam([xs[lane], ys[lane], zs[lane]]);
                let w = 1.0 / p[2];
                let at = start + lane;
                self.in_cam[0][at] = p[0];
                self.in_cam[1][at] = p[1];
                self.in_cam[2][at] = p[2];
                self.projected[0][at] = p[0] * w;
                self.projected[1][at] = p[1] * w;
                self.projected[2][at] = w;
            }
        }
    }
}

/// Draws the triangles of `shown` clusters into a band: inverse depths and numbers.
#[inline(always)]
pub(crate) fn raster(
    mesh: &DrawableMesh,
    view: &View,
    shown: &[u32],
    eye: &VirtualCamera,
    band: &mut Band,
) {
    let bounds = &eye.bands[band.rows.start / BAND_ROWS];
    let mut vertices = Vertices::EMPTY;
    for &index in shown {
        let cluster = &mesh.clusters[index as usize];
        if !view.may_show(cluster, bounds, eye.near) {
            continue;
        }
        vertices.fill(cluster, view);
        for (number, corners) in cluster.corners.iter().enumerate() {
            let id = cluster.first + number as u32;
            let corners = corners.map(usize::from);
            let z = corners.map(|v| vertices.in_cam[2][v]);
            if z.iter().all(|&z| z >= eye.near) {
                let projected = corners.map(|v| {
                    let [x, y, w] = &vertices.projected;
                    [x[v], y[v], w[v]].map(f64::from)
                });
                if let Some(triangle) = Triangle::new(projected, &eye.finder) {
                    fill(&triangle, id, eye, band);
                }
            } else if z.iter().any(|&z| z >= eye.near) {
                let in_cam = corners.map(|v| {
                    let [x, y, z] = &vertices.in_cam;
                    [x[v], y[v], z[v]].map(f64::from)
                });
                for part in clip(in_cam, f64::from(eye.near)) {
                    if let Some(triangle) = Triangle::new(part, &eye.finder) {
                        fill(&triangle, id, eye, band);
                    }
                }
            }
        }
    }
}

/// Draws a triangle where it is in front of what is there.
#[inline(always)]
fn fill(triangle: &Triangle, id: u32, eye: &VirtualCamera, band: &mut Band) {
    let [c0, c1, r0, r1] = triangle.blocks.map(usize::from);
    let [low, high] = triangle.range;
    let [e0, e1, e2] = triangle.edges;
    let depth = triangle.inverse_depth;
    for row in r0.max(band.rows.start)..(r1 + 1).min(band.rows.end) {
        for column in c0..=c1 {
            let (x, y) = eye.rays.block(column, row);
            let at = (row - band.rows.start) * band.columns + column;
            let (stored, ids) = (&mut band.inverse_depth[at], &mut band.ids[at]);
            for lane in 0..LANES {
                let (x, y) = (x[lane], y[lane]);
                let at = |[a, b, c]: [f32; 3]| a * x + b * y + c;
                let w = at(depth).max(low).min(high);
                // Bitwise, so that lanes need no branches; NaN is never inside.
                let inside = (at(e0) >= 0.0) & (at(e1) >= 0.0) & (at(e2) >= 0.0);
                let wins = inside & (w > stored[lane]);
                stored[lane] = if wins { w } else { stored[lane] };
                ids[lane] = if wins { id } else { ids[lane] };
            }
        }
    }
}

const _: () = assert!(CLUSTER.is_multiple_of(LANES));
