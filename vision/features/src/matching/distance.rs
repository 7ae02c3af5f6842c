//! How unlike two descriptors are.

use volery_scene::Descriptor;

use crate::simd::{SimdLevel, multiversion};

/// Squared Euclidean distance of two descriptors.
pub fn squared_distance(a: &Descriptor, b: &Descriptor) -> u32 {
    squared_distance_with(SimdLevel::detect(), a, b)
}

multiversion! {
    /// [`squared_distance`] with the instructions of a level.
    pub(super) fn squared_distance_with(a: &Descriptor, b: &Descriptor) -> u32 {
        let mut sum = 0;
        for (a, b) in a.iter().zip(b) {
            let difference = i32::from(i16::from(*a) - i16::from(*b));
            sum += difference * difference;
        }
        sum as u32
    }
}
