//! Correlation of sixteen patches with another image: AVX-512, AVX2 and plain.
//!
//! One kernel over three kinds of vectors. None fuses multiply and add, so all give the same bits.

mod plain;
#[cfg(target_arch = "x86_64")]
mod x86;

use volery_geometry::SimdLevel;

use crate::patch::{EDGE, LANES, Lanes, PatchBlock, STEP};
use crate::source::{Source, Transfer};

/// What the noise of the pixels adds to the variance of a patch, gray levels squared: patches
/// without texture correlate with nothing.
const NOISE_VARIANCE: f32 = 2.0;
/// Disagreement that costs no more when it grows, pixels.
const MAX_DISAGREEMENT_PX: f32 = 3.0;
/// Correlation of what the other image does not show.
pub(crate) const UNSEEN: f32 = -1.0;

/// Bilaterally weighted normalized cross-correlation of each patch with what `source` shows
/// through the patch's plane, in [-1, 1]; [`UNSEEN`] where the center is not in the image.
///
/// `planes`: inverse depth, its slope along u and along v.
pub(crate) fn correlation(
    level: SimdLevel,
    block: &PatchBlock,
    planes: &[Lanes; 3],
    source: &Source,
) -> Lanes {
    match level {
        // SAFETY: `SimdLevel::available` lists a level only if the processor has it.
        #[cfg(target_arch = "x86_64")]
        SimdLevel::Avx512 => unsafe { x86::correlation_avx512(block, planes, source) },
        // SAFETY: as above.
        #[cfg(target_arch = "x86_64")]
        SimdLevel::Avx2 => unsafe { x86::correlation_avx2(block, planes, source) },
        _ => {
            let mut result = [0.0; LANES];
            kernel::<plain::Plain>(block, planes, source, &mut result);
            result
        }
    }
}

/// Something that is compiled once for every instruction set.
pub(crate) trait Work {
    /// To be inlined.
    fn run(self);
}

/// Runs `work` as compiled for `level`.
pub(crate) fn run(level: SimdLevel, work: impl Work) {
    match level {
        // SAFETY: `SimdLevel::available` lists a level only if the processor has it.
        #[cfg(target_arch = "x86_64")]
        SimdLevel::Avx512 => unsafe { x86::run_avx512(work) },
        // SAFETY: as above.
        #[cfg(target_arch = "x86_64")]
        SimdLevel::Avx2 => unsafe { x86::run_avx2(work) },
        _ => work.run(),
    }
}

/// Pixels between pixels and where they come back to by the inverse depths that `map` has where
/// they land in the source, at most [`MAX_DISAGREEMENT_PX`].
///
/// Source: Xu and Tao, "Multi-Scale Geometric Consistency Guided Multi-View Stereo", CVPR 2019,
/// eq. (8).
pub(crate) fn disagreement(
    level: SimdLevel,
    source: &Source,
    map: &[f32],
    u: &Lanes,
    v: f32,
    w: &Lanes,
) -> Lanes {
    match level {
        // SAFETY: `SimdLevel::available` lists a level only if the processor has it.
        #[cfg(target_arch = "x86_64")]
        SimdLevel::Avx512 => unsafe { x86::disagreement_avx512(source, map, u, v, w) },
        // SAFETY: as above.
        #[cfg(target_arch = "x86_64")]
        SimdLevel::Avx2 => unsafe { x86::disagreement_avx2(source, map, u, v, w) },
        _ => round_trip::<plain::Plain>(source, map, u, v, w),
    }
}

/// Some lanes of a block. `max` and `min` give the second operand where one is not a number, as
/// the machine does.
trait Vector: Copy {
    const WIDTH: usize;
    fn splat(value: f32) -> Self;
    /// Of the first `WIDTH` values.
    fn load(values: &[f32]) -> Self;
    fn store(self, values: &mut [f32]);
    fn add(self, other: Self) -> Self;
    fn sub(self, other: Self) -> Self;
    fn mul(self, other: Self) -> Self;
    fn div(self, other: Self) -> Self;
    fn max(self, other: Self) -> Self;
    fn min(self, other: Self) -> Self;
    fn sqrt(self) -> Self;
    /// Without its fraction; of values in 0..2²⁴.
    fn trunc(self) -> Self;
    /// `yes` where `self < other`, else `no`.
    fn if_less(self, other: Self, yes: Self, no: Self) -> Self;
    /// The four bytes of the entries at `index`, which hold whole numbers below the length.
    fn gather_bytes(index: Self, entries: &[u32]) -> [Self; 4];
    /// The entries at `index`, which holds whole numbers below the length.
    fn gather(index: Self, entries: &[f32]) -> Self;
}

