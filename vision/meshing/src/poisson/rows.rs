//! Sparse sets of lattice points as runs along x: one level of a linear octree.

use rayon::prelude::*;

/// Neighbors along x: `begin..end`, numbered from `base`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Run {
    pub(super) begin: u32,
    pub(super) end: u32,
    pub(super) base: u32,
}

impl Run {
    /// Index of the point at `x`, which must lie in the run.
    pub(super) fn index(&self, x: u32) -> u32 {
        self.base + (x - self.begin)
    }
}

/// A set of points of the lattice `0..side` cubed, numbered by z, then y, then x.
///
/// Runs are as long as they can be: two runs of a row have a gap between them.
#[derive(Debug, Clone, Default)]
pub(super) struct Rows {
    side: u32,
    /// Per row, its first run; one more at the end.
    starts: Vec<u32>,
    runs: Vec<Run>,
    /// Per plane of one z, its first point; one more at the end.
    planes: Vec<u32>,
}

impl Rows {
    /// Every point.
    pub(super) fn full(side: u32) -> Self {
        Self::union(side, |_, _, intervals| intervals.push([0, side]))
    }

    /// The points of `cells`, in any order.
    pub(super) fn from_points(side: u32, points: impl Iterator<Item = [u32; 3]>) -> Self {
        let bits = side.next_power_of_two().trailing_zeros();
        let mut keys: Vec<u64> = points
            .map(|[x, y, z]| (u64::from(z) << (2 * bits)) | (u64::from(y) << bits) | u64::from(x))
            .collect();
        keys.par_sort_unstable();
        keys.dedup();
        let row = |y: u32, z: u32| (u64::from(z) << (2 * bits)) | (u64::from(y) << bits);
        Self::union(side, |y, z, intervals| {
            let begin = keys.partition_point(|&key| key < row(y, z));
            for &key in keys[begin..].iter().take_while(|&&key| key >> bits == row(y, z) >> bits) {
                let x = (key & ((1 << bits) - 1)) as u32;
                intervals.push([x, x + 1]);
            }
        })
    }

    /// Per row (y, z), the union of the intervals that `gather` pushes.
    pub(super) fn union(side: u32, gather: impl Fn(u32, u32, &mut Vec<[u32; 2]>) + Sync) -> Self {
        let planes: Vec<(Vec<u32>, Vec<[u32; 2]>)> = (0..side)
            .into_par_iter()
            .map(|z| {
                let (mut counts, mut runs, mut row) = (Vec::new(), Vec::new(), Vec::new());
                for y in 0..side {
                    row.clear();
                    gather(y, z, &mut row);
                    counts.push(merge_onto(&mut runs, &mut row));
                }
                (counts, runs)
            })
            .collect();
        let mut set = Self { side, starts: vec![0], runs: Vec::new(), planes: vec![0] };
        let mut base = 0;
        for (counts, runs) in planes {
            let mut start = set.runs.len() as u32;
            set.starts.extend(counts.iter().map(|count| {
                start += count;
                start
            }));
            for [begin, end] in runs {
                set.runs.push(Run { begin, end, base });
                base += end - begin;
            }
            set.planes.push(base);
        }
        set
    }

    /// Points along one side of the lattice.
    pub(super) fn side(&self) -> u32 {
        self.side
    }

    /// Number of points.
    pub(super) fn len(&self) -> usize {
        self.planes.last().map_or(0, |&end| end as usize)
    }

    /// Per plane of one z, its first point; one more at the end.
    pub(super) fn planes(&self) -> &[u32] {
        &self.planes
    }

    /// The runs of one row in order; none outside of the lattice.
    pub(super) fn row(&self, y: u32, z: u32) -> &[Run] {
        if y >= self.side || z >= self.side {
            return &[];
        }
        let row = (z * self.side + y) as usize;
        &self.runs[self.starts[row] as usize..self.starts[row + 1] as usize]
    }

    /// Index of a point.
    pub(super) fn find(&self, [x, y, z]: [u32; 3]) -> Option<u32> {
        let row = self.row(y, z);
        let run = row[..row.partition_point(|run| run.begin <= x)].last()?;
        (x < run.end).then(|| run.index(x))
    }

    /// Every run with its y and z.
    pub(super) fn iter(&self) -> impl Iterator<Item = (u32, u32, Run)> {
        (0..self.side).flat_map(move |z| self.iter_plane(z).map(move |(y, run)| (y, z, run)))
    }

    /// The runs of a plane with their y.
    pub(super) fn iter_plane(&self, z: u32) -> impl Iterator<Item = (u32, Run)> {
        (0..self.side).flat_map(move |y| self.row(y, z).iter().map(move |&run| (y, run)))
    }
}

/// Appends the union of `intervals` to `runs`; how many runs that made.
fn merge_onto(runs: &mut Vec<[u32; 2]>, intervals: &mut [[u32; 2]]) -> u32 {
    intervals.sort_unstable();
    let first = runs.len();
    for &[begin, end] in intervals.iter().filter(|[begin, end]| begin < end) {
        match runs[first..].last_mut() {
            Some(last) if begin <= last[1] => last[1] = last[1].max(end),
            _ => runs.push([begin, end]),
        }
    }
    (runs.len() - first) as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers follow z, y, x without gaps, and `find` knows exactly the points of the set.
    #[test]
    fn numbers_follow_the_order_of_the_points() {
        let inside = |[x, y, z]: [u32; 3]| (x * 7 + y * 5 + z * 3) % 4 != 0 && x != 6;
        let mut points = Vec::new();
        for z in 0..11 {
            for y in 0..11 {
                points.extend((0..11).map(|x| [x, y, z]).filter(|&p| inside(p)));
            }
        }
        let set = Rows::from_points(11, points.iter().rev().copied());
        assert_eq!(set.len(), points.len());
        for (index, &point) in points.iter().enumerate() {
            assert_eq!(set.find(point), Some(index as u32));
        }
        for point in [[6, 1, 1], [11, 0, 0], [0, 11, 0], [0, 0, 11]] {
            assert_eq!(set.find(point), None);
        }
        for z in 0..11 {
            let begin = points.iter().position(|p| p[2] == z).unwrap();
            assert_eq!(set.planes()[z as usize] as usize, begin);
        }
    }

    #[test]
    fn intervals_that_touch_become_one_run() {
        let set = Rows::union(9, |y, z, row| {
            if y == 2 && z == 3 {
                row.extend([[6, 8], [0, 2], [1, 4], [4, 5]]);
            }
        });
        let runs: Vec<_> = set.row(2, 3).iter().map(|r| (r.begin, r.end, r.base)).collect();
        assert_eq!(runs, [(0, 5, 0), (6, 8, 5)]);
        assert_eq!(set.iter().count(), 2);
    }
}
