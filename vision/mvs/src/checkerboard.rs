//! A plane for every pixel, laid out so that one color of a checkerboard changes while the other is
//! read.

use rayon::prelude::*;

use crate::patch::LANES;
use crate::plane::Plane;

/// Pixels of the other color from which planes come, for each of four directions: near ones in
/// the shape of a V and far ones in a line, of which the best is taken.
///
/// Source: Xu and Tao, "Multi-Scale Geometric Consistency Guided Multi-View Stereo", CVPR 2019,
/// section 3.1.
const UPWARD: [[isize; 2]; 5] = [[0, -1], [-1, -2], [1, -2], [0, -5], [0, -11]];

/// The plane of a pixel and what speaks against it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Cell {
    pub(crate) plane: Plane,
    pub(crate) cost: f32,
}

/// A plane for every pixel; the pixels of the two colors of a checkerboard lie apart, so that one
/// color is changed while the other is read.
#[derive(Debug, Clone)]
pub(crate) struct Field {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Per color, row by row, [`Self::half`] per row; the last of a row may be spare.
    colors: [Vec<Cell>; 2],
}

impl Field {
    pub(crate) fn new(width: usize, height: usize, cell: impl Fn(usize, usize) -> Cell) -> Self {
        let half = width.div_ceil(2);
        let colors = [0, 1].map(|color| {
            let rows = (0..height).flat_map(|y| (0..half).map(move |i| (i, y)));
            rows.map(|(i, y)| cell(column(color, i, y).min(width - 1), y)).collect()
        });
        Self { width, height, colors }
    }

    fn half(&self) -> usize {
        self.width.div_ceil(2)
    }

    /// Lets `change` work on all pixels of one color, sixteen at a time, while the other color
    /// stays as it is.
    pub(crate) fn change(
        &mut self,
        color: usize,
        change: impl Fn(&Block, &Neighbors, &mut [Cell; LANES]) + Sync,
    ) {
        let (width, height, half) = (self.width, self.height, self.half());
        let [first, second] = &mut self.colors;
        let (own, other) = if color == 0 { (first, &*second) } else { (second, &*first) };
        let neighbors = Neighbors { cells: other, width, height, half };
        own.par_chunks_mut(half).enumerate().for_each(|(y, row)| {
            for start in (0..half).step_by(LANES) {
                let block = Block::new(color, start, y, width);
                let mut cells = block.indices.map(|i| row[i]);
                change(&block, &neighbors, &mut cells);
                row[start..start + block.num_lanes].copy_from_slice(&cells[..block.num_lanes]);
            }
        });
    }

    pub(crate) fn get(&self, x: usize, y: usize) -> &Cell {
        &self.colors[(x + y) % 2][y * self.half() + x / 2]
    }
}

/// Column of the `i`-th pixel of a color in row `y`.
fn column(color: usize, i: usize, y: usize) -> usize {
    2 * i + (y + color) % 2
}

/// Sixteen pixels of one color of a row. Lanes past the end repeat the last pixel.
pub(crate) struct Block {
    pub(crate) y: usize,
    pub(crate) columns: [usize; LANES],
    /// In the row of the color.
    indices: [usize; LANES],
    num_lanes: usize,
}

impl Block {
    fn new(color: usize, start: usize, y: usize, width: usize) -> Self {
        let num_in_row = (width - (y + color) % 2).div_ceil(2);
        let indices = std::array::from_fn(|lane| (start + lane).min(num_in_row - 1));
        let columns = indices.map(|i| column(color, i, y));
        let num_lanes = num_in_row.saturating_sub(start).min(LANES);
        Self { y, columns, indices, num_lanes }
    }
}

/// The pixels of the other color.
pub(crate) struct Neighbors<'a> {
    cells: &'a [Cell],
    width: usize,
    height: usize,
    half: usize,
}

impl Neighbors<'_> {
    /// The cheapest plane in a direction, moved to the pixel.
    pub(crate) fn best(&self, x: usize, y: usize, direction: usize) -> Option<Plane> {
        let mut best: Option<(&Cell, [isize; 2])> = None;
        for [across, along] in UPWARD {
            let [dx, dy] = match direction {
                0 => [across, along],
                1 => [across, -along],
                2 => [along, across],
                _ => [-along, across],
            };
            let (nx, ny) = (x.wrapping_add_signed(dx), y.wrapping_add_signed(dy));
            // What is less than zero wraps to more than any size.
            if nx >= self.width || ny >= self.height {
                continue;
            }
            let cell = &self.cells[ny * self.half + nx / 2];
            if best.is_none_or(|(other, _)| cell.cost < other.cost) {
                best = Some((cell, [dx, dy]));
            }
        }
        best.map(|(cell, [dx, dy])| cell.plane.moved(-dx as f32, -dy as f32))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbered(width: usize, height: usize) -> Field {
        Field::new(width, height, |x, y| {
            let w = (y * width + x) as f32;
            Cell { plane: Plane { w, slope_u: 0.0, slope_v: 0.0 }, cost: 0.0 }
        })
    }

    /// Every pixel is changed once by its color, also in rows that are no multiple of a block.
    #[test]
    fn two_colors_cover_every_pixel_once() {
        for (width, height) in [(16, 16), (33, 17), (70, 19)] {
            let mut field = numbered(width, height);
            for color in 0..2 {
                field.change(color, |block, _, cells| {
                    for (cell, x) in cells.iter_mut().zip(block.columns) {
                        assert_eq!(cell.plane.w, (block.y * width + x) as f32);
                        cell.cost += 1.0;
                    }
                });
            }
            let all = (0..width * height).map(|k| field.get(k % width, k / width));
            assert!(all.clone().all(|cell| cell.cost == 1.0));
            assert!(all.enumerate().all(|(k, cell)| cell.plane.w == k as f32));
        }
    }

    /// The cheapest of the neighbors in a direction, as a plane of the pixel that asks.
    #[test]
    fn good_planes_come_from_every_direction() {
        for (direction, [y, x]) in [[9, 20], [31, 20], [20, 9], [20, 31]].into_iter().enumerate() {
            let mut field = Field::new(41, 41, |at_x, at_y| {
                let cost = if (at_x, at_y) == (x, y) { 0.1 } else { 1.0 };
                let own = if cost < 1.0 { 7.0 } else { 0.0 };
                Cell { plane: Plane { w: own, slope_u: 0.5, slope_v: 0.25 }, cost }
            });
            let expected = 7.0 + 0.5 * (20.0 - x as f32) + 0.25 * (20.0 - y as f32);
            field.change(0, |block, neighbors, _| {
                if block.y == 20 {
                    let best = neighbors.best(20, 20, direction).map(|plane| plane.w);
                    assert_eq!(best, Some(expected), "direction {direction}");
                }
            });
        }
    }
}