#[inline(always)]
fn round_trip<V: Vector>(source: &Source, map: &[f32], u: &Lanes, v: f32, w: &Lanes) -> Lanes {
    let (width, height) = (source.image.width, source.image.height);
    assert!(map.len() == width * height && map.len() < 1 << 24);
    let (zero, most) = (V::splat(0.0), V::splat(MAX_DISAGREEMENT_PX));
    let (last_x, last_y) = (V::splat((width - 1) as f32), V::splat((height - 1) as f32));
    let (stride, height) = (V::splat(width as f32), V::splat(height as f32));
    let mut result = [0.0; LANES];
    for first in (0..LANES).step_by(V::WIDTH) {
        let (u, v, w) = (V::load(&u[first..]), V::splat(v), V::load(&w[first..]));
        let [x, y, z] = transferred(&source.from_reference, u, v, w);
        let (x, y) = (x.div(z), y.div(z));
        let (column, row) = (x.trunc().max(zero).min(last_x), y.trunc().max(zero).min(last_y));
        let there = V::gather(row.mul(stride).add(column), map);
        let [back_x, back_y, back_z] = transferred(&source.to_reference, x, y, there);
        let (du, dv) = (back_x.div(back_z).sub(u), back_y.div(back_z).sub(v));
        let off = du.mul(du).add(dv.mul(dv)).sqrt().min(most);
        // In front of both cameras, in the image and known there.
        let off = zero.if_less(back_z, off, most);
        let off = zero.if_less(there, off, most);
        let off = zero.if_less(z, off, most);
        let off = x.if_less(zero, most, off);
        let off = y.if_less(zero, most, off);
        let off = x.if_less(stride, off, most);
        y.if_less(height, off, most).store(&mut result[first..]);
    }
    result
}

/// [`Transfer::apply`] to some lanes.
#[inline(always)]
fn transferred<V: Vector>(transfer: &Transfer, u: V, v: V, w: V) -> [V; 3] {
    let [a0, a1, a2] = &transfer.a;
    let mut result = [w; 3];
    // A closure would not be compiled for the instruction set.
    for k in 0..3 {
        let linear = V::splat(a0[k]).mul(u).add(V::splat(a1[k]).mul(v)).add(V::splat(a2[k]));
        result[k] = linear.add(V::splat(transfer.b[k]).mul(w));
    }
    result
}

