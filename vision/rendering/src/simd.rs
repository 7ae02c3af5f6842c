//! Drawing compiled for the instruction sets of a processor.
//!
//! The loops over lanes are plain; the compiler only widens them: it neither reorders sums nor
//! fuses multiply and add, so every set gives the same bits.

use volery_geometry::SimdLevel;

use crate::frame::Band;
use crate::raster::View;
use crate::{DrawableMesh, VirtualCamera};

/// Pixels of a block.
pub(crate) const LANES: usize = 16;

/// [`crate::raster::raster`] for an instruction set.
pub(crate) fn raster(
    level: SimdLevel,
    mesh: &DrawableMesh,
    view: &View,
    shown: &[u32],
    eye: &VirtualCamera,
    band: &mut Band,
) {
    match level {
        // SAFETY: `SimdLevel::available` lists a level only if the processor has it.
        #[cfg(target_arch = "x86_64")]
        SimdLevel::Avx512 => unsafe { avx512(mesh, view, shown, eye, band) },
        // SAFETY: as above.
        #[cfg(target_arch = "x86_64")]
        SimdLevel::Avx2 => unsafe { avx2(mesh, view, shown, eye, band) },
        _ => crate::raster::raster(mesh, view, shown, eye, band),
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,avx512f,avx512bw,avx512dq,avx512vl")]
fn avx512(mesh: &DrawableMesh, view: &View, shown: &[u32], eye: &VirtualCamera, band: &mut Band) {
    crate::raster::raster(mesh, view, shown, eye, band);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn avx2(mesh: &DrawableMesh, view: &View, shown: &[u32], eye: &VirtualCamera, band: &mut Band) {
    crate::raster::raster(mesh, view, shown, eye, band);
}
