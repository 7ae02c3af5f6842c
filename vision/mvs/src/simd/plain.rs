//! Vectors as plain arrays.

use super::{LANES, Vector};

#[derive(Clone, Copy)]
pub(super) struct Plain([f32; LANES]);

impl Plain {
    #[inline(always)]
    fn map2(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Self(std::array::from_fn(|k| f(self.0[k], other.0[k])))
    }
}

impl Vector for Plain {
    const WIDTH: usize = LANES;
    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self([value; LANES])
    }
    #[inline(always)]
    fn load(values: &[f32]) -> Self {
        Self(*values.first_chunk().expect("a lane for each"))
    }
    #[inline(always)]
    fn store(self, values: &mut [f32]) {
        values[..LANES].copy_from_slice(&self.0);
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.map2(other, |a, b| a + b)
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.map2(other, |a, b| a - b)
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.map2(other, |a, b| a * b)
    }
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.map2(other, |a, b| a / b)
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.map2(other, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.map2(other, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.map(f32::sqrt))
    }
    #[inline(always)]
    fn trunc(self) -> Self {
        Self(self.0.map(|v| v as i32 as f32))
    }
    #[inline(always)]
    fn if_less(self, other: Self, yes: Self, no: Self) -> Self {
        Self(std::array::from_fn(|k| if self.0[k] < other.0[k] { yes.0[k] } else { no.0[k] }))
    }
    #[inline(always)]
    fn gather_bytes(index: Self, entries: &[u32]) -> [Self; 4] {
        let quads = index.0.map(|i| entries[i as usize].to_le_bytes());
        std::array::from_fn(|byte| Self(quads.map(|quad| f32::from(quad[byte]))))
    }
    #[inline(always)]
    fn gather(index: Self, entries: &[f32]) -> Self {
        Self(index.0.map(|i| entries[i as usize]))
    }
}
