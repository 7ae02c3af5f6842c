//! Nearest neighbors among points in space.

use nalgebra::Point3;

/// Points in a leaf; below it, scanning is faster than descending.
const LEAF_SIZE: usize = 12;

/// A balanced kd-tree over points that it numbers as they were given.
///
/// Source: Bentley, "Multidimensional Binary Search Trees Used for Associative Searching", CACM
/// 1975; split at the median of the longest axis.
#[derive(Debug, Clone)]
pub struct KdTree {
    /// In the order of the leaves.
    points: Vec<Point3<f64>>,
    /// Their numbers.
    indices: Vec<u32>,
    /// A complete binary tree, children of `i` at `2i + 1` and `2i + 2`.
    splits: Vec<Split>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Split {
    axis: u8,
    value: f64,
}

/// A point found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Neighbor {
    /// Its number.
    pub index: u32,
    /// Squared distance to the query.
    pub distance_squared: f64,
}

impl KdTree {
    /// Of finite points.
    pub fn new(points: &[Point3<f64>]) -> Self {
        let mut indices: Vec<u32> = (0..points.len() as u32).collect();
        let depth = points.len().div_ceil(LEAF_SIZE).next_power_of_two().trailing_zeros();
        let mut splits = vec![Split::default(); (1 << depth) - 1];
        split(points, &mut indices, &mut splits, 0);
        let points = indices.iter().map(|&i| points[i as usize]).collect();
        Self { points, indices, splits }
    }

    /// The `count` nearest points into `found`, nearest first; equally near ones by their number.
    pub fn nearest(&self, query: &Point3<f64>, count: usize, found: &mut Vec<Neighbor>) {
        found.clear();
        if count > 0 {
            self.search(query, count, found, 0, 0..self.points.len());
        }
    }

    /// The nearest point no farther than `max_distance`; of equally near ones the first in number.
    pub fn nearest_within(&self, query: &Point3<f64>, max_distance: f64) -> Option<Neighbor> {
        let distance_squared = max_distance * max_distance;
        let mut best = Neighbor { index: u32::MAX, distance_squared };
        self.search_nearest(query, &mut best, 0, 0..self.points.len());
        (best.index != u32::MAX).then_some(best)
    }

    fn search_nearest(
        &self,
        query: &Point3<f64>,
        best: &mut Neighbor,
        node: usize,
        range: std::ops::Range<usize>,
    ) {
        let Some(split) = self.splits.get(node) else {
            for (point, &index) in self.points[range.clone()].iter().zip(&self.indices[range]) {
                let distance_squared = (point - query).norm_squared();
                if distance_squared < best.distance_squared
                    || (distance_squared == best.distance_squared && index < best.index)
                {
                    *best = Neighbor { index, distance_squared };
                }
            }
            return;
        };
        let middle = range.start + range.len() / 2;
        let offset = query[split.axis as usize] - split.value;
        let mut sides = [(2 * node + 1, range.start..middle), (2 * node + 2, middle..range.end)];
        if offset >= 0.0 {
            sides.swap(0, 1);
        }
        let [(near, near_range), (far, far_range)] = sides;
        self.search_nearest(query, best, near, near_range);
        if offset * offset <= best.distance_squared {
            self.search_nearest(query, best, far, far_range);
        }
    }

    /// The points no farther than `max_distance` into `found`, in the order of the tree.
    pub fn within(&self, query: &Point3<f64>, max_distance: f64, found: &mut Vec<Neighbor>) {
        found.clear();
        self.search_within(query, max_distance, found, 0, 0..self.points.len());
    }

    fn search_within(
        &self,
        query: &Point3<f64>,
        max_distance: f64,
        found: &mut Vec<Neighbor>,
        node: usize,
        range: std::ops::Range<usize>,
    ) {
        let Some(split) = self.splits.get(node) else {
            for (point, &index) in self.points[range.clone()].iter().zip(&self.indices[range]) {
                let distance_squared = (point - query).norm_squared();
                if distance_squared <= max_distance * max_distance {
                    found.push(Neighbor { index, distance_squared });
                }
            }
            return;
        };
        let middle = range.start + range.len() / 2;
        let offset = query[split.axis as usize] - split.value;
        if offset <= max_distance {
            self.search_within(query, max_distance, found, 2 * node + 1, range.start..middle);
        }
        if offset >= -max_distance {
            self.search_within(query, max_distance, found, 2 * node + 2, middle..range.end);
        }
    }

