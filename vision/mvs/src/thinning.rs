//! One point per cell of a grid.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use volery_scene::{OctNormal, OrientedPoint, PointCloud};

/// Bits of a cell's number along an axis; half of the numbers are below zero.
const AXIS_BITS: u32 = 21;
/// Steps into which a cell is divided along an axis, and a unit vector along its length. Whole
/// numbers have the same sum in any order.
const STEPS: f64 = 16_777_216.0;

/// The means of the points in each cubic cell of side `cell`, see [`ThinCloud`]. A `cell` that is
/// not positive leaves the cloud as it is.
pub fn thin_cloud(cloud: &PointCloud, cell: f32) -> PointCloud {
    if !(cell > 0.0 && cell.is_finite()) {
        return cloud.clone();
    }
    let mut thin = ThinCloud::new(cell);
    thin.add(&cloud.points);
    thin.finish()
}

/// A cloud that keeps one point, the mean, for each cubic cell of a grid, however many are added and
/// in whatever order. A cell in which anything was seen takes no notice of what was inferred.
///
/// Cells beyond a million from the origin along an axis are taken as one.
#[derive(Debug, Clone)]
pub(crate) struct ThinCloud {
    cell: f64,
    /// By their numbers, ascending.
    cells: Vec<(u64, Sums)>,
}

/// The points of a cell.
#[derive(Debug, Clone, Copy)]
struct Sums {
    num: u32,
    is_inferred: bool,
    /// The surest point, for what has no mean: confidence, then the bytes of the normal.
    surest: (u8, [u8; 4]),
    /// From the low corner of the cell.
    offset: [u64; 3],
    normal: [i64; 3],
    color: [u32; 3],
}

impl ThinCloud {
    pub(crate) fn new(cell: f32) -> Self {
        Self { cell: f64::from(cell), cells: Vec::new() }
    }

    pub(crate) fn add(&mut self, points: &[OrientedPoint]) {
        let keyed = points.par_iter().map(|point| self.sums_of(point));
        let mut keyed: Vec<(u64, Sums)> = keyed.collect();
        keyed.par_sort_unstable_by_key(|&(key, _)| key);
        let old = std::mem::take(&mut self.cells);
        self.cells = merged(old, keyed);
    }

    pub(crate) fn finish(self) -> PointCloud {
        let cell = self.cell;
        let points = self.cells.into_par_iter().map(|(key, sums)| sums.mean(key, cell));
        PointCloud { points: points.collect() }
    }

    /// The number of the point's cell, and the point alone in it.
    fn sums_of(&self, point: &OrientedPoint) -> (u64, Sums) {
        let half = (1_i64 << (AXIS_BITS - 1)) as f64;
        let mut key = 0;
        let mut offset = [0; 3];
        for (k, offset) in offset.iter_mut().enumerate() {
            let at = f64::from(point.position[k]) / self.cell;
            let number = at.floor().clamp(-half, half - 1.0);
            key = key << AXIS_BITS | (number + half) as u64;
            *offset = ((at - number) * STEPS).round().clamp(0.0, STEPS) as u64;
        }
        let sums = Sums {
            num: 1,
            is_inferred: point.inferred,
            surest: (point.confidence, OctNormal::from(point.normal).to_bytes()),
            offset,
            normal: std::array::from_fn(|k| (f64::from(point.normal[k]) * STEPS).round() as i64),
            color: point.color.map(u32::from),
        };
        (key, sums)
    }
}

/// The cells of both lists; each list is ascending, the second may have cells more than once.
fn merged(old: Vec<(u64, Sums)>, new: Vec<(u64, Sums)>) -> Vec<(u64, Sums)> {
    let mut merged: Vec<(u64, Sums)> = Vec::with_capacity(old.len());
    let (mut old, mut new) = (old.into_iter().peekable(), new.into_iter().peekable());
    while let Some(&(key, _)) = [old.peek(), new.peek()].into_iter().flatten().min_by_key(|c| c.0) {
        let from = if old.peek().is_some_and(|cell| cell.0 == key) { &mut old } else { &mut new };
        let Some((_, sums)) = from.next() else { break };
        match merged.last_mut().filter(|last| last.0 == key) {
            Some((_, last)) => last.add(&sums),
            None => merged.push((key, sums)),
        }
    }
    merged
}

