//! The iso-surface of χ over the leaves of the tree, without cracks.
//!
//! Every face of a leaf is cut into lines by marching squares. Where the leaf beyond is finer, the
//! lines are those of its four smaller faces: both sides of a face see the same lines, and the
//! lines of a leaf close to polygons whose edges are shared by exactly two of them.
//!
//! Source: Kazhdan, Klein, Dalal and Hoppe, "Unconstrained Isosurface Extraction on Arbitrary
//! Octrees", SGP 2007. Hanging vertices hold the coarse cell's value here, so that an edge is
//! crossed at most once.

use rayon::prelude::*;

use super::crossings::{LevelSurface, NONE};
use super::octree::{BASE_DEPTH, Octree};
use super::polygons::Polygons;
use super::rows::Run;
use super::solution::Solution;

/// A mesh in the unit cube.
#[derive(Debug, Default)]
pub(super) struct UnitMesh {
    pub(super) positions: Vec<[f32; 3]>,
    pub(super) triangles: Vec<[u32; 3]>,
}

/// The surface where χ is `iso_value`; triangles counterclockwise where χ is greater.
pub(super) fn isosurface(octree: &Octree, solution: &Solution, iso_value: f32) -> UnitMesh {
    let mut mesh = UnitMesh::default();
    let mut finer: Option<LevelSurface> = None;
    for depth in (BASE_DEPTH..=octree.depth()).rev() {
        let (level, values) = (octree.level(depth), solution.at_depth(depth));
        let positions = &mut mesh.positions;
        let surface = LevelSurface::new(depth, level, values, iso_value, finer.as_ref(), positions);
        let cutter = Cutter { surface: &surface, finer: finer.as_ref(), iso_value };
        let planes: Vec<Polygons> = (0..level.cells.side())
            .into_par_iter()
            .map(|z| cutter.cut_plane(z, positions))
            .collect();
        for polygons in planes {
            polygons.append_to(&mut mesh);
        }
        finer = Some(surface);
    }
    mesh
}

/// Cuts the leaves of one level.
#[derive(Clone, Copy)]
struct Cutter<'a> {
    surface: &'a LevelSurface<'a>,
    finer: Option<&'a LevelSurface<'a>>,
    iso_value: f32,
}

