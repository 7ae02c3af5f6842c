//! The part of an image that one thread draws.

use std::ops::Range;

use crate::simd::LANES;
use crate::virtual_camera::BLOCK;

/// What a pixel without a surface shows.
pub(crate) const NOTHING: u32 = u32::MAX;

/// Some rows of blocks.
pub(crate) struct Band {
    /// Rows of blocks.
    pub(crate) rows: Range<usize>,
    pub(crate) columns: usize,
    /// Inverse depth, 0 where nothing is.
    pub(crate) inverse_depth: Vec<[f32; LANES]>,
    /// Number of the triangle or point that is seen.
    pub(crate) ids: Vec<[u32; LANES]>,
    pub(crate) colors: Vec<[[u8; 3]; LANES]>,
}

impl Band {
    pub(crate) fn new(rows: Range<usize>, columns: usize) -> Self {
        let num_blocks = rows.len() * columns;
        Self {
            rows,
            columns,
            inverse_depth: vec![[0.0; LANES]; num_blocks],
            ids: vec![[NOTHING; LANES]; num_blocks],
            colors: vec![[[0; 3]; LANES]; num_blocks],
        }
    }

    /// Rows of pixels from blocks.
    pub(crate) fn copy_to(&self, width: usize, colors: &mut [[u8; 3]], depth: &mut [f32]) {
        let rows = colors.chunks_mut(width).zip(depth.chunks_mut(width));
        for (y, (colors, depth)) in rows.enumerate() {
            let start = y / BLOCK * self.columns;
            for (x, (color, depth)) in colors.iter_mut().zip(depth).enumerate() {
                let (block, lane) = (start + x / BLOCK, y % BLOCK * BLOCK + x % BLOCK);
                *color = self.colors[block][lane];
                let w = self.inverse_depth[block][lane];
                *depth = if w > 0.0 { 1.0 / w } else { 0.0 };
            }
        }
    }
}