impl Sums {
    fn add(&mut self, other: &Self) {
        if self.is_inferred != other.is_inferred {
            if self.is_inferred {
                *self = *other;
            }
            return;
        }
        self.num += other.num;
        self.surest = self.surest.max(other.surest);
        for k in 0..3 {
            self.offset[k] += other.offset[k];
            self.normal[k] += other.normal[k];
            self.color[k] += other.color[k];
        }
    }

    fn mean(&self, key: u64, cell: f64) -> OrientedPoint {
        let n = f64::from(self.num);
        let half = (1_i64 << (AXIS_BITS - 1)) as f64;
        let at = |k: usize| {
            let number = key >> (AXIS_BITS * (2 - k as u32)) & ((1 << AXIS_BITS) - 1);
            (number as f64 - half + self.offset[k] as f64 / (n * STEPS)) * cell
        };
        let normal = Vector3::from(self.normal.map(|sum| (sum as f64 / (n * STEPS)) as f32));
        let (confidence, surest) = self.surest;
        OrientedPoint {
            position: Point3::new(at(0) as f32, at(1) as f32, at(2) as f32),
            // Opposite sides of a thin sheet have no mean.
            normal: normal.try_normalize(0.1).unwrap_or(OctNormal::from_bytes(surest).into()),
            color: self.color.map(|sum| (f64::from(sum) / n).round() as u8),
            confidence,
            inferred: self.is_inferred,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(x: f32, inferred: bool) -> OrientedPoint {
        OrientedPoint {
            position: Point3::new(x, 2.0, -1.0),
            normal: Vector3::new(0.0, 0.6, 0.8),
            color: [(10.0 * x) as u8; 3],
            confidence: (100.0 * x) as u8,
            inferred,
        }
    }

    fn cloud(points: &[OrientedPoint]) -> PointCloud {
        PointCloud { points: points.to_vec() }
    }

    #[test]
    fn a_cell_holds_the_mean_of_its_points() {
        let thinned = thin_cloud(&cloud(&[point(0.0, false), point(1.0, false)]), 1.5);
        let [mean] = thinned.points[..] else { panic!("{thinned:?}") };
        assert_eq!(mean.position, Point3::new(0.5, 2.0, -1.0));
        assert!((mean.normal.norm() - 1.0).abs() < 1e-6);
        assert_eq!((mean.color, mean.confidence, mean.inferred), ([5; 3], 100, false));
    }

    #[test]
    fn points_farther_apart_than_a_cell_stay() {
        let far = cloud(&[point(0.0, false), point(2.0, false)]);
        assert_eq!(thin_cloud(&far, 1.5), far);
        assert_eq!(thin_cloud(&far, 0.0), far);
        assert_eq!(thin_cloud(&PointCloud::default(), 1.0), PointCloud::default());
    }

    #[test]
    fn what_was_seen_does_not_mix_with_what_was_inferred() {
        let mixed = cloud(&[point(0.0, true), point(1.0, false)]);
        assert_eq!(thin_cloud(&mixed, 1.5), cloud(&[point(1.0, false)]));
        let inferred = thin_cloud(&cloud(&[point(0.0, true), point(1.0, true)]), 1.5);
        assert!(inferred.points.len() == 1 && inferred.points[0].inferred);
    }

    /// Both sides of a sheet in one cell: some unit normal, never NaN.
    #[test]
    fn opposite_normals_leave_a_normal() {
        let mut back = point(0.0, false);
        back.normal = -back.normal;
        let thinned = thin_cloud(&cloud(&[point(0.0, false), back]), 1.0);
        assert!((thinned.points[0].normal.norm() - 1.0).abs() < 1e-6);
    }
}
