//! Oriented points in the unit cube, in the order of the octree.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use volery_scene::PointCloud;

use crate::MeshingError;

/// Side of the cube relative to the longest side of the points' box (Kazhdan and Hoppe's 1.1).
const CUBE_SCALE: f64 = 1.1;
/// Octree depth of the order of the samples: 3 x 21 bits fit into a key.
const ORDER_DEPTH: u32 = 21;

/// Where the unit cube lies among the points.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cube {
    origin: Point3<f64>,
    pub(super) side: f64,
}

impl Cube {
    /// From the unit cube to the frame of the points.
    pub(super) fn to_world(self, point: [f32; 3]) -> Point3<f64> {
        self.origin + Vector3::from(point.map(f64::from)) * self.side
    }

    fn to_cube(self, point: &Point3<f64>) -> [f32; 3] {
        ((point - self.origin) / self.side).map(|v| v as f32).into()
    }
}

/// Samples of the surface, neighbors near each other in memory.
#[derive(Debug)]
pub(super) struct Samples {
    pub(super) cube: Cube,
    /// In the unit cube.
    pub(super) positions: Vec<[f32; 3]>,
    /// Unit vectors.
    pub(super) normals: Vec<[f32; 3]>,
}

impl Samples {
    /// Checks the cloud and sorts it along the Morton curve.
    pub(super) fn from_cloud(cloud: &PointCloud) -> Result<Self, MeshingError> {
        check(cloud)?;
        let position = |index: usize| cloud.points[index].position.cast::<f64>();
        let (mut low, mut high) = (position(0), position(0));
        for index in 0..cloud.points.len() {
            low = low.inf(&position(index));
            high = high.sup(&position(index));
        }
        let extent = (high - low).max();
        if extent <= 0.0 {
            return Err(MeshingError::SamePlace);
        }
        let side = CUBE_SCALE * extent;
        let center = low + (high - low) * 0.5;
        let cube = Cube { origin: center - Vector3::repeat(0.5 * side), side };
        let mut order: Vec<(u64, u32)> = (0..cloud.points.len())
            .into_par_iter()
            .map(|index| (morton(cube.to_cube(&position(index))), index as u32))
            .collect();
        order.par_sort_unstable();
        let positions = order.iter().map(|&(_, i)| cube.to_cube(&position(i as usize)));
        let normals =
            order.iter().map(|&(_, i)| cloud.points[i as usize].normal.normalize().into());
        Ok(Self { cube, positions: positions.collect(), normals: normals.collect() })
    }

    /// Number of samples.
    pub(super) fn len(&self) -> usize {
        self.positions.len()
    }
}

fn check(cloud: &PointCloud) -> Result<(), MeshingError> {
    let num_points = cloud.points.len();
    if num_points < 3 {
        return Err(MeshingError::TooFewPoints { got: num_points });
    }
    if u32::try_from(num_points).is_err() {
        return Err(MeshingError::TooManyPoints { got: num_points });
    }
    for (index, point) in cloud.points.iter().enumerate() {
        let numbers = point.position.iter().chain(&point.normal);
        if !numbers.copied().all(f32::is_finite) {
            return Err(MeshingError::NotFinite { index });
        }
        let length_squared = point.normal.norm_squared();
        if !length_squared.is_normal() {
            return Err(MeshingError::NotANormal { index });
        }
    }
    Ok(())
}

/// Cell of a depth that holds a point of the unit cube, and where in the cell.
pub(super) fn cell_of(position: [f32; 3], depth: u32) -> ([u32; 3], [f32; 3]) {
    let side = (1u32 << depth) as f32;
    let scaled = position.map(|v| (v * side).clamp(0.0, side));
    let cell = scaled.map(|v| (v as u32).min((1 << depth) - 1));
    (cell, std::array::from_fn(|axis| scaled[axis] - cell[axis] as f32))
}

/// Position along the Morton curve: the bits of the coordinates interleaved.
fn morton(position: [f32; 3]) -> u64 {
    let side = f64::from(1u32 << ORDER_DEPTH);
    let [x, y, z] = position.map(|v| (f64::from(v) * side) as u64);
    spread(x) | (spread(y) << 1) | (spread(z) << 2)
}

/// The low 21 bits, two zeros between neighbors.
fn spread(value: u64) -> u64 {
    let mut v = value & 0x1f_ffff;
    v = (v | (v << 32)) & 0x001f_0000_0000_ffff;
    v = (v | (v << 16)) & 0x001f_0000_ff00_00ff;
    v = (v | (v << 8)) & 0x100f_00f0_0f00_f00f;
    v = (v | (v << 4)) & 0x10c3_0c30_c30c_30c3;
    (v | (v << 2)) & 0x1249_2492_4924_9249
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_interleaves_bits() {
        assert_eq!(spread(0b101), 0b1_000_001);
        assert_eq!(spread(0x1f_ffff), 0x1249_2492_4924_9249);
        assert!(morton([0.1, 0.1, 0.6]) > morton([0.9, 0.9, 0.4]));
    }

    #[test]
    fn cells_hold_their_points() {
        assert_eq!(cell_of([0.0, 0.5, 1.0], 2), ([0, 2, 3], [0.0, 0.0, 1.0]));
        let (cell, inside) = cell_of([0.3, 0.99, 0.71], 9);
        for axis in 0..3 {
            let back = (cell[axis] as f32 + inside[axis]) / 512.0;
            assert!((back - [0.3, 0.99, 0.71][axis]).abs() < 1e-6);
        }
    }
}
