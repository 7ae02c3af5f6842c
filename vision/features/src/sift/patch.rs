//! Gradient patches about keypoints: orientations and descriptors (Lowe 2004, sections 5 and 6).

use std::f32::consts::TAU;

use volery_scene::{DESCRIPTOR_LEN, Descriptor};

use super::math::{atan2, exp_negative};
use super::pyramid::Plane;
use crate::simd::{SimdLevel, multiversion};

const NUM_ORIENTATION_BINS: usize = 36;
/// Window of the orientation histogram, in keypoint scales.
const ORIENTATION_WINDOW: f32 = 1.5;
/// A second peak of at least this part of the highest gives a second orientation.
const PEAK_RATIO: f32 = 0.8;
/// Most orientations of a keypoint (COLMAP's).
const MAX_ORIENTATIONS: usize = 2;
/// Side of a spatial bin of the descriptor, in keypoint scales.
const BIN_SIZE: f32 = 3.0;
/// Sigma of the descriptor's window, in spatial bins.
const DESCRIPTOR_WINDOW: f32 = 2.0;
/// No entry of the unit descriptor exceeds this before the root is taken, against glare.
const CLAMP: f32 = 0.2;
/// Bytes per unit: 256 gives a norm of 256 and bytes that rarely reach 127.
const BYTES_PER_UNIT: f32 = 256.0;
/// Samples handled at once.
const CHUNK: usize = 16;

/// Place and size of a keypoint in its Gaussian level, pixels of the octave.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    pub(super) x: f32,
    pub(super) y: f32,
    pub(super) sigma: f32,
}

/// Samples of a patch, reused from keypoint to keypoint.
#[derive(Debug, Default)]
pub(super) struct Samples {
    /// Gradient.
    dx: Vec<f32>,
    dy: Vec<f32>,
    /// Position relative to the keypoint.
    u: Vec<f32>,
    v: Vec<f32>,
    /// Windowed gradient magnitude.
    weight: Vec<f32>,
    /// Gradient direction in bins.
    bin: Vec<f32>,
    /// First of the four spatial bins a sample falls into.
    cell: Vec<i32>,
    len: usize,
}

impl Samples {
    fn clear(&mut self) {
        self.len = 0;
    }

    fn reserve(&mut self, additional: usize) {
        let len = (self.len + additional).next_multiple_of(CHUNK);
        if self.dx.len() < len {
            for values in [
                &mut self.dx,
                &mut self.dy,
                &mut self.u,
                &mut self.v,
                &mut self.weight,
                &mut self.bin,
            ] {
                values.resize(len, 0.0);
            }
            self.cell.resize(len, 0);
        }
    }
}

/// Orientations of a keypoint, strongest first, radians in (-π, π].
pub(super) fn orientations(
    simd: SimdLevel,
    plane: &Plane,
    place: Place,
    samples: &mut Samples,
) -> impl Iterator<Item = f32> {
    let sigma = ORIENTATION_WINDOW * place.sigma;
    let radius = 3.0 * sigma;
    samples.clear();
    let along_x = [1.0, 0.0];
    for (y, from, to) in rows_of(plane, place, radius) {
        // Chord of the disk in this row.
        let dy = y as f32 - place.y;
        let half = (radius * radius - dy * dy).max(0.0).sqrt();
        let from = from.max((place.x - half).ceil().max(1.0) as usize);
        let to = to.min((place.x + half).floor().max(0.0) as usize + 1);
        if from < to {
            push_row(simd, plane, y, from..to, place, along_x, samples);
        }
    }
    let mut histogram = [0.0f32; NUM_ORIENTATION_BINS];
    orientation_votes(simd, samples, 1.0 / (2.0 * sigma * sigma));
    for (&weight, &bin) in samples.weight.iter().zip(&samples.bin).take(samples.len) {
        // Bin i is centered at i + 1/2.
        let shifted = bin - 0.5;
        let first = shifted.floor();
        let part = shifted - first;
        let first = (first as i32).rem_euclid(NUM_ORIENTATION_BINS as i32) as usize;
        histogram[first] += (1.0 - part) * weight;
        histogram[(first + 1) % NUM_ORIENTATION_BINS] += part * weight;
    }
    peaks(&smoothed(histogram))
}

