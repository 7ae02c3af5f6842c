//! Screened Poisson reconstruction: oriented points to a watertight surface.
//!
//! The surface is a level set of the field χ that minimizes
//!
//! ```text
//! E(χ) = ∫ ‖∇χ − V‖² dx + α/h Σₚ aₚ (χ(p) − τₚ)²
//! ```
//!
//! V holds the normals of the samples p, spread over cells of side h and weighted by the areas aₚ
//! that they stand for: χ jumps by about one across the surface. The second term, the screen,
//! draws χ to the same value at all samples (P56).
//!
//! χ is sought among the sums of trilinear tents over an adaptive octree. They are straight between
//! the corners of a cell, where χ is not: drawn to 0 itself they bend χ by hundredths of a cell,
//! another way in each. τ is what tents that are right at the corners say at the sample ([`step`]).
//!
//! Sources: Kazhdan, Bolitho and Hoppe, "Poisson Surface Reconstruction", SGP 2006; Kazhdan and
//! Hoppe, "Screened Poisson Surface Reconstruction", ToG 2013: the energy (3), its weight that
//! grows with depth (section 4.2), cascadic multigrid (section 3.2).

use volery_scene::{PointCloud, Progress, Stage, TriangleMesh};

use crate::MeshingError;

mod coarse;
mod crossings;
mod density;
mod field;
mod free;
mod isosurface;
mod noise;
mod octree;
mod polygons;
mod relax;
mod rows;
mod samples;
mod screen;
mod solution;
mod step;
mod transfer;

#[cfg(test)]
mod tests;

use density::Density;
use field::Weighted;
use isosurface::isosurface;
use noise::{noise_in_cells, screening_under};
use octree::{BASE_DEPTH, Octree};
use rows::Rows;
use samples::{Samples, cell_of};
use solution::Solution;

/// The deepest tree: 4096 cells along a side.
pub const MAX_DEPTH: u32 = 12;

/// The density is estimated on cells so many depths above the finest (Kazhdan's 2).
const DENSITY_DEPTH_OFFSET: u32 = 2;

/// Options of [`reconstruct_surface`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoissonOptions {
    /// Greatest depth of the octree: the finest cells are the cube's side / 2^depth.
    pub depth: u32,
    /// α, how strongly the surface is drawn to samples without noise, less to others; 0 is the
    /// unscreened method.
    pub screening: f64,
    /// Samples that a cell should hold: where there are fewer, coarser cells are used. More for
    /// noisy clouds.
    pub samples_per_cell: f64,
}

impl Default for PoissonOptions {
    fn default() -> Self {
        Self { depth: 9, screening: 16.0, samples_per_cell: 1.5 }
    }
}

/// A surface that knows how well it is founded.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Surface {
    /// The triangles.
    pub mesh: TriangleMesh,
    /// Per vertex, samples per square unit of the cloud's frame.
    pub densities: Vec<f32>,
}

/// The surface of an oriented point cloud.
///
/// It is closed, but where it leaves the cube around the points; what no sample supports can be
/// cut off with [`crate::trim::trim`].
///
/// # Errors
///
/// [`MeshingError`] for numbers that are not finite and normals without direction, for less than
/// three points and for points all in one place, for options out of range, and when cancelled.
pub fn reconstruct_surface(
    cloud: &PointCloud,
    options: &PoissonOptions,
    progress: &dyn Progress,
) -> Result<Surface, MeshingError> {
    check(options)?;
    let samples = Samples::from_cloud(cloud)?;
    let density = Density::estimate(
        &samples,
        options.depth - DENSITY_DEPTH_OFFSET,
        options.samples_per_cell as f32,
    );
    progress.check()?;
    let per_area: Vec<f32> = samples.positions.iter().map(|&p| density.per_area(p)).collect();
    let areas: Vec<f32> = per_area.iter().map(|density| 1.0 / density).collect();
    let finest = options.depth as f32;
    let depths: Vec<f32> =
        per_area.iter().map(|&d| density.depth(d).clamp(BASE_DEPTH as f32, finest)).collect();
    let octree = Octree::around(&sample_cells(&samples, &depths, options.depth));
    let weighted = Weighted { samples: &samples, areas: &areas, depths: &depths };
    let screening = screening_under(noise_in_cells(&samples, &depths), options.screening as f32);
    let solution = Solution::solve(&octree, weighted, screening, progress)?;
    let iso_value = solution.mean_at(&octree, weighted);
    let mesh = isosurface(&octree, &solution, iso_value);
    let unit_area = (samples.cube.side * samples.cube.side) as f32;
    let densities = mesh.positions.iter().map(|&p| density.per_area(p) / unit_area).collect();
    let vertices = mesh.positions.iter().map(|&p| samples.cube.to_world(p)).collect();
    progress.report(Stage::Meshing, 1, 1);
    let mesh = TriangleMesh { vertices, triangles: mesh.triangles, colors: Vec::new() };
    Ok(Surface { mesh, densities })
}

fn check(options: &PoissonOptions) -> Result<(), MeshingError> {
    let PoissonOptions { depth, screening, samples_per_cell } = *options;
    if !(BASE_DEPTH..=MAX_DEPTH).contains(&depth) {
        return Err(MeshingError::Depth { got: depth, least: BASE_DEPTH, most: MAX_DEPTH });
    }
    for (name, value) in [("screening", screening), ("samples_per_cell", samples_per_cell)] {
        if !value.is_finite() || value < 0.0 {
            return Err(MeshingError::Option { name, got: value });
        }
    }
    if samples_per_cell == 0.0 {
        return Err(MeshingError::Option { name: "samples_per_cell", got: samples_per_cell });
    }
    Ok(())
}

/// Per depth, the cells of the samples that this depth is the finest of.
fn sample_cells(samples: &Samples, depths: &[f32], finest: u32) -> Vec<Rows> {
    (0..=finest)
        .map(|depth| {
            let mut cells: Vec<[u32; 3]> = samples
                .positions
                .iter()
                .zip(depths)
                .filter(|&(_, d)| d.ceil() as u32 == depth)
                .map(|(&position, _)| cell_of(position, depth).0)
                .collect();
            cells.dedup();
            Rows::from_points(1 << depth, cells.into_iter())
        })
        .collect()
}
