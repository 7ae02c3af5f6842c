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
                        (Some(before), Some(after)) => quadratic_root([before, ua, ub, after]),
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

/// Where a field with the values a, b, c, d at -1, 0, 1, 2 changes sign between 0 and 1.
///
/// The root of the quadratic `b + s t + (c − b − s) t²` whose slopes at 0 and 1 are in the ratio of
/// the field's, those by central differences (Kazhdan's fit). Across a step, where the field is
/// bent on both sides, it is right to 0.004 cells, a straight line to 0.02, and a cubic with the
/// very slopes no better than that.
fn quadratic_root([a, b, c, d]: [f32; 4]) -> f32 {
    if b == 0.0 {
        return 0.0;
    }
    let (slope0, slope1) = (c - a, d - b);
    let share = slope0 / (slope0 + slope1);
    // Beyond 0 and 1 the field turns within the edge: no quadratic says where.
    let share = if share.is_finite() { share.clamp(0.0, 1.0) } else { 0.5 };
    let slope = 2.0 * share * (c - b);
    let square = c - b - slope;
    // b and c differ in sign: the discriminant is positive, and one root lies in between.
    let root = (slope * slope - 4.0 * square * b).max(0.0).sqrt();
    (2.0 * b.abs() / (slope.abs() + root)).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of `t -> tanh(width (t - root))` at -1, 0, 1, 2.
    fn step(width: f32, root: f32) -> [f32; 4] {
        [-1.0, 0.0, 1.0, 2.0].map(|t: f32| (width * (t - root)).tanh())
    }

    /// A straight line is off by 0.04 where the step is steepest.
    #[test]
    fn a_step_is_crossed_in_its_middle() {
        for width in [-1.2_f32, -0.3, 0.3, 0.6, 1.2] {
            for i in 0..=20 {
                let root = 0.05 * i as f32;
                let [a, b, c, d] = step(width, root);
                let found = quadratic_root([a, b, c, d]);
                assert!((found - root).abs() < 0.02, "{width}: {found} for {root}");
            }
        }
    }

    /// Whatever the values beyond the edge, the crossing lies on it.
    #[test]
    fn the_crossing_lies_on_the_edge() {
        for a in [-2.0, -0.5, 0.0, 0.5, 3.0] {
            for d in [-2.0, 0.0, 0.5, 1.5, 4.0] {
                for (b, c) in [(-0.5, 0.5), (1e-6, -1.0), (-1.0, 1e-7), (-0.0, 1.0), (0.3, -0.0)] {
                    let root = quadratic_root([a, b, c, d]);
                    assert!((0.0..=1.0).contains(&root), "{a} {b} {c} {d}: {root}");
                }
            }
        }
    }
}
