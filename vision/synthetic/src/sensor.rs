//! From an ideal image to what a camera delivers.

use rayon::prelude::*;
use volery_scene::GrayImage;

use crate::{Rendering, Rng};

/// What the lens and the sensor do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensor {
    /// Gaussian blur of the lens, pixels.
    pub blur_px: f32,
    /// Factor of the exposure; 1 is right.
    pub gain: f32,
    /// Darkening in the corners, 0..1.
    pub vignetting: f32,
    /// Standard deviation of the noise at mid gray, levels of 255.
    pub noise: f32,
}

impl Default for Sensor {
    fn default() -> Self {
        Self { blur_px: 0.45, gain: 1.0, vignetting: 0.15, noise: 1.5 }
    }
}

/// A photo: 8 bits per channel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Photo {
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// Red, green, blue, row by row.
    pub rgb: Vec<[u8; 3]>,
}

impl Photo {
    /// Luma of the photo (BT.601, as JPEG has it).
    pub fn gray(&self) -> GrayImage {
        let luma = |c: &[u8; 3]| {
            (0.299 * f32::from(c[0]) + 0.587 * f32::from(c[1]) + 0.114 * f32::from(c[2])).round()
                as u8
        };
        GrayImage::new(self.width, self.height, self.rgb.iter().map(luma).collect())
            .expect("one color per pixel")
    }
}

impl Sensor {
    /// Takes the photo of an ideal image; equal seeds give equal noise.
    pub fn expose(&self, ideal: &Rendering, seed: u64) -> Photo {
        let width = ideal.width as usize;
        let blurred = blur(&ideal.colors, width, self.blur_px);
        let middle = [ideal.width as f32 / 2.0, ideal.height as f32 / 2.0];
        let corner2 = middle[0] * middle[0] + middle[1] * middle[1];
        let mut rgb = vec![[0; 3]; blurred.len()];
        rgb.par_chunks_mut(width).enumerate().for_each(|(j, row)| {
            let mut rng = Rng::fork(seed, j as u64);
            let dy = j as f32 + 0.5 - middle[1];
            for (i, pixel) in row.iter_mut().enumerate() {
                let dx = i as f32 + 0.5 - middle[0];
                let gain = self.gain * (1.0 - self.vignetting * (dx * dx + dy * dy) / corner2);
                let noise = noise3(&mut rng);
                *pixel = std::array::from_fn(|c| {
                    let level = blurred[j * width + i][c] * gain;
                    // Shot noise grows with the root of the light; half of it stays in the dark.
                    let sigma = self.noise * (0.25 + 0.75 * level.max(0.0) / 128.0).sqrt();
                    (level + sigma * noise[c]).round().clamp(0.0, 255.0) as u8
                });
            }
        });
        Photo { width: ideal.width, height: ideal.height, rgb }
    }
}

/// Three nearly normal numbers from two words: sums of four bytes each.
fn noise3(rng: &mut Rng) -> [f32; 3] {
    let words = [rng.bits(), rng.bits()];
    // Variance of a byte is (256² − 1) / 12; four of them.
    const SCALE: f32 = 1.0 / 147.8;
    [words[0], words[0] >> 32, words[1]].map(|word| {
        let sum: u64 = (0..4).map(|k| word >> (8 * k) & 255).sum();
        (sum as f32 - 510.0) * SCALE
    })
}

/// Separable Gaussian; edges repeat.
fn blur(colors: &[[f32; 3]], width: usize, sigma: f32) -> Vec<[f32; 3]> {
    if sigma <= 0.0 {
        return colors.to_vec();
    }
    let radius = (3.0 * sigma).ceil() as usize;
    let mut kernel: Vec<f32> = (0..=2 * radius)
        .map(|k| (-0.5 * ((k as f32 - radius as f32) / sigma).powi(2)).exp())
        .collect();
    let sum: f32 = kernel.iter().sum();
    kernel.iter_mut().for_each(|w| *w /= sum);
    let height = colors.len() / width;
    let mut across = vec![[0.0; 3]; colors.len()];
    across.par_chunks_mut(width).zip(colors.par_chunks(width)).for_each(|(out, row)| {
        let mut wide = Vec::with_capacity(width + 2 * radius);
        wide.resize(radius, row[0]);
        wide.extend_from_slice(row);
        wide.resize(width + 2 * radius, row[width - 1]);
        for (k, w) in kernel.iter().enumerate() {
            add(out, *w, &wide[k..]);
        }
    });
    let mut both = vec![[0.0; 3]; colors.len()];
    both.par_chunks_mut(width).enumerate().for_each(|(j, out)| {
        for (k, w) in kernel.iter().enumerate() {
            let row = (j + k).saturating_sub(radius).min(height - 1) * width;
            add(out, *w, &across[row..]);
        }
    });
    both
}

/// Adds a part of the colors from the first one on.
fn add(to: &mut [[f32; 3]], part: f32, colors: &[[f32; 3]]) {
    let (to, colors) = (to.as_flattened_mut(), colors.as_flattened());
    to.iter_mut().zip(colors).for_each(|(to, color)| *to += part * color);
}
