//! Products of templates and images compiled for the instruction sets of a processor.
//!
//! Sums of whole numbers: every set gives the same.

use volery_geometry::SimdLevel;

/// Pixels that are multiplied together.
pub(crate) const LANES: usize = 16;

/// Sum of products of a template (rows of `width` gray levels, whole lanes) with the part of an image
/// (rows of `stride`) that starts at `start`.
pub(crate) fn product(
    level: SimdLevel,
    template: &[i16],
    width: usize,
    image: &[i16],
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
fn plain(template: &[i16], width: usize, image: &[i16], stride: usize, start: usize) -> u64 {
    let mut sum = 0;
    for (row, own) in template.chunks_exact(width).enumerate() {
        let from = start + row * stride;
        let (own, _) = own.as_chunks::<LANES>();
        let (below, _) = image[from..from + width].as_chunks::<LANES>();
        // 33 000 pixels wide the sum would not fit.
        let mut row_sum = 0_i32;
        for (a, b) in own.iter().zip(below) {
            for lane in 0..LANES {
                row_sum += i32::from(a[lane]) * i32::from(b[lane]);
            }
        }
        sum += row_sum as u64;
    }
    sum
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,avx512f,avx512bw,avx512dq,avx512vl")]
fn avx512(template: &[i16], width: usize, image: &[i16], stride: usize, start: usize) -> u64 {
    plain(template, width, image, stride, start)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn avx2(template: &[i16], width: usize, image: &[i16], stride: usize, start: usize) -> u64 {
    plain(template, width, image, stride, start)
}

#[cfg(test)]
mod tests {
    use volery_geometry::Rng;

    use super::*;

    #[test]
    fn all_instruction_sets_give_the_sum_of_products() {
        let mut rng = Rng::new(1);
        let mut gray =
            |num: usize| -> Vec<i16> { (0..num).map(|_| rng.bits() as u8 as i16).collect() };
        let image = gray(90 * 40);
        for width in [16, 32, 80] {
            let template = gray(width * 20);
            for start in [0, 3, 90 * 7 + 10] {
                let term = |k: usize| {
                    let below = image[start + k / width * 90 + k % width];
                    u64::from(template[k].unsigned_abs()) * u64::from(below.unsigned_abs())
                };
                let sum: u64 = (0..template.len()).map(term).sum();
                for &level in SimdLevel::available() {
                    assert_eq!(product(level, &template, width, &image, 90, start), sum);
                }
            }
        }
    }
}
