//! Gaussian scale space (Lowe, "Distinctive Image Features from Scale-Invariant Keypoints", IJCV
//! 2004, sections 3 and 3.3).

use volery_scene::GrayImage;

use crate::simd::{SimdLevel, multiversion};

/// Scales per octave at which extrema are sought.
pub(super) const SCALES_PER_OCTAVE: usize = 3;
/// Gaussian levels per octave.
pub(super) const NUM_LEVELS: usize = SCALES_PER_OCTAVE + 3;
/// Blur of level 0 of every octave, pixels of the octave.
pub(super) const SIGMA0: f32 = 1.6;
/// Variance that level 0 of the first octave has beyond [`SIGMA0`]², pixels² of that octave; further
/// octaves inherit it. Fewer extrema of the finest scales then hide below the first level. Measured
/// between neighbors: 1.6 (warehouse) and 1.3 (kitchen) times the inliers at a smaller or equal
/// epipolar error.
const EXCESS_VARIANCE: f32 = 1.6;
/// Blur the camera is assumed to have given the image already, pixels.
const SIGMA_CAMERA: f32 = 0.5;
/// Floats handled at once by the blur; rows are padded to a multiple.
const CHUNK: usize = 32;
/// Radius of the widest kernel, rounded up.
const MAX_RADIUS: usize = 16;

/// A float image whose rows are padded to `stride`.
#[derive(Debug, Clone, Default)]
pub(super) struct Plane {
    pub(super) width: usize,
    pub(super) height: usize,
    stride: usize,
    values: Vec<f32>,
}

impl Plane {
    pub(super) fn new(width: usize, height: usize) -> Self {
        let stride = width.next_multiple_of(CHUNK);
        Self { width, height, stride, values: vec![0.0; stride * height] }
    }

    /// Row `y` with its padding, whose content means nothing.
    pub(super) fn row(&self, y: usize) -> &[f32] {
        &self.values[y * self.stride..(y + 1) * self.stride]
    }

    fn row_mut(&mut self, y: usize) -> &mut [f32] {
        &mut self.values[y * self.stride..(y + 1) * self.stride]
    }

    pub(super) fn at(&self, x: usize, y: usize) -> f32 {
        self.values[y * self.stride + x]
    }
}

/// Nominal blur of `level` (fractions allowed), pixels of the octave.
fn level_sigma(level: f32) -> f32 {
    SIGMA0 * (level / SCALES_PER_OCTAVE as f32).exp2()
}

/// True blur of `level` of the octave whose pixels are `ratio` pixels of the first octave wide.
pub(super) fn true_sigma(level: f32, ratio: f32) -> f32 {
    let sigma = level_sigma(level);
    (sigma * sigma + EXCESS_VARIANCE / (ratio * ratio)).sqrt()
}

/// Level 0 of the octave at twice the image's size: pixel (X, Y) lies at ((X + ½)/2, (Y + ½)/2).
///
/// Doubling and blurring are one filter: the Gaussian is evaluated at the quarter-pixel offsets of
/// the new samples, so no interpolation error and no additional blur enter.
pub(super) fn doubled_base(simd: SimdLevel, image: &GrayImage) -> Plane {
    let sigma = (true_sigma(0.0, 1.0).powi(2) / 4.0 - SIGMA_CAMERA * SIGMA_CAMERA).sqrt();
    // Sample 2i lies a quarter pixel before pixel i, sample 2i + 1 a quarter behind.
    let before = phase_kernel(sigma, 0.25);
    let behind = phase_kernel(sigma, -0.25);
    let (width, height) = (image.width() as usize, image.height() as usize);
    let mut plane = Plane::new(2 * width, 2 * height);
    let stride = width.next_multiple_of(CHUNK);
    let mut column_sums = vec![0.0; stride + 2 * PHASE_RADIUS];
    for y in 0..2 * height {
        let weights = if y % 2 == 0 { &before } else { &behind };
        let rows: [&[u8]; PHASE_TAPS] = std::array::from_fn(|k| {
            image.row(((y / 2 + k).saturating_sub(PHASE_RADIUS)).min(height - 1) as u32)
        });
        weigh_byte_rows(simd, &rows, weights, &mut column_sums[PHASE_RADIUS..][..width]);
        replicate_ends(&mut column_sums, PHASE_RADIUS, width);
        double_row(simd, &column_sums, &before, &behind, &mut plane.row_mut(y)[..2 * width]);
    }
    plane
}

