//! The passes over observations, compiled for what the processor has.
//!
//! The bodies are ordinary functions marked `inline(always)`; here they are instantiated with
//! wider vectors and fused multiply-add.

use std::ops::Range;

use volery_geometry::SimdLevel;

use super::layout::{LANES, Layout};
use super::linearize::{self, Factor, Pass, PointTerms, Sums};
use super::state::State;
use super::{cost, schur};

/// Fused multiply-add is part of every processor of the target.
const BASELINE_FMA: bool = cfg!(any(target_feature = "fma", target_arch = "aarch64"));

/// Defines a function that calls `$body::<FMA>` under the features of the level.
macro_rules! dispatched {
    ($(#[$doc:meta])* $name:ident = $module:ident::$body:ident, ($($arg:ident: $ty:ty),* $(,)?) -> $ret:ty) => {
        $(#[$doc])*
        pub(super) fn $name(level: SimdLevel, $($arg: $ty),*) -> $ret {
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2,fma")]
            fn avx2($($arg: $ty),*) -> $ret {
                $module::$body::<true>($($arg),*)
            }
            #[cfg(target_arch = "x86_64")]
            #[target_feature(enable = "avx2,fma,avx512f,avx512vl,avx512dq")]
            fn avx512($($arg: $ty),*) -> $ret {
                $module::$body::<true>($($arg),*)
            }
            match level {
                // SAFETY: `SimdLevel::available` lists a level only if the processor has it.
                #[cfg(target_arch = "x86_64")]
                SimdLevel::Avx512 => unsafe { avx512($($arg),*) },
                // SAFETY: as above.
                #[cfg(target_arch = "x86_64")]
                SimdLevel::Avx2 => unsafe { avx2($($arg),*) },
                _ => $module::$body::<BASELINE_FMA>($($arg),*),
            }
        }
    };
}

dispatched! {
    /// [`linearize::linearize_chunk`].
    linearize_chunk = linearize::linearize_chunk, (
        pass: &Pass<'_>,
        points: Range<usize>,
        factors: &mut [Factor],
        terms: &mut [PointTerms],
        sums: &mut Sums,
    ) -> ()
}

dispatched! {
    /// [`linearize::step_points`].
    step_points = linearize::step_points, (
        pass: &Pass<'_>,
        points: Range<usize>,
        factors: &[Factor],
        terms: &[PointTerms],
        step: &[[f64; LANES]],
        moved: &mut [[f64; 3]],
    ) -> f64
}

dispatched! {
    /// [`cost::chunk_cost`].
    chunk_cost = cost::chunk_cost, (
        layout: &Layout,
        state: &State,
        loss_scale_inv2: f64,
        points: Range<usize>,
    ) -> f64
}

dispatched! {
    /// [`schur::subtract_products`].
    subtract_products = schur::subtract_products, (
        layout: &Layout,
        factors: &[Factor],
        row: usize,
        blocks: &mut [[f64; LANES]],
    ) -> ()
}
