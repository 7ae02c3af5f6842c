//! Which blocks of pixels a range of rays falls into.

use volery_geometry::{Camera, CameraModel};

use crate::virtual_camera::{BLOCK, Rays};

/// Cells per block along each axis.
const CELLS_PER_BLOCK: usize = 2;

/// Blocks of pixels: first and last column, first and last row.
pub(crate) type BlockRange = [u16; 4];

/// Finds the blocks whose rays may lie in a range of normalized coordinates.
#[derive(Debug, Clone)]
pub(crate) enum Finder {
    /// Without distortion, columns and rows are at hand.
    Linear { focal: [f32; 2], center: [f32; 2], size: [f32; 2] },
    /// Else a table tells.
    Table(Table),
}

/// Cells of the plane of normalized coordinates, each with the blocks whose rays fall in.
#[derive(Debug, Clone)]
pub(crate) struct Table {
    /// Ranges of the squeezed coordinates.
    low: [f32; 2],
    high: [f32; 2],
    size: [usize; 2],
    cells: Vec<BlockRange>,
}

const EMPTY: BlockRange = [u16::MAX, 0, u16::MAX, 0];

impl Finder {
    pub(crate) fn new(camera: &Camera, rays: &Rays) -> Self {
        if matches!(camera.model, CameraModel::SimplePinhole | CameraModel::Pinhole) {
            let (focal, center) = (camera.focal(), camera.principal_point());
            return Self::Linear {
                focal: [focal.x as f32, focal.y as f32],
                center: [center.x as f32, center.y as f32],
                size: [camera.width as f32, camera.height as f32],
            };
        }
        Self::Table(Table::new(rays))
    }

    /// Blocks that may have rays with `low <= (x, y) <= high`; `None` if there are none.
    #[inline(always)]
    pub(crate) fn blocks(&self, low: [f32; 2], high: [f32; 2]) -> Option<BlockRange> {
        match self {
            Self::Linear { focal, center, size } => {
                let mut range = [0; 4];
                for axis in 0..2 {
                    // Pixel centers within, a hair wider than rounding errs.
                    let pixel = |v: f32| focal[axis] * v + center[axis] - 0.5;
                    let first = (pixel(low[axis]) - 0.01).max(0.0).ceil();
                    let last = (pixel(high[axis]) + 0.01).min(size[axis] - 1.0).floor();
                    if first.is_nan() || last.is_nan() || first > last {
                        return None;
                    }
                    range[2 * axis] = first as u16 / BLOCK as u16;
                    range[2 * axis + 1] = last as u16 / BLOCK as u16;
                }
                Some(range)
            }
            Self::Table(table) => table.blocks(low, high),
        }
    }
}

impl Table {
    fn new(rays: &Rays) -> Self {
        let bounds = rays.bounds;
        let low = [squeeze(bounds.low[0]), squeeze(bounds.low[1])];
        let high = [squeeze(bounds.high[0]), squeeze(bounds.high[1])];
        let size = [rays.columns * CELLS_PER_BLOCK, rays.rows * CELLS_PER_BLOCK];
        let mut table = Self { low, high, size, cells: vec![EMPTY; size[0] * size[1]] };
        for row in 0..rays.rows {
            for column in 0..rays.columns {
                let bounds = rays.bounds_of(column..column + 1, row..row + 1);
                let Some([c0, c1, r0, r1]) = table.cells_of(bounds.low, bounds.high) else {
                    continue;
                };
                for r in r0..=r1 {
                    for cell in &mut table.cells[r * size[0] + c0..=r * size[0] + c1] {
                        let [a, b, c, d] = *cell;
                        let (column, row) = (column as u16, row as u16);
                        *cell = [a.min(column), b.max(column), c.min(row), d.max(row)];
                    }
                }
            }
        }
        table
    }

    /// First and last cell along x, along y.
    fn cells_of(&self, low: [f32; 2], high: [f32; 2]) -> Option<[usize; 4]> {
        let mut range = [0; 4];
        for axis in 0..2 {
            let scale = self.size[axis] as f32 / (self.high[axis] - self.low[axis]);
            let (from, to) = (squeeze(low[axis]), squeeze(high[axis]));
            let is_within = from <= self.high[axis] && to >= self.low[axis] && from <= to;
            if !is_within {
                return None;
            }
            let last = self.size[axis] - 1;
            let place = |v: f32| (((v - self.low[axis]) * scale).max(0.0) as usize).min(last);
            range[2 * axis] = place(from - 1e-6);
            range[2 * axis + 1] = place(to + 1e-6);
        }
        Some(range)
    }

    fn blocks(&self, low: [f32; 2], high: [f32; 2]) -> Option<BlockRange> {
        let [c0, c1, r0, r1] = self.cells_of(low, high)?;
        let mut range = EMPTY;
        for r in r0..=r1 {
            for cell in &self.cells[r * self.size[0] + c0..=r * self.size[0] + c1] {
                range = [
                    range[0].min(cell[0]),
                    range[1].max(cell[1]),
                    range[2].min(cell[2]),
                    range[3].max(cell[3]),
                ];
            }
        }
        (range[0] <= range[1]).then_some(range)
    }
}

/// Monotone, into (−1, 1): wide lenses have their rays far out.
fn squeeze(v: f32) -> f32 {
    v / (1.0 + v.abs())
}