/// RootSIFT descriptor of a keypoint turned by `angle`.
pub(super) fn descriptor(
    simd: SimdLevel,
    plane: &Plane,
    place: Place,
    angle: f32,
    samples: &mut Samples,
) -> Descriptor {
    let (sin, cos) = angle.sin_cos();
    let bin_size = BIN_SIZE * place.sigma;
    // Half the side of the 5 x 5 bins that reach into the 4 x 4 by interpolation.
    let reach = 2.5 * bin_size;
    samples.clear();
    for (y, from, to) in rows_of(plane, place, reach * (sin.abs() + cos.abs())) {
        let dy = y as f32 - place.y;
        // |cos dx + sin dy| < reach and |−sin dx + cos dy| < reach, solved for dx.
        let (low1, high1) = chord(cos, sin * dy, reach);
        let (low2, high2) = chord(-sin, cos * dy, reach);
        let low = (place.x + low1.max(low2)).ceil().max(1.0);
        let high = (place.x + high1.min(high2)).floor();
        if high < low {
            continue;
        }
        let (from, to) = (from.max(low as usize), to.min(high as usize + 1));
        if from < to {
            push_row(simd, plane, y, from..to, place, [cos / bin_size, sin / bin_size], samples);
        }
    }
    descriptor_votes(simd, samples, angle);
    let mut histogram = [[0.0f32; 8]; PADDED_CELLS];
    accumulate(simd, samples, &mut histogram);
    root_sift(&histogram)
}

/// Rows about `place` within `radius` with the columns that have neighbors on all sides.
fn rows_of(
    plane: &Plane,
    place: Place,
    radius: f32,
) -> impl Iterator<Item = (usize, usize, usize)> + use<> {
    let top = (place.y - radius).ceil().max(1.0) as usize;
    let bottom = ((place.y + radius).floor().max(0.0) as usize + 1).min(plane.height - 1);
    let width = plane.width;
    (top..bottom).map(move |y| (y, 1, width - 1))
}

/// Interval of `t` with `|slope t + offset| < reach`.
fn chord(slope: f32, offset: f32, reach: f32) -> (f32, f32) {
    if slope.abs() < 1e-6 {
        return if offset.abs() < reach {
            (f32::NEG_INFINITY, f32::INFINITY)
        } else {
            (f32::INFINITY, f32::NEG_INFINITY)
        };
    }
    let (a, b) = ((-reach - offset) / slope, (reach - offset) / slope);
    (a.min(b), a.max(b))
}

/// Appends the gradients of `columns` of row `y` and their positions `R (p − place)`, where the
/// first row of R is `axis` and the second is perpendicular to it.
fn push_row(
    simd: SimdLevel,
    plane: &Plane,
    y: usize,
    columns: std::ops::Range<usize>,
    place: Place,
    axis: [f32; 2],
    samples: &mut Samples,
) {
    samples.reserve(columns.len());
    let range = samples.len..samples.len + columns.len();
    samples.len = range.end;
    let offset = [columns.start as f32 - place.x, y as f32 - place.y];
    gradient_row(
        simd,
        [
            &plane.row(y - 1)[columns.clone()],
            &plane.row(y + 1)[columns.clone()],
            &plane.row(y)[columns.start - 1..columns.end - 1],
            &plane.row(y)[columns.start + 1..columns.end + 1],
        ],
        offset,
        axis,
        [
            &mut samples.dx[range.clone()],
            &mut samples.dy[range.clone()],
            &mut samples.u[range.clone()],
            &mut samples.v[range],
        ],
    );
}

