//! Random numbers that belong to a pixel, whoever works on it.

use volery_geometry::rng::mix;

/// Random numbers of one pixel.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Dice(pub(crate) u64);

impl Dice {
    /// Uniform in [0, 1).
    #[inline(always)]
    pub(crate) fn uniform(&mut self) -> f32 {
        self.0 = mix(self.0);
        (self.0 >> 40) as f32 * (1.0 / (1u32 << 24) as f32)
    }

    /// Uniform in [-1, 1).
    #[inline(always)]
    pub(crate) fn spread(&mut self) -> f32 {
        2.0 * self.uniform() - 1.0
    }

    /// -1 or 1.
    #[inline(always)]
    pub(crate) fn sign(&mut self) -> f32 {
        if self.uniform() < 0.5 { -1.0 } else { 1.0 }
    }

    /// Between two powers of two, in each octave of the range as often and evenly.
    #[inline(always)]
    pub(crate) fn power(&mut self, [low, high]: [f32; 2]) -> f32 {
        let exponent = low + (high - low) * self.uniform();
        let octave = exponent.floor();
        f32::from_bits(((octave as i32 + 127) as u32) << 23) * (1.0 + exponent - octave)
    }
}
