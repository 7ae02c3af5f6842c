//! What is wrong with a frame before anything is looked for in it.

use crate::pyramid::{Level, Pyramid};

/// Why a frame says little or nothing. The names are stable codes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameFault {
    /// The same pixels as in the frame before: the camera hangs, or the link repeats itself.
    Frozen,
    /// Not later than the frame before.
    OutOfOrder,
    /// Not of the camera's size.
    WrongSize,
    /// Next to no contrast: darkness, a covered lens, a wall of fog.
    NoContrast,
    /// So dark that noise outweighs the picture.
    Dark,
    /// Smeared by motion, or out of focus.
    Blurred,
}

impl FrameFault {
    /// The stable code.
    pub fn code(self) -> &'static str {
        match self {
            Self::Frozen => "frozen",
            Self::OutOfOrder => "out_of_order",
            Self::WrongSize => "wrong_size",
            Self::NoContrast => "no_contrast",
            Self::Dark => "dark",
            Self::Blurred => "blurred",
        }
    }

    /// Whether nothing is to be learned from such a frame.
    pub(crate) fn is_fatal(self) -> bool {
        !matches!(self, Self::Dark | Self::Blurred)
    }
}

/// Least standard deviation of the gray levels.
const MIN_CONTRAST: f32 = 4.0;
/// Darker frames, in the mean, may be too dark; they are if noise outweighs the picture: then the
/// slopes of the image are this much steeper than those of its half. Pictures have 0.6 to 1.
const DARK_MEAN: f32 = 90.0;
const NOISE: f32 = 1.3;
/// Blurred frames have less than this part of the sharpness of the frames before: 60 ms of exposure
/// while turning at 35 degrees per second leave 0.65 to 0.72, the view of another wall 0.82.
const MAX_LOSS: f32 = 0.76;
/// Weight of a new frame in the usual sharpness, and of one that counts as blurred.
const LEARNING: f32 = 0.2;
const DOUBTFUL_LEARNING: f32 = 0.02;

/// The usual sharpness of a stream.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct FrameCheck {
    usual: Option<f32>,
}

impl FrameCheck {
    /// The fault of a frame by its pixels alone.
    pub(crate) fn judge(&mut self, pyramid: &Pyramid) -> Option<FrameFault> {
        let coarse = &pyramid.levels[pyramid.levels.len() - 1];
        let (mean, contrast) = spread(coarse);
        if contrast < MIN_CONTRAST {
            return Some(FrameFault::NoContrast);
        }
        let [fine, coarse] = steepness(pyramid);
        if mean < DARK_MEAN && fine > NOISE {
            return Some(FrameFault::Dark);
        }
        let sharpness = fine * coarse;
        let usual = *self.usual.get_or_insert(sharpness);
        let is_blurred = sharpness < MAX_LOSS * usual;
        let weight = if is_blurred { DOUBTFUL_LEARNING } else { LEARNING };
        self.usual = Some(usual + weight * (sharpness - usual));
        is_blurred.then_some(FrameFault::Blurred)
    }
}

/// Mean and standard deviation.
fn spread(level: &Level) -> (f32, f32) {
    let (mut sum, mut squares) = (0.0_f64, 0.0_f64);
    for y in 0..level.height {
        let start = level.start_of_row(y);
        for &value in &level.plane[start..start + level.width] {
            sum += f64::from(value);
            squares += f64::from(value) * f64::from(value);
        }
    }
    let count = (level.width * level.height) as f64;
    let mean = sum / count;
    (mean as f32, (squares / count - mean * mean).max(0.0).sqrt() as f32)
}

/// Slopes of the image relative to those of its half, and of that relative to its half: about the
/// same for all content and light, less for smeared images, more for noise.
fn steepness(pyramid: &Pyramid) -> [f32; 2] {
    let slopes = |level: usize| pyramid.levels.get(level).map(slopes);
    let ratio = |level: usize| match (slopes(level), slopes(level + 1)) {
        (Some(fine), Some(coarse)) => fine / coarse.max(1e-3),
        _ => 1.0,
    };
    [ratio(0), ratio(1)]
}

/// Mean size of the differences between neighbors.
fn slopes(level: &Level) -> f32 {
    let mut sum = 0.0_f64;
    for y in 0..level.height - 1 {
        let start = level.start_of_row(y);
        let row = &level.plane[start..start + level.width];
        let below = &level.plane[start + level.stride..];
        let along: f32 = row.windows(2).map(|pair| (pair[1] - pair[0]).abs()).sum();
        let down: f32 = row.iter().zip(below).map(|(a, b)| (b - a).abs()).sum();
        sum += f64::from(along + down);
    }
    (sum / (level.width * level.height) as f64) as f32
}