impl Cutter<'_> {
    fn cut_plane(self, z: u32, positions: &[[f32; 3]]) -> Polygons {
        let mut polygons = Polygons::default();
        for (y, run) in self.surface.level.cells.iter_plane(z) {
            self.cut_row(run, y, z, positions, &mut polygons);
        }
        polygons
    }

    fn cut_row(self, run: Run, y: u32, z: u32, positions: &[[f32; 3]], polygons: &mut Polygons) {
        let level = self.surface.level;
        // The four rows of corners, y before z.
        let rows: [u32; 4] = std::array::from_fn(|k| {
            let (y, z) = (y + (k as u32 & 1), z + (k as u32 >> 1));
            level.vertices.find([run.begin, y, z]).expect("cells have corners")
        });
        let signs_at = |offset: u32| {
            let sign = |k: usize| {
                let value = self.surface.values[(rows[k] + offset) as usize];
                u8::from(value >= self.iso_value) << (2 * k)
            };
            sign(0) | sign(1) | sign(2) | sign(3)
        };
        let mut before = signs_at(0);
        for offset in 0..run.end - run.begin {
            let after = signs_at(offset + 1);
            let signs = before | (after << 1);
            before = after;
            if signs == 0 || signs == 0xff {
                continue;
            }
            let cell = [run.begin + offset, y, z];
            if level.refined.find(cell).is_some() {
                continue;
            }
            let corners: [u32; 8] = std::array::from_fn(|k| rows[k >> 1] + offset + (k as u32 & 1));
            self.cut_cell(cell, corners, polygons);
            polygons.triangulate(positions);
        }
    }

    /// Pushes the lines on the six faces of a leaf, its outside seen from in front of the face.
    fn cut_cell(self, cell: [u32; 3], corners: [u32; 8], polygons: &mut Polygons) {
        for face in 0..6_usize {
            let (axis, is_far) = (face / 2, face % 2 == 1);
            // Axes of the face, right-handed seen from outside.
            let (mut u, mut v) = ((axis + 1) % 3, (axis + 2) % 3);
            if !is_far {
                std::mem::swap(&mut u, &mut v);
            }
            if let Some(finer) = self.finer
                && let Some(beyond) = neighbor(cell, axis, is_far)
                && self.surface.level.refined.find(beyond).is_some()
            {
                let mut origin = cell.map(|c| 2 * c);
                origin[axis] += if is_far { 2 } else { 0 };
                for (du, dv) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    let mut at = origin;
                    at[u] += du;
                    at[v] += dv;
                    let corner = |du: u32, dv: u32| {
                        let mut at = at;
                        at[u] += du;
                        at[v] += dv;
                        finer.level.vertices.find(at).expect("refined cells have fine corners")
                    };
                    let corners = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
                    let fine = Cutter { surface: finer, finer: None, iso_value: self.iso_value };
                    fine.cut_face(face, at, [u, v], corners, polygons);
                }
            } else {
                let near = usize::from(is_far) << axis;
                let corner = |du: usize, dv: usize| corners[near | (du << u) | (dv << v)];
                let mut at = cell;
                at[axis] += u32::from(is_far);
                let corners = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
                self.cut_face(face, at, [u, v], corners, polygons);
            }
        }
    }

    /// Marching squares on a face; `corners` counterclockwise from the one at `at`.
    fn cut_face(
        self,
        face: usize,
        at: [u32; 3],
        [u, v]: [usize; 2],
        corners: [u32; 4],
        polygons: &mut Polygons,
    ) {
        let values = corners.map(|i| self.surface.values[i as usize]);
        let is_high = values.map(|value| value >= self.iso_value);
        // Edge k leads from corner k to corner k + 1: its axis, lower end, and where that is.
        let edge = |k: usize| {
            let (axis, low) = [(u, 0), (v, 1), (u, 3), (v, 0)][k];
            let mut at = at;
            at[u] += u32::from(low == 1);
            at[v] += u32::from(low == 3);
            self.crossing(axis, corners[low], at)
        };
        let leaves = |k: usize| is_high[k] && !is_high[(k + 1) % 4];
        let enters = |k: usize| !is_high[k] && is_high[(k + 1) % 4];
        let num_lines = (0..4).filter(|&k| leaves(k)).count();
        // Two opposite corners are high: are they one region in the bilinear patch?
        let joined = num_lines == 2 && {
            let d = values.map(|value| f64::from(value) - f64::from(self.iso_value));
            let (high, low) =
                if is_high[0] { (d[0] * d[2], d[1] * d[3]) } else { (d[1] * d[3], d[0] * d[2]) };
            high >= low
        };
        for k in (0..4).filter(|&k| leaves(k)) {
            // The line goes from where the boundary leaves the high region to where it enters it,
            // the high region on its left: around the low corner, or back around the high one.
            let mut end = k;
            loop {
                end = (if joined { end + 1 } else { end + 3 }) % 4;
                if enters(end) {
                    break;
                }
            }
            polygons.push_line(edge(k), edge(end), face);
        }
    }

    /// The mesh vertex on the edge of this level that leaves a tree vertex along an axis.
    fn crossing(self, axis: usize, vertex: u32, at: [u32; 3]) -> u32 {
        let own = self.surface.crossings[axis][vertex as usize];
        if own != NONE {
            return own;
        }
        let finer = self.finer.expect("an edge without a crossing of its own is halved");
        let low = at.map(|v| 2 * v);
        let mut middle = low;
        middle[axis] += 1;
        let crossing = |at: [u32; 3]| {
            let vertex = finer.level.vertices.find(at).expect("halves of edges have ends");
            finer.crossings[axis][vertex as usize]
        };
        let first = crossing(low);
        if first == NONE { crossing(middle) } else { first }
    }
}

fn neighbor(cell: [u32; 3], axis: usize, is_far: bool) -> Option<[u32; 3]> {
    let mut beyond = cell;
    beyond[axis] = if is_far { cell[axis] + 1 } else { cell[axis].checked_sub(1)? };
    Some(beyond)
}