#[inline(always)]
fn kernel<V: Vector>(
    block: &PatchBlock,
    planes: &[Lanes; 3],
    source: &Source,
    result: &mut [f32; LANES],
) {
    let image = &source.image;
    assert!(image.quads.len() == image.width * image.height && image.quads.len() < 1 << 24);
    let stride = V::splat(image.width as f32);
    // A hair inside of the last pixel's center, so that the right neighbor exists.
    let last_x = V::splat(((image.width - 1) as f32 - 1e-3).max(0.0));
    let last_y = V::splat(((image.height - 1) as f32 - 1e-3).max(0.0));
    let (zero, half, one) = (V::splat(0.0), V::splat(0.5), V::splat(1.0));
    let noise = V::splat(NOISE_VARIANCE);
    let transfer = &source.from_reference;
    for first in (0..LANES).step_by(V::WIDTH) {
        let w = V::load(&planes[0][first..]);
        let (slope_u, slope_v) = (V::load(&planes[1][first..]), V::load(&planes[2][first..]));
        let (u, v) = (V::load(&block.u[first..]), V::splat(block.v));
        // λ (u', v', 1) of the center and its derivatives along u and v.
        let mut center = [zero; 3];
        let mut along_u = [zero; 3];
        let mut along_v = [zero; 3];
        for k in 0..3 {
            let (a0, a1) = (V::splat(transfer.a[0][k]), V::splat(transfer.a[1][k]));
            let (a2, b) = (V::splat(transfer.a[2][k]), V::splat(transfer.b[k]));
            center[k] = a0.mul(u).add(a1.mul(v)).add(a2.add(b.mul(w)));
            along_u[k] = a0.add(b.mul(slope_u));
            along_v[k] = a1.add(b.mul(slope_v));
        }
        let radius = V::splat((STEP * (EDGE - 1) / 2) as f32);
        let step = V::splat(STEP as f32);
        let mut row_start = [zero; 3];
        let mut step_u = [zero; 3];
        let mut step_v = [zero; 3];
        // From here on the center of the first pixel is at 0.
        let z = center[2];
        for k in 0..2 {
            along_u[k] = along_u[k].sub(half.mul(along_u[2]));
            along_v[k] = along_v[k].sub(half.mul(along_v[2]));
        }
        let indexed = [center[0].sub(half.mul(z)), center[1].sub(half.mul(z)), z];
        for k in 0..3 {
            row_start[k] = indexed[k].sub(along_u[k].add(along_v[k]).mul(radius));
            step_u[k] = along_u[k].mul(step);
            step_v[k] = along_v[k].mul(step);
        }
        let (mut sum, mut sum_squares, mut covariance) = (zero, zero, zero);
        for row in 0..EDGE {
            let mut at = row_start;
            for column in 0..EDGE {
                let tap = row * EDGE + column;
                let inverse = one.div(at[2]);
                let x = at[0].mul(inverse).max(zero).min(last_x);
                let y = at[1].mul(inverse).max(zero).min(last_y);
                let (x0, y0) = (x.trunc(), y.trunc());
                let (fx, fy) = (x.sub(x0), y.sub(y0));
                let [a, b, c, d] = V::gather_bytes(y0.mul(stride).add(x0), &image.quads);
                let top = a.add(fx.mul(b.sub(a)));
                let bottom = c.add(fx.mul(d.sub(c)));
                let value = top.add(fy.mul(bottom.sub(top)));
                let weighted = V::load(&block.weights[tap][first..]).mul(value);
                sum = sum.add(weighted);
                sum_squares = sum_squares.add(weighted.mul(value));
                covariance = covariance.add(V::load(&block.centered[tap][first..]).mul(value));
                for k in 0..3 {
                    at[k] = at[k].add(step_u[k]);
                }
            }
            for k in 0..3 {
                row_start[k] = row_start[k].add(step_v[k]);
            }
        }
        let variance = sum_squares.sub(sum.mul(sum)).max(zero).add(noise);
        let own = V::load(&block.variance[first..]).add(noise);
        let ncc = covariance.div(own.mul(variance).sqrt());
        // Unseen: behind the camera or outside of the image.
        let unseen = V::splat(UNSEEN);
        let (x, y) = (center[0], center[1]);
        let (width, height) = (V::splat(image.width as f32), V::splat(image.height as f32));
        let seen = zero.if_less(z, ncc, unseen);
        let seen = zero.if_less(x, seen, unseen);
        let seen = zero.if_less(y, seen, unseen);
        let seen = x.if_less(width.mul(z), seen, unseen);
        y.if_less(height.mul(z), seen, unseen).store(&mut result[first..]);
    }
}

#[cfg(test)]
mod tests {
    use volery_geometry::{Camera, CameraModel, Isometry3, Rng, Vector3};
    use volery_scene::GrayImage;

    use super::*;
    use crate::patch::PatchSource;
    use crate::source::QuadImage;

    const WIDTH: u32 = 80;
    const HEIGHT: u32 = 60;

    /// A smooth function of the plane z = 2, seen by a camera at `(x, 0, 0)`.
    fn view_of_plane(camera: &Camera, x: f64) -> GrayImage {
        let pixels = (0..HEIGHT)
            .flat_map(|row| (0..WIDTH).map(move |column| (column, row)))
            .map(|(column, row)| {
                let pixel = [f64::from(column) + 0.5, f64::from(row) + 0.5];
                let ray = camera.unproject(&pixel.into()).unwrap();
                let (px, py) = (2.0 * ray.x + x, 2.0 * ray.y);
                let gray = 128.0 + 50.0 * (17.0 * px).sin() + 40.0 * (13.0 * py + 9.0 * px).cos();
                gray.round() as u8
            })
            .collect();
        GrayImage::new(WIDTH, HEIGHT, pixels).unwrap()
    }

    fn scene() -> (PatchSource, Source) {
        let camera = Camera::from_focal(CameraModel::Pinhole, WIDTH, HEIGHT, 70.0).unwrap();
        let other_from_own = Isometry3::new(Vector3::new(-0.3, 0.0, 0.0), Vector3::zeros());
        let source = Source {
            image: QuadImage::new(&view_of_plane(&camera, 0.3)),
            from_reference: Transfer::new(&camera, &camera, &other_from_own),
            to_reference: Transfer::new(&camera, &camera, &other_from_own.inverse()),
        };
        (PatchSource::new(&view_of_plane(&camera, 0.0)), source)
    }

    fn block_at(patches: &PatchSource, first: usize, row: usize) -> PatchBlock {
        patches.block(&std::array::from_fn(|lane| first + 2 * lane), row)
    }

