//! Lines on the faces of a cell, to closed polygons, to triangles.

use super::isosurface::UnitMesh;

/// Marks a vertex that is still to be numbered: the middle of a polygon.
const MIDDLE: u32 = 1 << 31;

/// A vertex of a polygon: the mesh vertex and the faces of the cell it lies on, as bits.
#[derive(Debug, Clone, Copy)]
struct Corner {
    vertex: u32,
    faces: u8,
}

/// The polygons of some cells.
#[derive(Debug, Default)]
pub(super) struct Polygons {
    /// Of the current cell: start and end.
    lines: Vec<[Corner; 2]>,
    polygon: Vec<Corner>,
    triangles: Vec<[u32; 3]>,
    /// Vertices inside of cells.
    middles: Vec<[f32; 3]>,
}

impl Polygons {
    /// A line of the current cell on one of its six faces, the high side on its left seen from
    /// outside of the cell.
    pub(super) fn push_line(&mut self, start: u32, end: u32, face: usize) {
        let faces = 1 << face;
        self.lines.push([start, end].map(|vertex| Corner { vertex, faces }));
    }

    /// Closes the lines of the current cell to polygons and those to triangles.
    pub(super) fn triangulate(&mut self, positions: &[[f32; 3]]) {
        while let Some([start, mut end]) = self.lines.pop() {
            self.polygon.clear();
            self.polygon.push(start);
            while end.vertex != start.vertex {
                let Some(next) = self.lines.iter().position(|line| line[0].vertex == end.vertex)
                else {
                    break;
                };
                let line = self.lines.swap_remove(next);
                self.polygon.push(Corner { faces: end.faces | line[0].faces, ..end });
                end = line[1];
            }
            self.polygon[0].faces |= end.faces;
            self.cut_ears(positions);
        }
    }

    /// Cuts triangles off at the shortest diagonals.
    ///
    /// A diagonal within a face of the cell could be one of the neighbor's too, and then four
    /// triangles would meet there. A polygon that needs one gets a vertex in its middle instead.
    fn cut_ears(&mut self, positions: &[[f32; 3]]) {
        let at = |corner: &Corner| positions[corner.vertex as usize];
        let first = self.triangles.len();
        let mut rest = self.polygon.clone();
        while rest.len() > 3 {
            let n = rest.len();
            let diagonals = (0..n).filter_map(|i| {
                let (a, b) = (&rest[(i + n - 1) % n], &rest[(i + 1) % n]);
                (a.faces & b.faces == 0).then(|| (distance_squared(at(a), at(b)), i))
            });
            let Some((_, ear)) = diagonals.min_by(|a, b| a.0.total_cmp(&b.0)) else {
                self.triangles.truncate(first);
                self.fan(positions);
                return;
            };
            let (before, after) = (rest[(ear + n - 1) % n], rest[(ear + 1) % n]);
            self.triangles.push([before.vertex, rest[ear].vertex, after.vertex]);
            rest.remove(ear);
        }
        if let [a, b, c] = rest[..] {
            self.triangles.push([a.vertex, b.vertex, c.vertex]);
        }
    }

    fn fan(&mut self, positions: &[[f32; 3]]) {
        let n = self.polygon.len();
        let middle = MIDDLE | self.middles.len() as u32;
        self.middles.push(std::array::from_fn(|axis| {
            let sum: f32 = self.polygon.iter().map(|c| positions[c.vertex as usize][axis]).sum();
            sum / n as f32
        }));
        for i in 0..n {
            let (a, b) = (self.polygon[i].vertex, self.polygon[(i + 1) % n].vertex);
            self.triangles.push([a, b, middle]);
        }
    }

    /// Numbers the middles and moves everything to a mesh.
    pub(super) fn append_to(self, mesh: &mut UnitMesh) {
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(self.middles);
        mesh.triangles.extend(self.triangles.into_iter().map(|triangle| {
            triangle.map(|v| if v & MIDDLE == 0 { v } else { first + (v & !MIDDLE) })
        }));
    }
}

fn distance_squared(a: [f32; 3], b: [f32; 3]) -> f32 {
    (0..3).map(|i| (a[i] - b[i]) * (a[i] - b[i])).sum()
}
