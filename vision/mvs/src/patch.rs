//! Patches around sixteen pixels at once.

use volery_scene::GrayImage;

/// Pixels that are worked on together: one per lane of the widest vector.
pub(crate) const LANES: usize = 16;
/// One number per pixel.
pub(crate) type Lanes = [f32; LANES];
/// Samples along an edge of a patch; they are [`STEP`] pixels apart.
pub(crate) const EDGE: usize = 5;
/// Pixels between samples.
pub(crate) const STEP: usize = 2;
/// Samples of a patch.
pub(crate) const TAPS: usize = EDGE * EDGE;
/// Pixels from the center of a patch to its rim.
const RADIUS: usize = STEP * (EDGE - 1) / 2;

/// Gray difference to the center at which a sample's weight falls to e^-1/2: what differs in
/// color may differ in depth.
const SIGMA_GRAY: f32 = 30.0;
/// Pixels from the center at which a sample's weight falls to e^-1/2.
const SIGMA_SPACE: f32 = 4.0;

/// Samples around sixteen pixels of a row with their bilateral weights.
#[derive(Debug, Clone)]
#[repr(align(64))]
pub(crate) struct PatchBlock {
    /// Weights of the samples; they sum to one.
    pub(crate) weights: [Lanes; TAPS],
    /// Weight times gray value less the weighted mean.
    pub(crate) centered: [Lanes; TAPS],
    /// Weighted variance.
    pub(crate) variance: Lanes,
    /// Columns of the pixel centers.
    pub(crate) u: Lanes,
    /// Row of the pixel centers.
    pub(crate) v: f32,
}

/// An image with a rim, so that every patch lies inside, and the tables of weights.
#[derive(Debug, Clone)]
pub(crate) struct PatchSource {
    stride: usize,
    pixels: Vec<u8>,
    by_difference: [f32; 256],
    by_tap: [f32; TAPS],
}

impl PatchSource {
    pub(crate) fn new(image: &GrayImage) -> Self {
        let (width, height) = (image.width() as usize, image.height() as usize);
        let stride = width + 2 * RADIUS;
        let mut pixels = Vec::with_capacity(stride * (height + 2 * RADIUS));
        for y in 0..height + 2 * RADIUS {
            let row = image.row(y.saturating_sub(RADIUS).min(height - 1) as u32);
            pixels.extend(std::iter::repeat_n(row[0], RADIUS));
            pixels.extend(row);
            pixels.extend(std::iter::repeat_n(row[width - 1], RADIUS));
        }
        let gaussian = |squared: f32, sigma: f32| (-squared / (2.0 * sigma * sigma)).exp();
        let by_difference = std::array::from_fn(|d| gaussian((d * d) as f32, SIGMA_GRAY));
        let by_tap = std::array::from_fn(|tap| {
            let [x, y] = [tap % EDGE, tap / EDGE].map(|k| (k * STEP) as f32 - RADIUS as f32);
            gaussian(x * x + y * y, SIGMA_SPACE)
        });
        Self { stride, pixels, by_difference, by_tap }
    }

    /// Patches of the pixels `columns` of row `y`.
    #[inline(always)]
    pub(crate) fn block(&self, columns: &[usize; LANES], y: usize) -> PatchBlock {
        let mut weights = [[0.0; LANES]; TAPS];
        let mut gray = [[0.0; LANES]; TAPS];
        let mut sum = [0.0; LANES];
        let mut mean = [0.0; LANES];
        let middle = &self.pixels[(y + RADIUS) * self.stride..];
        let centers = columns.map(|x| middle[x + RADIUS]);
        for tap in 0..TAPS {
            let row = &self.pixels[(y + tap / EDGE * STEP) * self.stride + tap % EDGE * STEP..];
            for lane in 0..LANES {
                let value = row[columns[lane]];
                let weight =
                    self.by_tap[tap] * self.by_difference[value.abs_diff(centers[lane]) as usize];
                gray[tap][lane] = f32::from(value);
                weights[tap][lane] = weight;
                sum[lane] += weight;
                mean[lane] += weight * f32::from(value);
            }
        }
        let inverse_sum = sum.map(|sum| 1.0 / sum);
        let mean: Lanes = std::array::from_fn(|lane| mean[lane] * inverse_sum[lane]);
        let mut variance = [0.0; LANES];
        for (weights, gray) in weights.iter_mut().zip(&mut gray) {
            for lane in 0..LANES {
                weights[lane] *= inverse_sum[lane];
                let difference = gray[lane] - mean[lane];
                gray[lane] = weights[lane] * difference;
                variance[lane] += gray[lane] * difference;
            }
        }
        let u = columns.map(|x| x as f32 + 0.5);
        PatchBlock { weights, centered: gray, variance, u, v: y as f32 + 0.5 }
    }
}
