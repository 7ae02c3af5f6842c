//! Extrema of the difference of Gaussians and their sub-pixel place (Lowe 2004, sections 3.1, 4).

use super::pyramid::{NUM_LEVELS, Plane, SCALES_PER_OCTAVE};
use crate::simd::{SimdLevel, multiversion};

const NUM_DOG: usize = NUM_LEVELS - 1;
/// Pixels of the octave next to the border where nothing is sought.
const BORDER: usize = 4;
/// Steps of the interpolation before it is given up.
const MAX_STEPS: usize = 5;
/// An offset beyond this moves to the next sample.
const MAX_OFFSET: f32 = 0.6;
/// Part of the contrast threshold a sample must reach before interpolation (VLFeat's).
const SAMPLE_CONTRAST: f32 = 0.8;

/// An interpolated extremum, in pixels of its octave, pixel centers at integers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Extremum {
    pub(super) x: f32,
    pub(super) y: f32,
    /// Fractional level.
    pub(super) level: f32,
    /// Gaussian level next to it.
    pub(super) nearest_level: usize,
    /// Interpolated DoG value.
    pub(super) response: f32,
}

/// Thresholds of [`find_extrema`].
#[derive(Debug, Clone, Copy)]
pub(super) struct Thresholds {
    pub(super) peak: f32,
    pub(super) edge: f32,
}

/// Extrema of one octave, each once, by row, then column, then level.
pub(super) fn find_extrema(
    simd: SimdLevel,
    levels: &[Plane; NUM_LEVELS],
    thresholds: Thresholds,
) -> Vec<Extremum> {
    let (width, height) = (levels[0].width, levels[0].height);
    let mut extrema = Vec::new();
    if width <= 2 * BORDER || height <= 2 * BORDER {
        return extrema;
    }
    let stride = levels[0].row(0).len();
    let mut dog: [[Vec<f32>; 3]; NUM_DOG] = Default::default();
    for row in dog.iter_mut().flatten() {
        row.resize(stride, 0.0);
    }
    let subtract = |dog: &mut [[Vec<f32>; 3]; NUM_DOG], y: usize| {
        for (level, rows) in dog.iter_mut().enumerate() {
            difference(simd, levels[level + 1].row(y), levels[level].row(y), &mut rows[y % 3]);
        }
    };
    subtract(&mut dog, BORDER - 1);
    subtract(&mut dog, BORDER);
    let (mut highest, mut lowest) = (vec![0.0; stride], vec![0.0; stride]);
    let mut flags = vec![0u8; width.next_multiple_of(8)];
    let pre_threshold = SAMPLE_CONTRAST * thresholds.peak;
    for y in BORDER..height - BORDER {
        subtract(&mut dog, y + 1);
        for level in 1..=SCALES_PER_OCTAVE {
            let rows: [&[f32]; 9] =
                std::array::from_fn(|k| &dog[level + k / 3 - 1][(y + k % 3 + 2) % 3][..width]);
            column_range(simd, &rows, &mut highest[..width], &mut lowest[..width]);
            let middle = &dog[level][y % 3][..width];
            flag_extrema(simd, middle, &highest, &lowest, pre_threshold, &mut flags[..width]);
            for (word_index, word) in flags.as_chunks::<8>().0.iter().enumerate() {
                if u64::from_ne_bytes(*word) == 0 {
                    continue;
                }
                for (bit, &flag) in word.iter().enumerate() {
                    let x = word_index * 8 + bit;
                    if flag != 0
                        && (BORDER..width - BORDER).contains(&x)
                        && is_first_of_equals(&rows, x)
                        && let Some(extremum) = refine(levels, x, y, level, thresholds)
                    {
                        extrema.push(extremum);
                    }
                }
            }
        }
    }
    // Neighboring samples may lead to one extremum.
    let key = |e: &Extremum| (e.y, e.x, e.level);
    extrema.sort_by(|a, b| {
        let (a, b) = (key(a), key(b));
        a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.total_cmp(&b.2))
    });
    extrema.dedup_by_key(|e| key(e));
    extrema
}

multiversion! {
    fn difference(minuend: &[f32], subtrahend: &[f32], out: &mut [f32]) {
        for ((out, a), b) in out.iter_mut().zip(minuend).zip(subtrahend) {
            *out = a - b;
        }
    }
}

multiversion! {
    /// Greatest and least of the nine rows, column by column.
    fn column_range(rows: &[&[f32]; 9], highest: &mut [f32], lowest: &mut [f32]) {
        let n = highest.len();
        let lowest = &mut lowest[..n];
        let rows = rows.map(|row| &row[..n]);
        for x in 0..n {
            let (mut high, mut low) = (rows[0][x], rows[0][x]);
            for row in &rows[1..] {
                let value = row[x];
                high = if value > high { value } else { high };
                low = if value < low { value } else { low };
            }
            highest[x] = high;
            lowest[x] = low;
        }
    }
}