    /// The true plane correlates; half of its inverse depth does not.
    #[test]
    fn the_true_plane_correlates() {
        let (patches, source) = scene();
        let flat = |w: f32| [[w; LANES], [0.0; LANES], [0.0; LANES]];
        for row in [12, 30, 47] {
            let block = block_at(&patches, 24, row);
            let right = correlation(SimdLevel::Portable, &block, &flat(0.5), &source);
            let wrong = correlation(SimdLevel::Portable, &block, &flat(0.25), &source);
            assert!(right.iter().all(|&ncc| ncc > 0.97), "{right:?}");
            assert!(wrong.iter().all(|&ncc| ncc < 0.8), "{wrong:?}");
        }
    }

    #[test]
    fn what_is_not_seen_is_said_so() {
        let (patches, source) = scene();
        let block = block_at(&patches, 0, 30);
        // Pixels left of the other image, and a plane behind the cameras.
        let w = [[0.5; LANES], [0.0; LANES], [0.0; LANES]];
        assert_eq!(correlation(SimdLevel::Portable, &block, &w, &source)[0], UNSEEN);
        let mut behind = source.clone();
        behind.from_reference.a[2][2] = -1.0;
        let nothing = correlation(SimdLevel::Portable, &block, &w, &behind);
        assert_eq!(nothing, [UNSEEN; LANES]);
    }

    /// Planes of all kinds, also such that look out of the image and behind the camera.
    #[test]
    fn all_instruction_sets_give_the_same_bits() {
        let (patches, source) = scene();
        let mut rng = Rng::new(5);
        let mut lanes = |low, high| std::array::from_fn(|_| rng.range(low, high) as f32);
        for trial in 0..200 {
            let block = block_at(&patches, trial % 48, trial % HEIGHT as usize);
            let planes = [lanes(-0.3, 3.0), lanes(-0.2, 0.2), lanes(-0.2, 0.2)];
            let plain = correlation(SimdLevel::Portable, &block, &planes, &source);
            for &level in SimdLevel::available() {
                let wide = correlation(level, &block, &planes, &source);
                assert_eq!(plain.map(f32::to_bits), wide.map(f32::to_bits), "{level:?}");
            }
        }
    }

    /// A map of the plane z = 2 agrees with the plane by the part of a pixel that it is off.
    #[test]
    fn maps_of_the_same_plane_agree() {
        let (_, source) = scene();
        let u = std::array::from_fn(|lane| 30.5 + 2.0 * lane as f32);
        let map = vec![0.5; (WIDTH * HEIGHT) as usize];
        let off = |map: &[f32], w: f32| {
            disagreement(SimdLevel::Portable, &source, map, &u, 30.5, &[w; LANES])
        };
        assert!(off(&map, 0.5).iter().all(|&off| off < 1e-3));
        // 70 px of focal length, 0.3 m of baseline: 21 px per unit of inverse depth.
        assert!(off(&map, 0.55).iter().all(|&off| (off - 1.05).abs() < 1e-2));
        assert_eq!(off(&map, 0.9), [MAX_DISAGREEMENT_PX; LANES]);
        let unknown = vec![0.0; map.len()];
        assert_eq!(off(&unknown, 0.5), [MAX_DISAGREEMENT_PX; LANES]);
        // 21 times 1.5 px leave the image on the left.
        assert_eq!(off(&map, 1.5)[0], MAX_DISAGREEMENT_PX);
    }

    #[test]
    fn all_instruction_sets_disagree_by_the_same_bits() {
        let (_, source) = scene();
        let mut rng = Rng::new(6);
        let map: Vec<f32> = (0..WIDTH * HEIGHT).map(|_| rng.range(-0.1, 1.0) as f32).collect();
        for trial in 0..200 {
            let u = std::array::from_fn(|lane| (trial % 48 + 2 * lane) as f32 + 0.5);
            let v = (trial % HEIGHT as usize) as f32 + 0.5;
            let mut w: Lanes = std::array::from_fn(|_| rng.range(-0.3, 3.0) as f32);
            w[0] = f32::INFINITY;
            let plain = disagreement(SimdLevel::Portable, &source, &map, &u, v, &w);
            assert!(plain.iter().all(|off| (0.0..=MAX_DISAGREEMENT_PX).contains(off)));
            for &level in SimdLevel::available() {
                let wide = disagreement(level, &source, &map, &u, v, &w);
                assert_eq!(plain.map(f32::to_bits), wide.map(f32::to_bits), "{level:?}");
            }
        }
    }
}
