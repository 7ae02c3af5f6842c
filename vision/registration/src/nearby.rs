//! Registration from a start that is about right, from coarse to fine.

use nalgebra::Similarity3;

use crate::icp::{Icp, IcpOptions, Metric, icp};
use crate::kernel::Kernel;
use crate::surfels::{Surfel, Surfels};
use crate::{Motion, RegistrationError};

/// Source pieces that are paired at each level; more tell nothing that matters.
const MAX_SOURCE_PIECES: usize = 100_000;
/// Largest distance of a pair at a level, cells of that level.
const REACH: f64 = 2.0;

/// How two zones are brought together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NearbyOptions {
    /// Residual.
    pub metric: Metric,
    /// Degrees of freedom.
    pub motion: Motion,
    /// Robust loss.
    pub kernel: Kernel,
    /// How far the start may be off, units of the target.
    pub reach: f64,
}

impl Default for NearbyOptions {
    fn default() -> Self {
        Self {
            metric: Metric::default(),
            motion: Motion::default(),
            kernel: Kernel::default(),
            reach: 0.4,
        }
    }
}

/// Moves `source` from `start` onto `target`, first sparse pieces within `reach`, then ever denser
/// ones within two cells.
///
/// # Errors
///
/// As [`icp`], and [`RegistrationError::Underconstrained`] where the overlap leaves a motion free.
pub fn register_nearby(
    source: &Surfels,
    target: &Surfels,
    start: &Similarity3<f64>,
    options: &NearbyOptions,
) -> Result<Icp, RegistrationError> {
    let cell = target.cell().max(source.cell() * start.scaling());
    let mut target_from_source = *start;
    let mut reach = options.reach;
    while reach > 2.0 * REACH * cell {
        let level = reach / REACH / 2.0;
        let thin = target.thinned(level)?;
        let found = at_level(source, &thin, &target_from_source, reach, 30, level, options)?;
        target_from_source = found.target_from_source;
        reach /= 2.0;
    }
    let found = at_level(source, target, &target_from_source, REACH * cell, 30, cell, options)?;
    if found.constraint.free.is_empty() {
        Ok(found)
    } else {
        Err(RegistrationError::Underconstrained { directions: found.constraint.free })
    }
}

fn at_level(
    source: &Surfels,
    target: &Surfels,
    start: &Similarity3<f64>,
    max_distance: f64,
    max_iterations: usize,
    level: f64,
    options: &NearbyOptions,
) -> Result<Icp, RegistrationError> {
    // Surface thins with the square of the cell.
    let share = (source.cell() * start.scaling() / level).powi(2).min(1.0);
    let wanted = (source.pieces().len() as f64 * share).ceil().min(MAX_SOURCE_PIECES as f64);
    let step = (source.pieces().len() as f64 / wanted).ceil() as usize;
    let sample: Vec<Surfel> = source.pieces().iter().step_by(step).copied().collect();
    let NearbyOptions { metric, motion, kernel, .. } = *options;
    let options = IcpOptions { metric, motion, kernel, max_distance, kept: 1.0, max_iterations };
    icp(&sample, target, start, &options)
}
