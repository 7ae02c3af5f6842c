//! Whole-image descriptors that find images of the same place.

use volery_scene::{DESCRIPTOR_LEN, Descriptor, Features};

use crate::simd::{SimdLevel, multiversion};

/// Visual words.
pub const NUM_CENTERS: usize = 64;
/// Principal axes of the descriptors that are kept.
pub const NUM_AXES: usize = 32;
/// Exponent against bursts of equal features.
const POWER: f32 = 0.5;

/// A unit vector; the dot product of two tells how alike the images are.
#[derive(Debug, Clone, PartialEq)]
pub struct GlobalDescriptor(pub Vec<f32>);

impl GlobalDescriptor {
    /// Cosine similarity.
    pub fn similarity(&self, other: &Self) -> f32 {
        self.0.iter().zip(&other.0).map(|(a, b)| a * b).sum()
    }
}

/// VLAD over RootSIFT with a fixed codebook, of `NUM_CENTERS * NUM_AXES` values.
///
/// Every descriptor, on its principal axes, adds its difference from the nearest center to that
/// center's sum; each sum is brought to unit length, then all values to their signed root, then
/// the whole to unit length. No features give the zero vector, which is like nothing.
///
/// # Source
///
/// Jégou, Douze, Schmid and Pérez, "Aggregating local descriptors into a compact image
/// representation", CVPR 2010; Arandjelović and Zisserman, "All about VLAD", CVPR 2013. The
/// codebook was trained on drawn images (`examples/train_codebook.rs`).
pub fn global_descriptor(features: &Features) -> GlobalDescriptor {
    let codebook = Codebook::load();
    let mut sums = vec![[0.0f32; NUM_AXES]; NUM_CENTERS];
    aggregate(SimdLevel::detect(), &features.descriptors, &codebook, &mut sums);
    for sum in &mut sums {
        normalize(sum);
    }
    let mut values = sums.concat();
    for value in &mut values {
        *value = value.signum() * value.abs().powf(POWER);
    }
    normalize(&mut values);
    GlobalDescriptor(values)
}

struct Codebook {
    /// `axes * mean`.
    offset: [f32; NUM_AXES],
    /// Transposed: one row of all axes per byte of the descriptor, per unit of a byte.
    axes: Vec<[f32; NUM_AXES]>,
    /// Transposed: one row of all centers per axis.
    centers: Vec<[f32; NUM_CENTERS]>,
    /// Half the squared norms of the centers.
    half_norms: [f32; NUM_CENTERS],
}

impl Codebook {
    /// From the file beside this one: mean, axes, centers.
    fn load() -> Self {
        let bytes = include_bytes!("retrieval/codebook.bin");
        let values: Vec<f32> =
            bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        let (mean, rest) = values.split_at(DESCRIPTOR_LEN);
        let (rows, centers) = rest.split_at(NUM_AXES * DESCRIPTOR_LEN);
        let mut book = Self {
            offset: [0.0; NUM_AXES],
            axes: vec![[0.0; NUM_AXES]; DESCRIPTOR_LEN],
            centers: vec![[0.0; NUM_CENTERS]; NUM_AXES],
            half_norms: [0.0; NUM_CENTERS],
        };
        for (axis, row) in rows.chunks_exact(DESCRIPTOR_LEN).enumerate() {
            book.offset[axis] = row.iter().zip(mean).map(|(a, b)| a * b).sum();
            for (byte, value) in row.iter().enumerate() {
                book.axes[byte][axis] = value / 256.0;
            }
        }
        for (center, values) in centers.chunks_exact(NUM_AXES).enumerate() {
            for (axis, &value) in values.iter().enumerate() {
                book.centers[axis][center] = value;
                book.half_norms[center] += 0.5 * value * value;
            }
        }
        book
    }
}

multiversion! {
    fn aggregate(
        descriptors: &[Descriptor],
        codebook: &Codebook,
        sums: &mut [[f32; NUM_AXES]],
    ) {
        for descriptor in descriptors {
            let mut point = codebook.offset.map(|v| -v);
            for (&byte, axes) in descriptor.iter().zip(&codebook.axes) {
                let byte = f32::from(byte);
                for k in 0..NUM_AXES {
                    point[k] += byte * axes[k];
                }
            }
            // The nearest center has the greatest p·c − |c|²/2.
            let mut scores = codebook.half_norms.map(|v| -v);
            for (&value, centers) in point.iter().zip(&codebook.centers) {
                for c in 0..NUM_CENTERS {
                    scores[c] += value * centers[c];
                }
            }
            let mut nearest = 0;
            for (c, &score) in scores.iter().enumerate() {
                if score > scores[nearest] {
                    nearest = c;
                }
            }
            for k in 0..NUM_AXES {
                sums[nearest][k] += point[k] - codebook.centers[k][nearest];
            }
        }
    }
}

fn normalize(values: &mut [f32]) {
    let norm = values.iter().map(|v| v * v).sum::<f32>().sqrt();
    if norm > 0.0 {
        values.iter_mut().for_each(|v| *v /= norm);
    }
}
