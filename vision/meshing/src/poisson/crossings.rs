//! Where the edges of cells cross the iso-surface.

use rayon::prelude::*;

use super::octree::Level;
use super::rows::Run;

/// No crossing.
pub(super) const NONE: u32 = u32::MAX;

/// A level with its values and the crossings of its edges.
#[derive(Debug)]
pub(super) struct LevelSurface<'a> {
    pub(super) level: &'a Level,
    pub(super) values: &'a [f32],
    /// Per axis and vertex, the mesh vertex on the edge that leaves it along the axis, or [`NONE`]:
    /// no crossing, or one that the next finer level owns.
    pub(super) crossings: [Vec<u32>; 3],
}

/// A crossing: axis, tree vertex at its lower end, position in the unit cube.
type Found = (u8, u32, [f32; 3]);

impl<'a> LevelSurface<'a> {
    /// Finds the crossings that belong to this level and appends their positions to `positions`.
    ///
    /// An edge that the finer level halves belongs to it. The field is linear along such an edge,
    /// so that exactly one half crosses.
    pub(super) fn new(
        depth: u32,
        level: &'a Level,
        values: &'a [f32],
        iso_value: f32,
        finer: Option<&LevelSurface>,
        positions: &mut Vec<[f32; 3]>,
    ) -> Self {
        let vertices = &level.vertices;
        let side = (1u32 << depth) as f32;
        let found: Vec<Vec<Found>> = (0..vertices.side())
            .into_par_iter()
            .map(|z| {
                let mut found = Vec::new();
                let mut add = |axis: u8, a: u32, b: u32, at: [u32; 3]| {
                    let (ua, ub) = (values[a as usize] - iso_value, values[b as usize] - iso_value);
                    if (ua < 0.0) == (ub < 0.0) {
                        return;
                    }
                    let mut middle = at.map(|v| 2 * v);
                    middle[axis as usize] += 1;
                    if finer.is_some_and(|f| f.level.vertices.find(middle).is_some()) {
                        return;
                    }
                    let beyond = |step: i32| {
                        let mut at = at;
                        at[axis as usize] = at[axis as usize].wrapping_add_signed(step);
                        vertices.find(at).map(|i| values[i as usize] - iso_value)
                    };
                    let root = match (beyond(-1), beyond(2)) {
                        (Some(before), Some(after)) => cubic_root([before, ua, ub, after]),
                        _ => ua / (ua - ub),
                    };
                    let mut position = at.map(|v| v as f32);
                    position[axis as usize] += root;
                    found.push((axis, a, position.map(|v| v / side)));
                };
                for (y, run) in vertices.iter_plane(z) {
                    for x in run.begin..run.end - 1 {
                        add(0, run.index(x), run.index(x) + 1, [x, y, z]);
                    }
                    for_each_pair(run, vertices.row(y + 1, z), |x, a, b| add(1, a, b, [x, y, z]));
                    for_each_pair(run, vertices.row(y, z + 1), |x, a, b| add(2, a, b, [x, y, z]));
                }
                found
            })
            .collect();
        let mut crossings: [Vec<u32>; 3] = std::array::from_fn(|_| vec![NONE; vertices.len()]);
        for (axis, vertex, position) in found.into_iter().flatten() {
            crossings[axis as usize][vertex as usize] = positions.len() as u32;
            positions.push(position);
        }
        Self { level, values, crossings }
    }
}

/// Visits the points that a run and another row share in x.
fn for_each_pair(run: Run, row: &[Run], mut visit: impl FnMut(u32, u32, u32)) {
    for other in row {
        for x in run.begin.max(other.begin)..run.end.min(other.end) {
            visit(x, run.index(x), other.index(x));
        }
    }
}

/// Root in [0, 1] of the cubic through values at -1, 0, 1, 2 that changes sign between 0 and 1
/// (Catmull and Rom's: slopes at 0 and 1 by central differences).
fn cubic_root([a, b, c, d]: [f32; 4]) -> f32 {
    let (slope0, slope1) = (0.5 * (c - a), 0.5 * (d - b));
    let square = 3.0 * (c - b) - 2.0 * slope0 - slope1;
    let cube = 2.0 * (b - c) + slope0 + slope1;
    let at = |t: f32| b + t * (slope0 + t * (square + t * cube));
    // The interval that holds the root shrinks; a secant where it can, halves where not.
    let (mut low, mut high) = (0.0, 1.0);
    let mut t = b / (b - c);
    for _ in 0..8 {
        let value = at(t);
        if (value < 0.0) == (b < 0.0) {
            low = t;
        } else {
            high = t;
        }
        let slope = slope0 + t * (2.0 * square + t * 3.0 * cube);
        let newton = t - value / slope;
        t = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
    }
    t
}
