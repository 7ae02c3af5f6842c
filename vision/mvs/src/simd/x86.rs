//! Vectors of x86-64.

use std::arch::x86_64::*;

use super::{LANES, Lanes, PatchBlock, Source, Vector, Work, kernel, round_trip};

#[target_feature(enable = "avx512f")]
pub(super) fn correlation_avx512(
    block: &PatchBlock,
    planes: &[Lanes; 3],
    source: &Source,
) -> Lanes {
    let mut result = [0.0; LANES];
    kernel::<Wide512>(block, planes, source, &mut result);
    result
}

#[target_feature(enable = "avx2")]
pub(super) fn correlation_avx2(block: &PatchBlock, planes: &[Lanes; 3], source: &Source) -> Lanes {
    let mut result = [0.0; LANES];
    kernel::<Wide256>(block, planes, source, &mut result);
    result
}

#[target_feature(enable = "avx512f")]
pub(super) fn disagreement_avx512(
    source: &Source,
    map: &[f32],
    u: &Lanes,
    v: f32,
    w: &Lanes,
) -> Lanes {
    round_trip::<Wide512>(source, map, u, v, w)
}

#[target_feature(enable = "avx2")]
pub(super) fn disagreement_avx2(
    source: &Source,
    map: &[f32],
    u: &Lanes,
    v: f32,
    w: &Lanes,
) -> Lanes {
    round_trip::<Wide256>(source, map, u, v, w)
}

#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl")]
pub(super) fn run_avx512(work: impl Work) {
    work.run();
}

#[target_feature(enable = "avx2")]
pub(super) fn run_avx2(work: impl Work) {
    work.run();
}

/// Only made and used inside of functions for AVX-512.
#[derive(Clone, Copy)]
struct Wide512(__m512);

/// Only made and used inside of functions for AVX2.
#[derive(Clone, Copy)]
struct Wide256(__m256);

/// The methods whose names differ by the width alone. SAFETY of all: the functions above,
/// which alone use these vectors, are compiled for the instructions.
macro_rules! arithmetic {
    ($width:expr, $splat:ident, $load:ident, $store:ident, $add:ident, $sub:ident, $mul:ident,
     $div:ident, $max:ident, $min:ident, $sqrt:ident) => {
        const WIDTH: usize = $width;
        #[inline(always)]
        fn splat(value: f32) -> Self {
            Self(unsafe { $splat(value) })
        }
        #[inline(always)]
        fn load(values: &[f32]) -> Self {
            let values: &[f32; $width] = values.first_chunk().expect("a lane for each");
            Self(unsafe { $load(values.as_ptr()) })
        }
        #[inline(always)]
        fn store(self, values: &mut [f32]) {
            let values: &mut [f32; $width] = values.first_chunk_mut().expect("a lane for each");
            unsafe { $store(values.as_mut_ptr(), self.0) }
        }
        #[inline(always)]
        fn add(self, other: Self) -> Self {
            Self(unsafe { $add(self.0, other.0) })
        }
        #[inline(always)]
        fn sub(self, other: Self) -> Self {
            Self(unsafe { $sub(self.0, other.0) })
        }
        #[inline(always)]
        fn mul(self, other: Self) -> Self {
            Self(unsafe { $mul(self.0, other.0) })
        }
        #[inline(always)]
        fn div(self, other: Self) -> Self {
            Self(unsafe { $div(self.0, other.0) })
        }
        #[inline(always)]
        fn max(self, other: Self) -> Self {
            Self(unsafe { $max(self.0, other.0) })
        }
        #[inline(always)]
        fn min(self, other: Self) -> Self {
            Self(unsafe { $min(self.0, other.0) })
        }
        #[inline(always)]
        fn sqrt(self) -> Self {
            Self(unsafe { $sqrt(self.0) })
        }
    };
}

