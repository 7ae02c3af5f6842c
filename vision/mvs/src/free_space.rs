//! Air, surfaces and what nobody saw, from depth maps.

use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;
use volery_scene::{DepthMap, Occupancy, OccupancyGrid};

use crate::depth_pyramid::DepthPyramid;

/// Depth maps that have to see through a voxel for it to be free.
const MIN_VIEWS_THROUGH: u8 = 2;
/// Depth maps that have to see a surface in a voxel for it to be occupied; with fewer, but any, it
/// is neither free nor occupied.
const MIN_VIEWS_OF_SURFACE: u8 = 2;
/// Relative error of a depth against which a voxel in front of it is safe.
const DEPTH_ERROR: f64 = 0.02;
/// Least part of the pixels over a voxel that has a depth.
const MIN_KNOWN: f64 = 0.8;

/// Collects what depth maps say of a box of voxels.
///
/// A voxel is free if [`MIN_VIEWS_THROUGH`] maps see all of it in front of measured surfaces. What
/// was inferred counts as a surface, but nothing is free because of it.
#[derive(Debug, Clone)]
pub struct SpaceCarver {
    grid: OccupancyGrid,
    low: Point3<f64>,
    /// Per voxel, maps that see through it and maps with a surface in it.
    through: Vec<u8>,
    surface: Vec<u8>,
}

impl SpaceCarver {
    /// For the box between two corners; `None` unless it and `voxel` are sound.
    pub fn new(low: Point3<f64>, high: Point3<f64>, voxel: f64) -> Option<Self> {
        let sides = (high - low) / voxel;
        let sound = sides.iter().all(|side| *side > 0.0 && *side < 1e5);
        let size = [sides.x, sides.y, sides.z].map(|side| side.ceil() as usize);
        let grid = sound.then(|| {
            OccupancyGrid::unseen(Isometry3::translation(low.x, low.y, low.z), voxel, size)
        })??;
        let votes = vec![0; grid.states().len()];
        Some(Self { grid, low, through: votes.clone(), surface: votes })
    }

    /// What one more map says.
    pub fn add(&mut self, map: &DepthMap) {
        self.add_surface(map);
        let view = View::new(map, self.low, self.grid.voxel());
        let [nx, ny, nz] = self.grid.size();
        let pyramid = DepthPyramid::new(map);
        let Some(reach) = pyramid.max_depth() else { return };
        let rows = view.box_of_frustum(f64::from(reach), [nx, ny, nz]);
        self.through.par_chunks_mut(nx * ny).enumerate().for_each(|(z, layer)| {
            if !rows[2].contains(&z) {
                return;
            }
            for y in rows[1].clone() {
                for x in rows[0].clone() {
                    let votes = &mut layer[y * nx + x];
                    if *votes < MIN_VIEWS_THROUGH && view.sees_through([x, y, z], &pyramid) {
                        *votes += 1;
                    }
                }
            }
        });
    }

    /// The states that the maps agree on.
    pub fn finish(self) -> OccupancyGrid {
        let mut grid = self.grid;
        let votes = self.through.iter().zip(&self.surface);
        for (state, (&through, &surface)) in grid.states_mut().iter_mut().zip(votes) {
            *state = if surface >= MIN_VIEWS_OF_SURFACE {
                Occupancy::Occupied
            } else if surface == 0 && through >= MIN_VIEWS_THROUGH {
                Occupancy::Free
            } else {
                Occupancy::Unseen
            };
        }
        grid
    }

    fn add_surface(&mut self, map: &DepthMap) {
        let world_from_cam = map.cam_from_world.inverse();
        let [nx, ny, nz] = self.grid.size();
        let cell_of = |index: usize| {
            let point = world_from_cam * map.point_in_cam(index)?;
            let at = ((point - self.low) / self.grid.voxel()).map(f64::floor);
            let inside = at.x >= 0.0 && at.y >= 0.0 && at.z >= 0.0;
            let [x, y, z] = [at.x as usize, at.y as usize, at.z as usize];
            (inside && x < nx && y < ny && z < nz).then(|| (z * ny + y) * nx + x)
        };
        let mut cells: Vec<usize> =
            (0..map.depth.len()).into_par_iter().filter_map(cell_of).collect();
        cells.par_sort_unstable();
        cells.dedup();
        for cell in cells {
            self.surface[cell] = self.surface[cell].saturating_add(1);
        }
    }
}

/// A depth map over the voxels.
struct View {
    /// Center of the first voxel in the camera frame, and the steps to its neighbors.
    first: Vector3<f64>,
    steps: [Vector3<f64>; 3],
    /// Of a ball around a voxel.
    radius: f64,
    focal: [f64; 2],
    center: [f64; 2],
    grid_from_cam: Isometry3<f64>,
    corners: [Vector3<f64>; 4],
    voxel: f64,
}

impl View {
    fn new(map: &DepthMap, low: Point3<f64>, voxel: f64) -> Self {
        let half = Vector3::repeat(0.5 * voxel);
        let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
        let (f, c) = (map.camera.focal(), map.camera.principal_point());
        let (width, height) = (map.width() as f64, map.height() as f64);
        let corners = [[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]];
        Self {
            first: (map.cam_from_world * (low + half)).coords,
            steps: axes.map(|axis| map.cam_from_world.rotation * (axis * voxel)),
            radius: 0.5 * 3.0_f64.sqrt() * voxel,
            focal: [f.x, f.y],
            center: [c.x, c.y],
            grid_from_cam: Isometry3::translation(-low.x, -low.y, -low.z)
                * map.cam_from_world.inverse(),
            corners: corners.map(|[u, v]| Vector3::new((u - c.x) / f.x, (v - c.y) / f.y, 1.0)),
            voxel,
        }
    }

    /// Voxels along each axis that the frustum up to a depth may touch.
    fn box_of_frustum(&self, depth: f64, size: [usize; 3]) -> [std::ops::Range<usize>; 3] {
        let apex = self.grid_from_cam.translation.vector;
        let (mut low, mut high) = (apex, apex);
        for corner in &self.corners {
            let corner = (self.grid_from_cam * Point3::from(corner * depth)).coords;
            (low, high) = (low.inf(&corner), high.sup(&corner));
        }
        let [low, high] = [low, high].map(|corner| corner / self.voxel);
        std::array::from_fn(|k| {
            let clamped = |at: f64| at.clamp(0.0, size[k] as f64) as usize;
            clamped(low[k].floor())..clamped(high[k].ceil())
        })
    }

    /// Whether all of a voxel lies in the image and in front of known depths.
    fn sees_through(&self, [x, y, z]: [usize; 3], pyramid: &DepthPyramid) -> bool {
        let at = self.first
            + self.steps[0] * x as f64
            + self.steps[1] * y as f64
            + self.steps[2] * z as f64;
        let (near, far) = (at.z - self.radius, at.z + self.radius);
        if near <= 0.1 * self.radius {
            return false;
        }
        // The box around the ball, as wide as it looks at its nearer or its farther end.
        let span = |k: usize| {
            let [low, high] = [at[k] - self.radius, at[k] + self.radius];
            let low = low / if low < 0.0 { near } else { far };
            let high = high / if high > 0.0 { near } else { far };
            [low, high].map(|slope| slope * self.focal[k] + self.center[k])
        };
        let Some(around) = pyramid.around(span(0), span(1)) else { return false };
        around.known >= MIN_KNOWN && f64::from(around.nearest) * (1.0 - DEPTH_ERROR) > far
    }
}