multiversion! {
    fn gradient_row(
        neighbors: [&[f32]; 4],
        offset: [f32; 2],
        axis: [f32; 2],
        out: [&mut [f32]; 4],
    ) {
        let [up, down, left, right] = neighbors;
        let [dx, dy, u, v] = out;
        let n = dx.len();
        let (dy, u, v) = (&mut dy[..n], &mut u[..n], &mut v[..n]);
        let (up, down, left, right) = (&up[..n], &down[..n], &left[..n], &right[..n]);
        let (u0, v0) = (axis[1] * offset[1], axis[0] * offset[1]);
        for i in 0..n {
            dx[i] = right[i] - left[i];
            dy[i] = down[i] - up[i];
            let x = offset[0] + i as i32 as f32;
            u[i] = axis[0] * x + u0;
            v[i] = v0 - axis[1] * x;
        }
    }
}

multiversion! {
    /// Windowed magnitude and direction in bins of every sample.
    fn orientation_votes(samples: &mut Samples, falloff: f32) {
        let n = samples.len.next_multiple_of(CHUNK);
        let (dx, dy) = (&samples.dx[..n], &samples.dy[..n]);
        let (u, v) = (&samples.u[..n], &samples.v[..n]);
        let (weight, bin) = (&mut samples.weight[..n], &mut samples.bin[..n]);
        for i in 0..n {
            let magnitude = (dx[i] * dx[i] + dy[i] * dy[i]).sqrt();
            weight[i] = magnitude * exp_negative((u[i] * u[i] + v[i] * v[i]) * falloff);
            bin[i] = atan2(dy[i], dx[i]) * (NUM_ORIENTATION_BINS as f32 / TAU);
        }
    }
}

/// Side of the 4 x 4 spatial bins with a rim of one.
const PADDED_SIDE: usize = 6;
/// Room for any index that [`accumulate`] can form.
const PADDED_CELLS: usize = 40;

multiversion! {
    /// Windowed magnitude, direction in eighths of a turn, and place among the spatial bins; `u`
    /// and `v` become the parts that belong to the next bin.
    fn descriptor_votes(samples: &mut Samples, angle: f32) {
        let n = samples.len.next_multiple_of(CHUNK);
        let (dx, dy) = (&samples.dx[..n], &samples.dy[..n]);
        let (u, v) = (&mut samples.u[..n], &mut samples.v[..n]);
        let (weight, bin) = (&mut samples.weight[..n], &mut samples.bin[..n]);
        let cell = &mut samples.cell[..n];
        let falloff = 1.0 / (2.0 * DESCRIPTOR_WINDOW * DESCRIPTOR_WINDOW);
        for i in 0..n {
            let magnitude = (dx[i] * dx[i] + dy[i] * dy[i]).sqrt();
            weight[i] = magnitude * exp_negative((u[i] * u[i] + v[i] * v[i]) * falloff);
            let turned = (atan2(dy[i], dx[i]) - angle) * (8.0 / TAU);
            let turned = if turned < 0.0 { turned + 8.0 } else { turned };
            bin[i] = if turned >= 8.0 { turned - 8.0 } else { turned };
            // Spatial bin j is centered at j − 3/2; the rim makes −1 the first. Truncation is the
            // floor of what is not negative.
            let (x, y) = (clamp(u[i] + 2.5), clamp(v[i] + 2.5));
            let (column, row) = (x as i32, y as i32);
            u[i] = x - column as f32;
            v[i] = y - row as f32;
            cell[i] = row * PADDED_SIDE as i32 + column;
        }
    }
}

/// To [0, 5), the bins with their rim.
#[inline(always)]
fn clamp(t: f32) -> f32 {
    let t = if t > 0.0 { t } else { 0.0 };
    if t < 4.999 { t } else { 4.999 }
}

