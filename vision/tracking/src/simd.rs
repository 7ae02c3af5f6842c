//! Sums over patches compiled for the instruction sets of a processor.
//!
//! Every column of a patch has its own sums, which are added up in one order: every set gives the
//! same bits.

use volery_geometry::SimdLevel;

/// Side of a patch, pixels.
pub(crate) const SIDE: usize = 12;
/// Pixels of a patch.
pub(crate) const AREA: usize = SIDE * SIDE;

/// Values of a patch, row by row.
pub(crate) type Patch = [f32; AREA];

/// What an image holds where a patch lies.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Sums {
    /// Σ I
    pub(crate) one: f32,
    /// Σ I²
    pub(crate) square: f32,
    /// Σ T I
    pub(crate) with_values: f32,
    /// Σ Gₓ I, Σ G_y I
    pub(crate) with_slopes: [f32; 2],
}

/// The sums over a patch whose first pixel is a part (`right`, `down`) of a pixel from the one that
/// `start` names, in an image with rows of `stride` pixels.
pub(crate) fn sums(
    level: SimdLevel,
    image: &[f32],
    stride: usize,
    start: usize,
    [right, down]: [f32; 2],
    patch: (&Patch, &Patch, &Patch),
) -> Sums {
    match level {
        // SAFETY: `SimdLevel::available` lists a level only if the processor has it.
        #[cfg(target_arch = "x86_64")]
        SimdLevel::Avx512 => unsafe { avx512(image, stride, start, [right, down], patch) },
        // SAFETY: as above.
        #[cfg(target_arch = "x86_64")]
        SimdLevel::Avx2 => unsafe { avx2(image, stride, start, [right, down], patch) },
        _ => plain(image, stride, start, [right, down], patch),
    }
}

#[inline(always)]
fn plain(
    image: &[f32],
    stride: usize,
    start: usize,
    [right, down]: [f32; 2],
    (values, slopes_x, slopes_y): (&Patch, &Patch, &Patch),
) -> Sums {
    let weights =
        [(1.0 - right) * (1.0 - down), right * (1.0 - down), (1.0 - right) * down, right * down];
    let mut columns = [[0.0_f32; SIDE]; 5];
    for j in 0..SIDE {
        let from = start + j * stride;
        let above: &[f32; SIDE + 1] =
            image[from..].first_chunk().expect("callers keep patches within the border");
        let below: &[f32; SIDE + 1] =
            image[from + stride..].first_chunk().expect("callers keep patches within the border");
        for i in 0..SIDE {
            let value = weights[0] * above[i]
                + weights[1] * above[i + 1]
                + weights[2] * below[i]
                + weights[3] * below[i + 1];
            let k = j * SIDE + i;
            columns[0][i] += value;
            columns[1][i] += value * value;
            columns[2][i] += values[k] * value;
            columns[3][i] += slopes_x[k] * value;
            columns[4][i] += slopes_y[k] * value;
        }
    }
    let total = columns.map(|column| column.iter().sum::<f32>());
    Sums {
        one: total[0],
        square: total[1],
        with_values: total[2],
        with_slopes: [total[3], total[4]],
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,avx512f,avx512bw,avx512dq,avx512vl")]
fn avx512(
    image: &[f32],
    stride: usize,
    start: usize,
    fraction: [f32; 2],
    patch: (&Patch, &Patch, &Patch),
) -> Sums {
    plain(image, stride, start, fraction, patch)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn avx2(
    image: &[f32],
    stride: usize,
    start: usize,
    fraction: [f32; 2],
    patch: (&Patch, &Patch, &Patch),
) -> Sums {
    plain(image, stride, start, fraction, patch)
}

#[cfg(test)]
mod tests {
    use volery_geometry::Rng;

    use super::*;

    #[test]
    fn all_instruction_sets_give_the_same() {
        let mut rng = Rng::new(1);
        let image: Vec<f32> = (0..60 * 40).map(|_| rng.range(0.0, 255.0) as f32).collect();
        let mut patch = || std::array::from_fn(|_| rng.range(-50.0, 50.0) as f32);
        let (values, x, y) = (patch(), patch(), patch());
        for start in [0, 7, 60 * 11 + 23, 60 * 20 + 40] {
            for fraction in [[0.0, 0.0], [0.3, 0.9], [0.999, 0.001]] {
                let ask = |level| sums(level, &image, 60, start, fraction, (&values, &x, &y));
                let one = ask(SimdLevel::Portable);
                for &level in SimdLevel::available() {
                    assert_eq!(ask(level), one);
                }
            }
        }
    }
}