impl Vector for Wide512 {
    arithmetic!(
        16,
        _mm512_set1_ps,
        _mm512_loadu_ps,
        _mm512_storeu_ps,
        _mm512_add_ps,
        _mm512_sub_ps,
        _mm512_mul_ps,
        _mm512_div_ps,
        _mm512_max_ps,
        _mm512_min_ps,
        _mm512_sqrt_ps
    );
    #[inline(always)]
    fn trunc(self) -> Self {
        // SAFETY: as above.
        Self(unsafe { _mm512_roundscale_ps::<_MM_FROUND_TO_ZERO>(self.0) })
    }
    #[inline(always)]
    fn if_less(self, other: Self, yes: Self, no: Self) -> Self {
        // SAFETY: as above.
        Self(unsafe {
            let less = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(self.0, other.0);
            _mm512_mask_blend_ps(less, no.0, yes.0)
        })
    }
    #[inline(always)]
    fn gather_bytes(index: Self, entries: &[u32]) -> [Self; 4] {
        // SAFETY: as above, and the kernel keeps every index below the length.
        unsafe {
            let index = _mm512_cvttps_epi32(index.0);
            let quads = _mm512_i32gather_epi32::<4>(index, entries.as_ptr().cast());
            let byte = _mm512_set1_epi32(0xff);
            let second = _mm512_and_si512(_mm512_srli_epi32::<8>(quads), byte);
            let third = _mm512_and_si512(_mm512_srli_epi32::<16>(quads), byte);
            [
                Self(_mm512_cvtepi32_ps(_mm512_and_si512(quads, byte))),
                Self(_mm512_cvtepi32_ps(second)),
                Self(_mm512_cvtepi32_ps(third)),
                Self(_mm512_cvtepi32_ps(_mm512_srli_epi32::<24>(quads))),
            ]
        }
    }
    #[inline(always)]
    fn gather(index: Self, entries: &[f32]) -> Self {
        // SAFETY: as above.
        Self(unsafe { _mm512_i32gather_ps::<4>(_mm512_cvttps_epi32(index.0), entries.as_ptr()) })
    }
}

impl Vector for Wide256 {
    arithmetic!(
        8,
        _mm256_set1_ps,
        _mm256_loadu_ps,
        _mm256_storeu_ps,
        _mm256_add_ps,
        _mm256_sub_ps,
        _mm256_mul_ps,
        _mm256_div_ps,
        _mm256_max_ps,
        _mm256_min_ps,
        _mm256_sqrt_ps
    );
    #[inline(always)]
    fn trunc(self) -> Self {
        // SAFETY: as above.
        Self(unsafe { _mm256_round_ps::<_MM_FROUND_TO_ZERO>(self.0) })
    }
    #[inline(always)]
    fn if_less(self, other: Self, yes: Self, no: Self) -> Self {
        // SAFETY: as above.
        Self(unsafe { _mm256_blendv_ps(no.0, yes.0, _mm256_cmp_ps::<_CMP_LT_OQ>(self.0, other.0)) })
    }
    #[inline(always)]
    fn gather_bytes(index: Self, entries: &[u32]) -> [Self; 4] {
        // SAFETY: as above, and the kernel keeps every index below the length.
        unsafe {
            let index = _mm256_cvttps_epi32(index.0);
            let quads = _mm256_i32gather_epi32::<4>(entries.as_ptr().cast(), index);
            let byte = _mm256_set1_epi32(0xff);
            let second = _mm256_and_si256(_mm256_srli_epi32::<8>(quads), byte);
            let third = _mm256_and_si256(_mm256_srli_epi32::<16>(quads), byte);
            [
                Self(_mm256_cvtepi32_ps(_mm256_and_si256(quads, byte))),
                Self(_mm256_cvtepi32_ps(second)),
                Self(_mm256_cvtepi32_ps(third)),
                Self(_mm256_cvtepi32_ps(_mm256_srli_epi32::<24>(quads))),
            ]
        }
    }
    #[inline(always)]
    fn gather(index: Self, entries: &[f32]) -> Self {
        // SAFETY: as above.
        Self(unsafe { _mm256_i32gather_ps::<4>(entries.as_ptr(), _mm256_cvttps_epi32(index.0)) })
    }
}