/// Level 0 of the octave at the image's own size: pixel (X, Y) lies at (X + ½, Y + ½).
pub(super) fn base(simd: SimdLevel, image: &GrayImage) -> Plane {
    let (width, height) = (image.width() as usize, image.height() as usize);
    let mut plane = Plane::new(width, height);
    for y in 0..height {
        for (value, &byte) in plane.row_mut(y).iter_mut().zip(image.row(y as u32)) {
            *value = f32::from(byte) / 255.0;
        }
    }
    let sigma = (true_sigma(0.0, 1.0).powi(2) - SIGMA_CAMERA * SIGMA_CAMERA).sqrt();
    let mut blurred = Plane::new(width, height);
    blur(simd, &plane, &Kernel::gaussian(sigma), &mut blurred);
    blurred
}

/// All levels of an octave from its level 0.
pub(super) fn octave(simd: SimdLevel, base: Plane) -> [Plane; NUM_LEVELS] {
    let mut levels: [Plane; NUM_LEVELS] = Default::default();
    levels[0] = base;
    for level in 1..NUM_LEVELS {
        let (from, to) = (level_sigma((level - 1) as f32), level_sigma(level as f32));
        let kernel = Kernel::gaussian((to * to - from * from).sqrt());
        let mut blurred = Plane::new(levels[0].width, levels[0].height);
        blur(simd, &levels[level - 1], &kernel, &mut blurred);
        levels[level] = blurred;
    }
    levels
}

/// Every second pixel: pixel (X, Y) is pixel (2X, 2Y) of `plane`.
pub(super) fn halve(plane: &Plane) -> Plane {
    let mut half = Plane::new(plane.width.div_ceil(2), plane.height.div_ceil(2));
    for y in 0..half.height {
        let source = plane.row(2 * y);
        for (x, value) in half.row_mut(y)[..plane.width.div_ceil(2)].iter_mut().enumerate() {
            *value = source[2 * x];
        }
    }
    half
}

/// A symmetric kernel: `center`, then the weights at distance 1, 2, ...
struct Kernel {
    center: f32,
    sides: Vec<f32>,
}

impl Kernel {
    /// Sampled Gaussian of radius 3σ whose variance is σ² in spite of the cut.
    fn gaussian(sigma: f32) -> Self {
        let sigma = f64::from(sigma);
        let radius = ((3.0 * sigma).ceil() as usize).min(MAX_RADIUS);
        let mut parameter = sigma;
        let mut weights = Vec::new();
        for _ in 0..20 {
            weights = (0..=radius)
                .map(|k| (-0.5 * (k as f64 / parameter).powi(2)).exp())
                .collect::<Vec<f64>>();
            let sum = weights[0] + 2.0 * weights[1..].iter().sum::<f64>();
            weights.iter_mut().for_each(|w| *w /= sum);
            let variance: f64 =
                weights.iter().enumerate().map(|(k, w)| 2.0 * w * (k * k) as f64).sum();
            parameter *= sigma / variance.sqrt();
        }
        Self { center: weights[0] as f32, sides: weights[1..].iter().map(|&w| w as f32).collect() }
    }
}

const PHASE_RADIUS: usize = 3;
const PHASE_TAPS: usize = 2 * PHASE_RADIUS + 1;

/// Weights of the pixels at distance -3..=3 for a sample `-offset` away from the middle one.
fn phase_kernel(sigma: f32, offset: f32) -> [f32; PHASE_TAPS] {
    let weights: [f64; PHASE_TAPS] = std::array::from_fn(|k| {
        let distance = k as f64 - PHASE_RADIUS as f64 + f64::from(offset);
        (-0.5 * (distance / f64::from(sigma)).powi(2)).exp()
    });
    let sum: f64 = weights.iter().sum();
    weights.map(|w| (w / sum) as f32)
}

/// Repeats the first and the last of `row[radius..radius + width]` over the rest.
fn replicate_ends(row: &mut [f32], radius: usize, width: usize) {
    let (first, last) = (row[radius], row[radius + width - 1]);
    row[..radius].fill(first);
    row[radius + width..].fill(last);
}