multiversion! {
    /// Flags the samples of `middle` beyond the threshold that no neighbor exceeds.
    fn flag_extrema(
        middle: &[f32],
        highest: &[f32],
        lowest: &[f32],
        threshold: f32,
        flags: &mut [u8],
    ) {
        let n = flags.len() - 2;
        let values = &middle[1..n + 1];
        let (h0, h1, h2) = (&highest[..n], &highest[1..n + 1], &highest[2..n + 2]);
        let (l0, l1, l2) = (&lowest[..n], &lowest[1..n + 1], &lowest[2..n + 2]);
        let flags = &mut flags[1..n + 1];
        for x in 0..n {
            let value = values[x];
            let peak = (value > threshold) & (value >= h0[x]) & (value >= h1[x]) & (value >= h2[x]);
            let pit = (value < -threshold) & (value <= l0[x]) & (value <= l1[x]) & (value <= l2[x]);
            flags[x] = u8::from(peak | pit);
        }
    }
}

/// Whether no earlier neighbor has the same value, so that a plateau yields one extremum.
fn is_first_of_equals(rows: &[&[f32]; 9], x: usize) -> bool {
    let value = rows[4][x];
    rows[..4].iter().all(|row| row[x - 1..=x + 1].iter().all(|&v| v != value))
        && rows[4][x - 1] != value
}

/// Fits a quadratic to the 3 x 3 x 3 samples about `(x, y, level)` and moves to its extremum.
///
/// `D(x) = D + gᵀx + ½ xᵀHx`, extremum `x̂ = −H⁻¹g` (3), value `D + ½ gᵀx̂`.
fn refine(
    levels: &[Plane; NUM_LEVELS],
    mut x: usize,
    mut y: usize,
    mut level: usize,
    thresholds: Thresholds,
) -> Option<Extremum> {
    let (width, height) = (levels[0].width, levels[0].height);
    for step in 0..MAX_STEPS {
        let d = |dx: usize, dy: usize, ds: usize| {
            let (x, y, s) = (x + dx - 1, y + dy - 1, level + ds - 1);
            levels[s + 1].at(x, y) - levels[s].at(x, y)
        };
        let center = d(1, 1, 1);
        let gx = 0.5 * (d(2, 1, 1) - d(0, 1, 1));
        let gy = 0.5 * (d(1, 2, 1) - d(1, 0, 1));
        let gs = 0.5 * (d(1, 1, 2) - d(1, 1, 0));
        let hxx = d(2, 1, 1) + d(0, 1, 1) - 2.0 * center;
        let hyy = d(1, 2, 1) + d(1, 0, 1) - 2.0 * center;
        let hss = d(1, 1, 2) + d(1, 1, 0) - 2.0 * center;
        let hxy = 0.25 * (d(2, 2, 1) + d(0, 0, 1) - d(0, 2, 1) - d(2, 0, 1));
        let hxs = 0.25 * (d(2, 1, 2) + d(0, 1, 0) - d(0, 1, 2) - d(2, 1, 0));
        let hys = 0.25 * (d(1, 2, 2) + d(1, 0, 0) - d(1, 0, 2) - d(1, 2, 0));
        let [ox, oy, os] = solve_symmetric([hxx, hxy, hxs, hyy, hys, hss], [-gx, -gy, -gs])?;
        let steps = [ox, oy, os].map(|o| {
            if o > MAX_OFFSET {
                1
            } else if o < -MAX_OFFSET {
                -1
            } else {
                0
            }
        });
        if steps != [0, 0, 0] {
            if step + 1 == MAX_STEPS || [ox, oy, os].iter().any(|o| o.abs() > 4.0) {
                return None;
            }
            x = x.checked_add_signed(steps[0])?;
            y = y.checked_add_signed(steps[1])?;
            level = level.checked_add_signed(steps[2])?;
            let inside = (1..width - 1).contains(&x)
                && (1..height - 1).contains(&y)
                && (1..=SCALES_PER_OCTAVE).contains(&level);
            if !inside {
                return None;
            }
            continue;
        }
        let response = center + 0.5 * (gx * ox + gy * oy + gs * os);
        let (trace, determinant) = (hxx + hyy, hxx * hyy - hxy * hxy);
        let r = thresholds.edge;
        let on_edge =
            determinant <= 0.0 || trace * trace * r >= (r + 1.0) * (r + 1.0) * determinant;
        if response.abs() < thresholds.peak || on_edge {
            return None;
        }
        return Some(Extremum {
            x: x as f32 + ox,
            y: y as f32 + oy,
            level: level as f32 + os,
            nearest_level: level,
            response,
        });
    }
    None
}

/// Solves `H x = b` for symmetric `H = [a b c; b d e; c e f]` by cofactors.
fn solve_symmetric([a, b, c, d, e, f]: [f32; 6], rhs: [f32; 3]) -> Option<[f32; 3]> {
    let [a, b, c, d, e, f] = [a, b, c, d, e, f].map(f64::from);
    let (c00, c01, c02) = (d * f - e * e, c * e - b * f, b * e - c * d);
    let (c11, c12, c22) = (a * f - c * c, b * c - a * e, a * d - b * b);
    let determinant = a * c00 + b * c01 + c * c02;
    let [x, y, z] = rhs.map(f64::from);
    let solution = [
        (c00 * x + c01 * y + c02 * z) / determinant,
        (c01 * x + c11 * y + c12 * z) / determinant,
        (c02 * x + c12 * y + c22 * z) / determinant,
    ];
    solution.iter().all(|v| v.is_finite()).then_some(solution.map(|v| v as f32))
}
