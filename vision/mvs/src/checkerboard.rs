//! A plane for every pixel, laid out so that one color of a checkerboard changes while the other is
//! read.

use rayon::prelude::*;

use crate::patch::{LANES, Lanes};
use crate::plane::{Plane, Planes};

/// Sources that judge sixteen pixels, those that agree best with what the pixels believe.
pub(crate) const JURY: usize = 4;
/// Numbers of a cell.
const NUMBERS: usize = 4;

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

/// Sixteen cells, number by number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Cells {
    pub(crate) planes: Planes,
    pub(crate) costs: Lanes,
    pub(crate) jury: Jury,
}

/// The sources that judge sixteen pixels.
pub(crate) type Jury = [u8; JURY];

/// A plane for every pixel; the pixels of the two colors of a checkerboard lie apart, so that one
/// color is changed while the other is read.
#[derive(Debug, Clone)]
pub(crate) struct Field {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Per color, row by row: inverse depths, both slopes and costs of [`Self::half`] pixels each,
    /// of which the last may be spare.
    colors: [Vec<f32>; 2],
    /// Per color, row by row, for every sixteen pixels.
    juries: [Vec<Jury>; 2],
}

impl Field {
    pub(crate) fn new(width: usize, height: usize, cell: impl Fn(usize, usize) -> Cell) -> Self {
        let half = width.div_ceil(2);
        let colors = [0, 1].map(|color| {
            let mut numbers = vec![0.0; NUMBERS * half * height];
            for (y, row) in numbers.chunks_exact_mut(NUMBERS * half).enumerate() {
                for i in 0..half {
                    let Cell { plane, cost } = cell(column(color, i, y).min(width - 1), y);
                    for (k, value) in
                        [plane.w, plane.slope_u, plane.slope_v, cost].into_iter().enumerate()
                    {
                        row[k * half + i] = value;
                    }
                }
            }
            numbers
        });
        let juries = [0, 1].map(|_| vec![Jury::default(); half.div_ceil(LANES) * height]);
        Self { width, height, colors, juries }
    }

    fn half(&self) -> usize {
        self.width.div_ceil(2)
    }

    /// Lets `change` work on all pixels of one color, sixteen at a time, while the other color
    /// stays as it is.
    pub(crate) fn change(
        &mut self,
        color: usize,
        change: impl Fn(&Block, &Neighbors, &mut Cells) + Sync,
    ) {
        let (width, height, half) = (self.width, self.height, self.half());
        let [first, second] = &mut self.colors;
        let (own, other) = if color == 0 { (first, &*second) } else { (second, &*first) };
        let neighbors = Neighbors { numbers: other, width, height, half };
        let juries = self.juries[color].par_chunks_mut(half.div_ceil(LANES));
        own.par_chunks_mut(NUMBERS * half).zip(juries).enumerate().for_each(
            |(y, (row, juries))| {
                for (start, jury) in (0..half).step_by(LANES).zip(juries) {
                    let block = Block::new(color, start, y, width);
                    let [w, slope_u, slope_v, costs] =
                        std::array::from_fn(|k| block.indices.map(|i| row[k * half + i]));
                    let mut cells = Cells { planes: [w, slope_u, slope_v], costs, jury: *jury };
                    change(&block, &neighbors, &mut cells);
                    let Cells { planes: [w, slope_u, slope_v], costs, .. } = cells;
                    for (k, lanes) in [w, slope_u, slope_v, costs].iter().enumerate() {
                        let run = &mut row[k * half + start..][..block.num_lanes];
                        run.copy_from_slice(&lanes[..block.num_lanes]);
                    }
                    *jury = cells.jury;
                }
            },
        );
    }

    pub(crate) fn get(&self, x: usize, y: usize) -> Cell {
        let half = self.half();
        let row = &self.colors[(x + y) % 2][NUMBERS * half * y..];
        let [w, slope_u, slope_v, cost] = std::array::from_fn(|k| row[k * half + x / 2]);
        Cell { plane: Plane { w, slope_u, slope_v }, cost }
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
    numbers: &'a [f32],
    width: usize,
    height: usize,
    half: usize,
}

impl Neighbors<'_> {
    /// The cheapest planes in a direction, moved to the pixels; their `own` where there is none.
    #[inline(always)]
    pub(crate) fn best(&self, block: &Block, direction: usize, own: &Planes) -> Planes {
        let mut best = *own;
        let mut least = [f32::INFINITY; LANES];
        for [across, along] in UPWARD {
            let [dx, dy] = match direction {
                0 => [across, along],
                1 => [across, -along],
                2 => [along, across],
                _ => [-along, across],
            };
            // What is less than zero wraps to more than any size.
            let y = block.y.wrapping_add_signed(dy);
            if y >= self.height {
                continue;
            }
            let row = &self.numbers[NUMBERS * self.half * y..][..NUMBERS * self.half];
            let [first, last] = [0, LANES - 1].map(|k| block.columns[k].wrapping_add_signed(dx));
            let [w, slope_u, slope_v, costs]: [Lanes; NUMBERS] =
                if block.num_lanes == LANES && first < self.width && last < self.width {
                    std::array::from_fn(|k| {
                        let run = &row[k * self.half + first / 2..];
                        *run.first_chunk().expect("the last of them is in the row")
                    })
                } else {
                    let at = block.columns.map(|x| x.wrapping_add_signed(dx));
                    let known = |k: usize| {
                        at.map(|x| {
                            if x < self.width { row[k * self.half + x / 2] } else { f32::INFINITY }
                        })
                    };
                    [known(0), known(1), known(2), known(3)]
                };
            let (dx, dy) = (dx as f32, dy as f32);
            for lane in 0..LANES {
                let better = costs[lane] < least[lane];
                let moved = w[lane] - slope_u[lane] * dx - slope_v[lane] * dy;
                best[0][lane] = if better { moved } else { best[0][lane] };
                best[1][lane] = if better { slope_u[lane] } else { best[1][lane] };
                best[2][lane] = if better { slope_v[lane] } else { best[2][lane] };
                least[lane] = if better { costs[lane] } else { least[lane] };
            }
        }
        best
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
                    for (lane, x) in block.columns.into_iter().enumerate() {
                        assert_eq!(cells.planes[0][lane], (block.y * width + x) as f32);
                        cells.costs[lane] += 1.0;
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
        // In the middle, and at the right and the left rim, where blocks are not full.
        for (own_x, direction, [y, x]) in [
            (20, 0, [9, 20]),
            (20, 1, [31, 20]),
            (20, 2, [20, 9]),
            (20, 3, [20, 31]),
            (64, 0, [9, 64]),
            (64, 2, [20, 53]),
            (0, 1, [31, 0]),
            (0, 3, [20, 11]),
        ] {
            let mut field = Field::new(65, 41, |at_x, at_y| {
                let cost = if (at_x, at_y) == (x, y) { 0.1 } else { 1.0 };
                let own = if cost < 1.0 { 7.0 } else { 0.0 };
                Cell { plane: Plane { w: own, slope_u: 0.5, slope_v: 0.25 }, cost }
            });
            let expected = 7.0 + 0.5 * (own_x as f32 - x as f32) + 0.25 * (20.0 - y as f32);
            field.change(0, |block, neighbors, cells| {
                let lane = block.columns.iter().position(|&column| column == own_x);
                if let Some(lane) = lane.filter(|_| block.y == 20) {
                    let best = neighbors.best(block, direction, &cells.planes)[0][lane];
                    assert_eq!(best, expected, "direction {direction} of {own_x}");
                }
            });
        }
    }
}