/// Separable convolution with replicated borders, one row at a time so that the intermediate row
/// stays in the first-level cache.
fn blur(simd: SimdLevel, source: &Plane, kernel: &Kernel, target: &mut Plane) {
    let radius = kernel.sides.len();
    let mut column_sums = vec![0.0; source.stride + 2 * radius];
    let last = source.height - 1;
    for y in 0..source.height {
        let mut pairs: [(&[f32], &[f32]); MAX_RADIUS] = [(&[], &[]); MAX_RADIUS];
        for (k, pair) in pairs[..radius].iter_mut().enumerate() {
            *pair = (source.row(y.saturating_sub(k + 1)), source.row((y + k + 1).min(last)));
        }
        weigh_rows(
            simd,
            source.row(y),
            &pairs[..radius],
            kernel,
            &mut column_sums[radius..radius + source.stride],
        );
        replicate_ends(&mut column_sums, radius, source.width);
        weigh_neighbors(simd, &column_sums, kernel, target.row_mut(y));
    }
}

multiversion! {
    /// `out = center c + Σₖ (upₖ + downₖ) sₖ`; lengths are equal multiples of the chunk.
    fn weigh_rows(center: &[f32], pairs: &[(&[f32], &[f32])], kernel: &Kernel, out: &mut [f32]) {
        for (i, out) in out.chunks_exact_mut(CHUNK).enumerate() {
            let range = i * CHUNK..(i + 1) * CHUNK;
            let mut sums = [0.0f32; CHUNK];
            for (sum, value) in sums.iter_mut().zip(&center[range.clone()]) {
                *sum = value * kernel.center;
            }
            for ((up, down), &weight) in pairs.iter().zip(&kernel.sides) {
                let (up, down) = (&up[range.clone()], &down[range.clone()]);
                for l in 0..CHUNK {
                    sums[l] += (up[l] + down[l]) * weight;
                }
            }
            out.copy_from_slice(&sums);
        }
    }
}

multiversion! {
    /// Horizontal counterpart: `row` has the kernel's radius more on either side than `out`.
    fn weigh_neighbors(row: &[f32], kernel: &Kernel, out: &mut [f32]) {
        let radius = kernel.sides.len();
        for (i, out) in out.chunks_exact_mut(CHUNK).enumerate() {
            let middle = i * CHUNK + radius;
            let mut sums = [0.0f32; CHUNK];
            for (sum, value) in sums.iter_mut().zip(&row[middle..middle + CHUNK]) {
                *sum = value * kernel.center;
            }
            for (k, &weight) in kernel.sides.iter().enumerate() {
                let left = &row[middle - k - 1..middle - k - 1 + CHUNK];
                let right = &row[middle + k + 1..middle + k + 1 + CHUNK];
                for l in 0..CHUNK {
                    sums[l] += (left[l] + right[l]) * weight;
                }
            }
            out.copy_from_slice(&sums);
        }
    }
}

multiversion! {
    /// Weighted sum of byte rows, brought to the gray range [0, 1].
    fn weigh_byte_rows(rows: &[&[u8]; PHASE_TAPS], weights: &[f32; PHASE_TAPS], out: &mut [f32]) {
        let rows = rows.map(|row| &row[..out.len()]);
        let weights = weights.map(|w| w / 255.0);
        for x in 0..out.len() {
            let mut sum = 0.0;
            for k in 0..PHASE_TAPS {
                sum += f32::from(rows[k][x]) * weights[k];
            }
            out[x] = sum;
        }
    }
}

multiversion! {
    /// `row` has the phase radius more on its left than the image; two samples per pixel.
    fn double_row(
        row: &[f32],
        before: &[f32; PHASE_TAPS],
        behind: &[f32; PHASE_TAPS],
        out: &mut [f32],
    ) {
        let width = out.len() / 2;
        let taps: [&[f32]; PHASE_TAPS] = std::array::from_fn(|k| &row[k..k + width]);
        for (x, out) in out.as_chunks_mut::<2>().0.iter_mut().enumerate() {
            let (mut first, mut second) = (0.0, 0.0);
            for k in 0..PHASE_TAPS {
                first += taps[k][x] * before[k];
                second += taps[k][x] * behind[k];
            }
            *out = [first, second];
        }
    }
}
