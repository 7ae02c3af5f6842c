//! Light and sharpness of a photo compared with the map's.

use super::patches::View;
use super::working::Working;
use volery_scene::GrayImage;

/// Darkest level that takes part, of 255.
const DARK: u8 = 8;
/// Brightest level that takes part.
const BRIGHT: u8 = 247;
/// Ratio of fine to coarse contrast below which a photo is blurred.
const MIN_SHARPNESS: f64 = 0.4;
/// Edges weaker than this, levels, are none.
const MIN_EDGE: f64 = 3.0;
/// Gain or its inverse, and gamma or its inverse, from which on the light is another one.
const MAX_GAIN: f64 = 1.6;
const MAX_GAMMA: f64 = 1.35;

/// What the photo's light is, compared with the map's: `photo = gain · map^gamma`, levels in 0..1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Light {
    /// Factor at mid gray.
    pub gain: f64,
    /// Exponent.
    pub gamma: f64,
    /// Strength of the finest edges over that of edges at half the size: nearly 1 for sharp photos,
    /// less than 0.3 for blurred ones, 0 without edges.
    pub sharpness: f64,
}

impl Light {
    /// Whether the photo lacks its finest details.
    pub fn is_blurred(&self) -> bool {
        self.sharpness < MIN_SHARPNESS
    }

    /// Whether the light is another one than when the map was made.
    pub fn is_other(&self) -> bool {
        let beyond = |v: f64, limit: f64| v > limit || v < 1.0 / limit;
        beyond(self.gain, MAX_GAIN) || beyond(self.gamma, MAX_GAMMA)
    }

    /// Fits equal ranks of both images' levels: outlines that do not meet do not matter.
    pub(crate) fn measure(working: &Working, view: &View) -> Self {
        let mut counts = [[0_usize; 256]; 2];
        for pair in view.seen_pairs() {
            counts.iter_mut().zip(pair).for_each(|(counts, level)| counts[usize::from(level)] += 1);
        }
        let [view, photo] = counts.map(|counts| ranked(&counts));
        // Line through the logarithms at equal ranks.
        let (mut n, mut s) = (0.0, [0.0_f64; 4]);
        for (a, b) in view.into_iter().zip(photo) {
            if (DARK..=BRIGHT).contains(&a) && (DARK..=BRIGHT).contains(&b) {
                let (x, y) = ((f64::from(a) / 255.0).ln(), (f64::from(b) / 255.0).ln());
                n += 1.0;
                [x, y, x * x, x * y].iter().zip(&mut s).for_each(|(v, sum)| *sum += v);
            }
        }
        let [x, y, xx, xy] = s.map(|v| v / f64::max(n, 1.0));
        let spread = xx - x * x;
        let gamma = if n > 5.0 && spread > 1e-3 { (xy - x * y) / spread } else { 1.0 };
        let middle = 0.5_f64.ln();
        let gain = (y + gamma * (middle - x) - middle).exp();
        Self { gain: if n > 0.0 { gain } else { 1.0 }, gamma, sharpness: sharpness(working) }
    }
}

/// The levels of which 5, 6, … 95 % of all are darker.
fn ranked(counts: &[usize; 256]) -> Vec<u8> {
    let num: usize = counts.iter().sum();
    let (mut level, mut up_to) = (0_u8, counts[0]);
    let at_percent = |percent: usize| {
        while up_to <= num * percent / 100 {
            level = level.checked_add(1)?;
            up_to += counts[usize::from(level)];
        }
        Some(level)
    };
    (5..=95).map_while(at_percent).collect()
}

/// [`Light::is_blurred`] of a photo that fits nowhere.
pub(crate) fn is_blurred(working: &Working) -> bool {
    sharpness(working) < MIN_SHARPNESS
}

/// Strength of the finest edges over that at half the size, both without the noise.
fn sharpness(working: &Working) -> f64 {
    let [fine, coarse] = [0, 1].map(|level| edge_strength(&working.levels[level].gray));
    if coarse > MIN_EDGE { fine / coarse } else { 0.0 }
}

/// How far the largest hundredth of the second differences along rows stands out of the noise,
/// which their median tells.
fn edge_strength(image: &GrayImage) -> f64 {
    let mut counts = [0_usize; 512];
    let mut num = 0;
    for y in 0..image.height() {
        for v in image.row(y).windows(3) {
            let bend = (2 * i32::from(v[1]) - i32::from(v[0]) - i32::from(v[2])).unsigned_abs();
            counts[bend as usize] += 1;
            num += 1;
        }
    }
    let quantile = |part: f64| {
        let mut left = (part * f64::from(num)) as usize;
        let at = counts.iter().position(|&count| {
            let is_there = count > left;
            left = left.saturating_sub(count);
            is_there
        });
        at.unwrap_or(0) as f64
    };
    // Of normal noise the 99th part lies 3.82 medians out; levels are rounded.
    let noise = 3.82 * quantile(0.5);
    (quantile(0.99).powi(2) - noise * noise).max(0.0).sqrt()
}