multiversion! {
    /// Trilinear votes (Lowe 2004, section 6.1).
    fn accumulate(samples: &Samples, histogram: &mut [[f32; 8]; PADDED_CELLS]) {
        let n = samples.len;
        let (u, v, cell) = (&samples.u[..n], &samples.v[..n], &samples.cell[..n]);
        let (weight, bin) = (&samples.weight[..n], &samples.bin[..n]);
        const LANES: [f32; 8] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];
        for i in 0..n {
            let mut votes = [0.0f32; 8];
            for (vote, lane) in votes.iter_mut().zip(LANES) {
                let distance = (bin[i] - lane).abs();
                let around = 8.0 - distance;
                let distance = if distance < around { distance } else { around };
                let part = 1.0 - distance;
                *vote = if part > 0.0 { part } else { 0.0 } * weight[i];
            }
            let first = (cell[i] & 31) as usize;
            let parts = [
                (0, (1.0 - u[i]) * (1.0 - v[i])),
                (1, u[i] * (1.0 - v[i])),
                (PADDED_SIDE, (1.0 - u[i]) * v[i]),
                (PADDED_SIDE + 1, u[i] * v[i]),
            ];
            for (step, part) in parts {
                let bins = &mut histogram[first + step];
                for l in 0..8 {
                    bins[l] += part * votes[l];
                }
            }
        }
    }
}

/// Clamped histogram → root of the L1-normalized vector, in bytes.
///
/// Arandjelović and Zisserman, "Three things everyone should know to improve object retrieval",
/// CVPR 2012: the Euclidean distance of the roots is the Hellinger distance of the histograms.
fn root_sift(histogram: &[[f32; 8]; PADDED_CELLS]) -> Descriptor {
    let mut values = [0.0f32; DESCRIPTOR_LEN];
    for (bins, chunk) in values.as_chunks_mut::<8>().0.iter_mut().enumerate() {
        let (row, column) = (bins / 4, bins % 4);
        *chunk = histogram[(row + 1) * PADDED_SIDE + column + 1];
    }
    let norm = values.iter().map(|v| v * v).sum::<f32>().sqrt();
    let limit = CLAMP * norm;
    for value in &mut values {
        *value = value.min(limit);
    }
    let sum: f32 = values.iter().sum();
    let scale = if sum > 0.0 { 1.0 / sum } else { 0.0 };
    values.map(|v| ((v * scale).sqrt() * BYTES_PER_UNIT + 0.5).min(127.0) as u8)
}

/// Six passes of a circular box of three, as VLFeat does.
fn smoothed(mut histogram: [f32; NUM_ORIENTATION_BINS]) -> [f32; NUM_ORIENTATION_BINS] {
    const N: usize = NUM_ORIENTATION_BINS;
    for _ in 0..6 {
        let before = histogram;
        for (i, value) in histogram.iter_mut().enumerate() {
            *value = (before[(i + N - 1) % N] + before[i] + before[(i + 1) % N]) / 3.0;
        }
    }
    histogram
}

/// Angles of the highest local maxima, by parabola through a peak and its neighbors.
fn peaks(histogram: &[f32; NUM_ORIENTATION_BINS]) -> impl Iterator<Item = f32> + use<> {
    const N: usize = NUM_ORIENTATION_BINS;
    let highest = histogram.iter().copied().fold(0.0, f32::max);
    let mut found: [Option<(f32, f32)>; MAX_ORIENTATIONS] = [None; MAX_ORIENTATIONS];
    for i in 0..N {
        let (before, value, after) =
            (histogram[(i + N - 1) % N], histogram[i], histogram[(i + 1) % N]);
        if value <= 0.0 || value < PEAK_RATIO * highest || value <= before || value <= after {
            continue;
        }
        let offset = -0.5 * (after - before) / (after + before - 2.0 * value);
        let angle = TAU * (i as f32 + offset + 0.5) / N as f32;
        let angle = if angle > TAU / 2.0 { angle - TAU } else { angle };
        let mut candidate = Some((value, angle));
        for slot in &mut found {
            if candidate.map(|c| c.0) > slot.map(|s| s.0) {
                std::mem::swap(slot, &mut candidate);
            }
        }
    }
    found.into_iter().flatten().map(|(_, angle)| angle)
}
