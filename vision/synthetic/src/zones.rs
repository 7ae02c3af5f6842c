//! Parts of a furnished hall as texture-free clouds: what dense mapping would give, with its
//! errors, and the truth.

use nalgebra::{Point3, UnitQuaternion, Vector3};
use volery_scene::{OrientedPoint, PointCloud};

use crate::{Cuboid, Rng, Room};

/// A scan of a part of a room.
#[derive(Debug, Clone, PartialEq)]
pub struct Zone {
    /// In the frame of the room.
    pub cloud: PointCloud,
    /// Where it was seen from, in the same frame.
    pub viewpoints: Vec<Point3<f64>>,
}

/// How well a zone is seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScanOptions {
    /// Points of the cloud.
    pub num_points: usize,
    /// Standard deviation of a point per axis, meters.
    pub noise: f64,
    /// Standard deviation of the turn of a normal about each axis, radians.
    pub normal_noise: f64,
}

impl Default for ScanOptions {
    fn default() -> Self {
        Self { num_points: 30_000, noise: 0.005, normal_noise: 0.05 }
    }
}

impl Room {
    /// A hall in which boxes, cupboards, low tables and columns of random size, place and turn
    /// stand, about one per `area_per_item` square meters.
    pub fn random(size: Vector3<f64>, area_per_item: f64, seed: u64) -> Self {
        let mut rng = Rng::fork(seed, 0x7a);
        let num_items = (size.x * size.y / area_per_item).round() as usize;
        let furniture = (0..num_items)
            .map(|_| {
                let item = match rng.index(4) {
                    0 => [rng.range(0.3, 1.2), rng.range(0.3, 1.0), rng.range(0.2, 1.0)],
                    1 => [rng.range(0.8, 2.0), rng.range(0.4, 0.7), rng.range(1.2, 2.2)],
                    2 => [rng.range(0.8, 2.2), rng.range(0.6, 1.2), rng.range(0.4, 0.8)],
                    _ => [rng.range(0.2, 0.5), rng.range(0.2, 0.5), rng.range(1.5, size.z)],
                };
                let item = Vector3::from(item);
                let half = (size - Vector3::new(1.0, 1.0, 0.0)) / 2.0;
                let (x, y) = (rng.range(-half.x, half.x), rng.range(-half.y, half.y));
                let turn = if rng.chance(0.3) { 0.0 } else { rng.range(0.0, 3.0) };
                Cuboid::standing(x, y, 0.0, item, turn)
            })
            .collect();
        Self { size, furniture }
    }

    /// What is seen of the surfaces between `low` and `high` from viewpoints among them, about one
    /// per two square meters of floor and at least six.
    ///
    /// Panics where there is no free space to look from.
    pub fn scan(
        &self,
        low: Point3<f64>,
        high: Point3<f64>,
        options: &ScanOptions,
        seed: u64,
    ) -> Zone {
        let mut rng = Rng::fork(seed, 0x7b);
        let [dx, dy] = [high.x - low.x, high.y - low.y];
        let num_viewpoints = ((dx * dy / 2.0) as usize).max(6);
        let mut viewpoints = Vec::new();
        for _ in 0..100 * num_viewpoints {
            let x = low.x + dx * rng.range(0.1, 0.9);
            let y = low.y + dy * rng.range(0.1, 0.9);
            let at = Point3::new(x, y, rng.range(0.9, 1.0_f64.max(self.size.z - 0.7)));
            if viewpoints.len() < num_viewpoints && self.is_free(&at, 0.15) {
                viewpoints.push(at);
            }
        }
        assert!(!viewpoints.is_empty(), "no free space between {low} and {high}");
        let mut cloud = PointCloud::default();
        while cloud.points.len() < options.num_points {
            let point = self.surface_point(&mut rng);
            let p = point.position;
            let is_inside = (0..3).all(|k| low[k] <= p[k] && p[k] <= high[k]);
            let is_seen = |from: &Point3<f64>| {
                (from - p).dot(&point.normal) > 0.1 * (from - p).norm() && self.sees(from, &p)
            };
            if !is_inside || !viewpoints.iter().any(is_seen) {
                continue;
            }
            let turn = UnitQuaternion::from_scaled_axis(rng.normal3() * options.normal_noise);
            cloud.points.push(OrientedPoint {
                position: (p + rng.normal3() * options.noise).cast(),
                normal: (turn * point.normal).cast(),
                color: [128; 3],
                confidence: 255,
                inferred: false,
            });
        }
        Zone { cloud, viewpoints }
    }

    /// The room in `columns` x `rows` zones that overlap their neighbors by `overlap` (0..1) of
    /// their own length.
    pub fn zones(
        &self,
        [columns, rows]: [usize; 2],
        overlap: f64,
        options: &ScanOptions,
        seed: u64,
    ) -> Vec<Zone> {
        // n zones of length l that overlap by o: L = n l − (n − 1) o l.
        let length = |whole: f64, n: usize| whole / (n as f64 - (n as f64 - 1.0) * overlap);
        let (lx, ly) = (length(self.size.x, columns), length(self.size.y, rows));
        let half = self.size / 2.0;
        (0..columns * rows)
            .map(|index| {
                let (i, j) = (index % columns, index / columns);
                let x = -half.x + i as f64 * lx * (1.0 - overlap);
                let y = -half.y + j as f64 * ly * (1.0 - overlap);
                // Walls, floor and ceiling lie on the border.
                let low = Point3::new(x - 1e-6, y - 1e-6, -1e-6);
                let high = Point3::new(x + lx + 1e-6, y + ly + 1e-6, self.size.z + 1e-6);
                self.scan(low, high, options, crate::rng::mix(seed) ^ index as u64)
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zones_share_what_they_should_and_lie_on_surfaces() {
        let room = Room::random(Vector3::new(12.0, 9.0, 3.0), 3.0, 1);
        let exact = ScanOptions { num_points: 4000, noise: 0.0, normal_noise: 0.0 };
        let zones = room.zones([2, 2], 0.3, &exact, 2);
        assert_eq!(zones.len(), 4);
        for zone in &zones {
            assert!(zone.viewpoints.iter().all(|v| room.is_free(v, 0.1)));
            for point in &zone.cloud.points {
                let p: Point3<f64> = point.position.cast();
                let n: Vector3<f64> = point.normal.cast();
                assert!(room.is_free(&(p + n * 2e-3), 0.0) && !room.is_free(&(p - n * 2e-3), 0.0));
                assert!(zone.viewpoints.iter().any(|v| room.sees(v, &(p + n * 1e-3))));
            }
        }
        let extent = |zone: &Zone| {
            let xs = zone.cloud.points.iter().map(|p| p.position.x);
            (xs.clone().fold(f32::INFINITY, f32::min), xs.fold(f32::NEG_INFINITY, f32::max))
        };
        let ((l0, h0), (l1, _)) = (extent(&zones[0]), extent(&zones[1]));
        assert!(((h0 - l1) / (h0 - l0) - 0.3).abs() < 0.02, "{h0} {l1}");
    }
}
