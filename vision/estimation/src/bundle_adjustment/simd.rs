//! The passes over observations, compiled for what the processor has.
//!
//! The bodies are ordinary functions marked `inline(always)`; here they are instantiated with
//! wider vectors and fused multiply-add.

use std::ops::Range;

use super::layout::{LANES, Layout};
use super::linearize::{self, Factor, Pass, PointTerms, Sums};
use super::state::State;
use super::{cost, schur};

/// Fused multiply-add is part of every processor of the target.
const BASELINE_FMA: bool = cfg!(any(target_feature = "fma", target_arch = "aarch64"));

/// Instructions that were found at run time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Isa(Level);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Level {
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl Isa {
    #[cfg(test)]
    pub(super) const PORTABLE: Self = Self(Level::Portable);

    /// The best that this processor has.
    pub(super) fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            use std::arch::is_x86_feature_detected as has;
            let has_avx2 = has!("avx2") && has!("fma");
            if has_avx2 && has!("avx512f") && has!("avx512vl") && has!("avx512dq") {
                return Self(Level::Avx512);
            }
            if has_avx2 {
                return Self(Level::Avx2);
            }
        }
        Self(Level::Portable)
    }
}

/// Defines a function that calls `$body::<FMA>` under the features of the level.
macro_rules! dispatched {
    ($(#[$doc:meta])* $name:ident = $module:ident::$body:ident, ($($arg:ident: $ty:ty),* $(,)?) -> $ret:ty) => {
        $(#[$doc])*
        pub(super) fn $name(isa: Isa, $($arg: $ty),*) -> $ret {
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
            match isa.0 {
                Level::Portable => $module::$body::<BASELINE_FMA>($($arg),*),
                // SAFETY: the level exists only where `Isa::detect` found these features.
                #[cfg(target_arch = "x86_64")]
                Level::Avx2 => unsafe { avx2($($arg),*) },
                // SAFETY: as above.
                #[cfg(target_arch = "x86_64")]
                Level::Avx512 => unsafe { avx512($($arg),*) },
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
