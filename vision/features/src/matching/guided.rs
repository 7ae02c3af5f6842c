//! Matching along epipolar lines.

use nalgebra::{Matrix3, Point2, Vector3};
use volery_scene::{FeatureMatch, Features};

use super::distance::squared_distance_with;
use super::nearest::{NONE, Nearest};
use super::{MatchOptions, mutual};
use crate::simd::SimdLevel;

/// Side of a cell of the keypoint grid, pixels.
const CELL: f64 = 16.0;
/// Most cells along a side; wider spreads get larger cells.
const MAX_CELLS: f64 = 1024.0;

/// Matches within `max_error_px` of the epipolar lines of `fundamental` (`x₂ᵀ F x₁ = 0`), mutual
/// and ratio-tested among the candidates of the band (P18). `pixels1/2` are the undistorted
/// keypoints.
///
/// A pair is a candidate if each keypoint lies within the bound of the other's line. Keypoints
/// that are not finite have no candidates.
pub fn match_guided(
    features1: &Features,
    pixels1: &[Point2<f64>],
    features2: &Features,
    pixels2: &[Point2<f64>],
    fundamental: &Matrix3<f64>,
    max_error_px: f64,
    options: &MatchOptions,
) -> Vec<FeatureMatch> {
    let level = SimdLevel::detect();
    let mut rows = vec![Running::default(); features1.len().min(pixels1.len())];
    let mut columns = vec![Running::default(); features2.len().min(pixels2.len())];
    let Some(grid) = Grid::new(&pixels2[..columns.len()]) else { return Vec::new() };
    let mut candidates = Vec::new();
    for (i, row) in rows.iter_mut().enumerate() {
        let line2 = fundamental * pixels1[i].to_homogeneous();
        candidates.clear();
        grid.near_line(&line2, max_error_px, &mut candidates);
        candidates.retain(|&j| {
            let x2 = pixels2[j as usize].to_homogeneous();
            let line1 = fundamental.tr_mul(&x2);
            let residual = line2.dot(&x2).abs();
            residual <= max_error_px * line2.xy().norm()
                && residual <= max_error_px * line1.xy().norm()
        });
        candidates.sort_unstable();
        for &j in &candidates {
            let similarity = -(squared_distance_with(
                level,
                &features1.descriptors[i],
                &features2.descriptors[j as usize],
            ) as i32);
            row.update(similarity, j);
            columns[j as usize].update(similarity, i as u32);
        }
    }
    let finish = |all: Vec<Running>| all.into_iter().map(Running::nearest).collect::<Vec<_>>();
    mutual(&finish(rows), &finish(columns), options)
}

/// Running best and second best over the candidates.
#[derive(Debug, Clone, Copy)]
struct Running {
    first: i32,
    second: i32,
    index: u32,
}

impl Default for Running {
    fn default() -> Self {
        Self { first: NONE, second: NONE, index: u32::MAX }
    }
}

impl Running {
    fn update(&mut self, similarity: i32, index: u32) {
        if similarity > self.first {
            (self.second, self.first, self.index) = (self.first, similarity, index);
        } else {
            self.second = self.second.max(similarity);
        }
    }

    fn nearest(self) -> Nearest {
        let second_similarity = (self.second > NONE).then_some(self.second);
        Nearest { similarity: self.first, index: self.index, second_similarity }
    }
}

/// Keypoints by cell.
struct Grid {
    origin: Point2<f64>,
    cell: f64,
    columns: usize,
    rows: usize,
    /// Cell c holds `members[starts[c]..starts[c + 1]]`.
    starts: Vec<u32>,
    members: Vec<u32>,
}

impl Grid {
    /// `None` if no pixel is finite.
    fn new(pixels: &[Point2<f64>]) -> Option<Self> {
        let finite = || pixels.iter().filter(|p| p.coords.iter().all(|v| v.is_finite()));
        let first = finite().next()?;
        let (mut low, mut high) = (*first, *first);
        for pixel in finite() {
            low = low.inf(pixel);
            high = high.sup(pixel);
        }
        let extent = high - low;
        let cell = CELL.max(extent.max() / MAX_CELLS);
        let count = |side: f64| (side / cell) as usize + 1;
        let mut grid = Self {
            origin: low,
            cell,
            columns: count(extent.x),
            rows: count(extent.y),
            starts: Vec::new(),
            members: Vec::new(),
        };
        let cell_of = |p: &Point2<f64>| {
            let offset = (p - low) / cell;
            offset
                .iter()
                .all(|v| v.is_finite())
                .then(|| offset.y as usize * grid.columns + offset.x as usize)
        };
        let cells: Vec<Option<usize>> = pixels.iter().map(cell_of).collect();
        grid.starts = vec![0; grid.columns * grid.rows + 1];
        for cell in cells.iter().flatten() {
            grid.starts[cell + 1] += 1;
        }
        for c in 1..grid.starts.len() {
            grid.starts[c] += grid.starts[c - 1];
        }
        let mut next = grid.starts.clone();
        grid.members = vec![0; cells.iter().flatten().count()];
        for (index, cell) in cells.iter().enumerate() {
            if let Some(cell) = *cell {
                grid.members[next[cell] as usize] = index as u32;
                next[cell] += 1;
            }
        }
        Some(grid)
    }

    /// Keypoints of all cells that the band about `a x + b y + c = 0` touches.
    fn near_line(&self, line: &Vector3<f64>, margin: f64, out: &mut Vec<u32>) {
        let norm = line.xy().norm();
        if !(norm > 0.0 && norm.is_finite() && line.z.is_finite() && margin >= 0.0) {
            return;
        }
        // In cells, with the grid's corner as origin.
        let (a, b) = (line.x / norm, line.y / norm);
        let c = (line.z / norm + a * self.origin.x + b * self.origin.y) / self.cell;
        let margin = margin / self.cell;
        let flat = b.abs() >= a.abs();
        let (along, across) =
            if flat { (self.columns, self.rows) } else { (self.rows, self.columns) };
        let (slope, offset, spread) = if flat {
            (-a / b, -c / b, margin / b.abs())
        } else {
            (-b / a, -c / a, margin / a.abs())
        };
        for step in 0..along {
            let (start, end) = (slope * step as f64 + offset, slope * (step + 1) as f64 + offset);
            let low = (start.min(end) - spread).floor().max(0.0);
            let high = (start.max(end) + spread).floor().min(across as f64 - 1.0);
            if low > high {
                continue;
            }
            for other in low as usize..=high as usize {
                let cell =
                    if flat { other * self.columns + step } else { step * self.columns + other };
                let range = self.starts[cell] as usize..self.starts[cell + 1] as usize;
                out.extend_from_slice(&self.members[range]);
            }
        }
    }
}