    fn search(
        &self,
        query: &Point3<f64>,
        count: usize,
        found: &mut Vec<Neighbor>,
        node: usize,
        range: std::ops::Range<usize>,
    ) {
        let Some(split) = self.splits.get(node) else {
            for i in range {
                let distance_squared = (self.points[i] - query).norm_squared();
                insert(found, count, Neighbor { index: self.indices[i], distance_squared });
            }
            return;
        };
        let middle = range.start + range.len() / 2;
        let offset = query[split.axis as usize] - split.value;
        let (low, high) = (range.start..middle, middle..range.end);
        let mut sides = [(2 * node + 1, low), (2 * node + 2, high)];
        if offset >= 0.0 {
            sides.swap(0, 1);
        }
        let [(near, near_range), (far, far_range)] = sides;
        self.search(query, count, found, near, near_range);
        if found.len() < count
            || found.last().is_some_and(|l| offset * offset <= l.distance_squared)
        {
            self.search(query, count, found, far, far_range);
        }
    }
}

fn split(points: &[Point3<f64>], indices: &mut [u32], splits: &mut [Split], node: usize) {
    if node >= splits.len() || indices.is_empty() {
        return;
    }
    let at = |i: &u32| points[*i as usize];
    let (mut low, mut high) = (at(&indices[0]), at(&indices[0]));
    for point in indices.iter().map(at) {
        low = low.inf(&point);
        high = high.sup(&point);
    }
    let axis = (high - low).imax();
    let middle = indices.len() / 2;
    let (_, pivot, _) = indices
        .select_nth_unstable_by(middle, |a, b| at(a)[axis].total_cmp(&at(b)[axis]).then(a.cmp(b)));
    splits[node] = Split { axis: axis as u8, value: at(pivot)[axis] };
    let (low, high) = indices.split_at_mut(middle);
    split(points, low, splits, 2 * node + 1);
    split(points, high, splits, 2 * node + 2);
}

/// Keeps the `count` nearest, sorted.
fn insert(found: &mut Vec<Neighbor>, count: usize, new: Neighbor) {
    let is_before = |n: &Neighbor| {
        n.distance_squared < new.distance_squared
            || (n.distance_squared == new.distance_squared && n.index < new.index)
    };
    if found.len() == count && found.last().is_some_and(is_before) {
        return;
    }
    let place = found.partition_point(is_before);
    found.insert(place, new);
    found.truncate(count);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Rng;

    /// Against the plain search, points in one place and on a line among them.
    #[test]
    fn finds_what_the_plain_search_finds() {
        let mut random = Rng::new(1);
        for n in [0, 1, 5, 12, 13, 100, 1000] {
            let mut points: Vec<Point3<f64>> =
                (0..n).map(|_| Point3::from(random.normal3())).collect();
            points.iter_mut().take(n / 5).for_each(|p| *p = Point3::new(0.5, 0.5, 0.5));
            points.iter_mut().skip(n / 2).take(n / 5).for_each(|p| p.x = 0.0);
            let tree = KdTree::new(&points);
            let mut found = Vec::new();
            for k in [0, 1, 7, 40] {
                let query = Point3::from(random.normal3());
                let mut plain: Vec<Neighbor> = (0..n)
                    .map(|i| Neighbor {
                        index: i as u32,
                        distance_squared: (points[i] - query).norm_squared(),
                    })
                    .collect();
                plain.sort_by(|a, b| {
                    a.distance_squared.total_cmp(&b.distance_squared).then(a.index.cmp(&b.index))
                });
                plain.truncate(k);
                let all_plain = plain.clone();
                tree.nearest(&query, k, &mut found);
                assert_eq!(found, plain, "{k} of {n}");
                for radius in [0.05, 0.8, 9.0] {
                    plain.retain(|n| n.distance_squared <= radius * radius);
                    let nearest = tree.nearest_within(&query, radius);
                    if k > 0 {
                        assert_eq!(nearest, plain.first().copied(), "{radius} of {n}");
                    }
                    tree.within(&query, radius, &mut found);
                    let all =
                        points.iter().filter(|p| (*p - query).norm_squared() <= radius * radius);
                    assert_eq!(found.len(), all.count());
                    assert!(plain.iter().all(|p| found.contains(p)));
                    plain.clone_from(&all_plain);
                }
            }
        }
    }
}
