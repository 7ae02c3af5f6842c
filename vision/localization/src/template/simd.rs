//! Products of templates and images compiled for the instruction sets of a processor.
//!
//! Sums of whole numbers: every set gives the same.

use volery_geometry::SimdLevel;

/// Sum of products of a template (rows of `width` pixels) with the part of an image (rows of
/// `stride` pixels) that starts at `start`.
pub(crate) fn product(
    level: SimdLevel,
    template: &[u8],
    width: usize,
    image: &[u8],
    stride: usize,
    start: usize,
) -> u64 {
    match level {
        // SAFETY: `SimdLevel::available` lists a level only if the processor has it.
        #[cfg(target_arch = "x86_64")]
        SimdLevel::Avx512 => unsafe { avx512(template, width, image, stride, start) },
        // SAFETY: as above.
        #[cfg(target_arch = "x86_64")]
        SimdLevel::Avx2 => unsafe { avx2(template, width, image, stride, start) },
        _ => plain(template, width, image, stride, start),
    }
}

#[inline(always)]
fn plain(template: &[u8], width: usize, image: &[u8], stride: usize, start: usize) -> u64 {
    let mut sum = 0;
    for (row, own) in template.chunks_exact(width).enumerate() {
        let from = start + row * stride;
        let below = &image[from..from + width];
        // 66 000 pixels wide the sum would not fit.
        sum += u64::from(
            own.iter().zip(below).map(|(&a, &b)| u32::from(a) * u32::from(b)).sum::<u32>(),
        );
    }
    sum
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,avx512f,avx512bw,avx512dq,avx512vl")]
fn avx512(template: &[u8], width: usize, image: &[u8], stride: usize, start: usize) -> u64 {
    plain(template, width, image, stride, start)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn avx2(template: &[u8], width: usize, image: &[u8], stride: usize, start: usize) -> u64 {
    plain(template, width, image, stride, start)
}

#[cfg(test)]
mod tests {
    use volery_geometry::Rng;

    use super::*;

    #[test]
    fn all_instruction_sets_give_the_same() {
        let mut rng = Rng::new(1);
        let image: Vec<u8> = (0..90 * 40).map(|_| rng.bits() as u8).collect();
        for width in [1, 7, 16, 31, 48, 77] {
            let template: Vec<u8> = (0..width * 20).map(|_| rng.bits() as u8).collect();
            for start in [0, 3, 90 * 7 + 11] {
                let one = product(SimdLevel::Portable, &template, width, &image, 90, start);
                for &level in SimdLevel::available() {
                    assert_eq!(product(level, &template, width, &image, 90, start), one);
                }
            }
        }
    }
}
