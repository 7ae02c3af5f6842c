//! Planes that spread, are perturbed and compete: PatchMatch on a checkerboard.

use nalgebra::Vector3;
use volery_geometry::{SimdLevel, rng::mix};

use crate::checkerboard::{Block, Cell, Field, Neighbors};
use crate::dice::Dice;
use crate::patch::{LANES, Lanes, PatchBlock, PatchSource};
use crate::plane::{Plane, Rays};
use crate::simd::correlation;
use crate::source::Source;

/// Cost of a plane that one other image speaks against as loudly as it can.
pub(crate) const MAX_COST: f32 = 1.0;
/// How many other images have to agree; of more, the best count (occlusions).
const BEST_SOURCES: usize = 2;
/// Sources that judge sixteen pixels, those that agree best with what the pixels believe.
const JURY: usize = 4;
/// Most sources of an image.
pub(crate) const MAX_SOURCES: usize = 16;
/// Cost of a pixel by which the depth map of another image disagrees.
const GEOMETRIC_COST_PER_PX: f32 = 0.15;
/// Disagreement that costs no more when it grows, pixels.
const MAX_DISAGREEMENT_PX: f32 = 3.0;
/// What a source without a depth map is taken to disagree by, pixels.
const SILENT_DISAGREEMENT_PX: f32 = 1.0;
/// Least and largest perturbation of a depth, in pixels of parallax as powers of two.
const DEPTH_STEPS: [f32; 2] = [-5.0, 1.0];
/// Least and largest perturbation of a normal, tangents of the angle as powers of two.
const NORMAL_STEPS: [f32; 2] = [-5.0, -1.0];

/// Everything that a plane is judged by.
#[derive(Debug)]
pub(crate) struct Judge<'a> {
    pub(crate) simd: SimdLevel,
    pub(crate) patches: PatchSource,
    pub(crate) sources: &'a [Source],
    /// Inverse depths of the sources, row by row, 0 where unknown.
    pub(crate) geometry: Option<&'a [Option<&'a [f32]>]>,
    pub(crate) rays: Rays,
    /// Least and greatest inverse depth.
    pub(crate) range: [f32; 2],
    /// Change of inverse depth that moves a point by a pixel in a typical source.
    pub(crate) inverse_depth_per_px: f32,
    pub(crate) seed: u64,
}

/// Planes for sixteen pixels: inverse depth and its two slopes.
type Planes = [Lanes; 3];

impl Judge<'_> {
    /// Sets the costs of all planes.
    pub(crate) fn assess(&self, field: &mut Field) {
        for color in 0..2 {
            field.change(color, |block, _, cells| {
                let patch = self.patches.block(&block.columns, block.y);
                self.summon(&patch, cells);
            });
        }
    }

    /// One iteration: every pixel looks at planes of its neighbors and at perturbed ones of its own.
    pub(crate) fn sweep(&self, field: &mut Field, iteration: u64) {
        for color in 0..2 {
            field.change(color, |block, neighbors, cells| {
                self.improve(block, neighbors, cells, iteration);
            });
        }
    }

    fn improve(
        &self,
        block: &Block,
        neighbors: &Neighbors,
        cells: &mut [Cell; LANES],
        iteration: u64,
    ) {
        let patch = self.patches.block(&block.columns, block.y);
        let jury = self.summon(&patch, cells);
        for direction in 0..4 {
            let planes: [Plane; LANES] = std::array::from_fn(|lane| {
                neighbors.best(block.columns[lane], block.y, direction).unwrap_or(cells[lane].plane)
            });
            self.compete(&patch, &jury, &planes, cells);
        }
        for trial in 0..3 {
            let planes: [Plane; LANES] = std::array::from_fn(|lane| {
                let pixel = (block.y as u64) << 32 | block.columns[lane] as u64;
                let key = self.seed ^ mix(pixel ^ mix(iteration << 8 | trial));
                self.perturbed(&cells[lane].plane, patch.u[lane], patch.v, trial, Dice(mix(key)))
            });
            self.compete(&patch, &jury, &planes, cells);
        }
    }

    fn compete(
        &self,
        patch: &PatchBlock,
        jury: &Jury,
        planes: &[Plane; LANES],
        cells: &mut [Cell; LANES],
    ) {
        let planes_by_lane = planes_of(planes);
        let mut bench = Bench::new();
        for &index in jury.sources() {
            bench.hear(self.source_costs(index, patch, &planes_by_lane));
        }
        let costs = self.possible(patch, &planes_by_lane, bench.verdict());
        for lane in 0..LANES {
            if costs[lane] < cells[lane].cost {
                cells[lane] = Cell { plane: planes[lane], cost: costs[lane] };
            }
        }
    }

    /// Another depth, another normal, or both.
    fn perturbed(&self, plane: &Plane, u: f32, v: f32, trial: u64, mut dice: Dice) -> Plane {
        let mut w = plane.w;
        let mut normal = self.rays.normal(plane, u, v);
        if trial != 1 {
            let step = self.inverse_depth_per_px * dice.power(DEPTH_STEPS);
            w = (w + step * dice.sign()).clamp(self.range[0], self.range[1]);
        }
        if trial != 0 {
            let step = dice.power(NORMAL_STEPS);
            normal += step * Vector3::new(dice.spread(), dice.spread(), dice.spread());
        }
        self.rays.plane(u, v, w, &normal)
    }

    /// The sources that agree best with the planes of the cells, whose costs they set.
    fn summon(&self, patch: &PatchBlock, cells: &mut [Cell; LANES]) -> Jury {
        let planes = planes_of(&cells.map(|cell| cell.plane));
        let mut costs = [[0.0; LANES]; MAX_SOURCES];
        let mut ranked = [(f32::INFINITY, 0); MAX_SOURCES];
        for index in 0..self.sources.len() {
            costs[index] = self.source_costs(index, patch, &planes);
            ranked[index] = (costs[index].iter().sum(), index);
        }
        let ranked = &mut ranked[..self.sources.len()];
        ranked.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut jury = Jury { members: [0; JURY], len: ranked.len().min(JURY) };
        let mut bench = Bench::new();
        for (member, &(_, index)) in jury.members.iter_mut().zip(ranked.iter()) {
            *member = index;
            bench.hear(costs[index]);
        }
        for (cell, cost) in cells.iter_mut().zip(self.possible(patch, &planes, bench.verdict())) {
            cell.cost = cost;
        }
        jury
    }

    /// What one source says against the planes.
    fn source_costs(&self, index: usize, patch: &PatchBlock, planes: &Planes) -> Lanes {
        let source = &self.sources[index];
        let mut costs = correlation(self.simd, patch, planes, source);
        for cost in &mut costs {
            *cost = (1.0 - *cost).min(MAX_COST);
        }
        let Some(maps) = self.geometry else { return costs };
        for lane in 0..LANES {
            let off = maps[index].map_or(SILENT_DISAGREEMENT_PX, |map| {
                disagreement(source, map, [patch.u[lane], patch.v], planes[0][lane])
            });
            costs[lane] += GEOMETRIC_COST_PER_PX * off;
        }
        costs
    }

    /// The costs, infinite for planes out of the depth range or seen too flat.
    fn possible(&self, patch: &PatchBlock, planes: &Planes, costs: Lanes) -> Lanes {
        std::array::from_fn(|lane| {
            let w = planes[0][lane];
            let plane = Plane { w, slope_u: planes[1][lane], slope_v: planes[2][lane] };
            let possible = w >= self.range[0]
                && w <= self.range[1]
                && self.rays.is_visible(&plane, patch.u[lane], patch.v);
            if possible { costs[lane] } else { f32::INFINITY }
        })
    }
}

/// The sources that judge sixteen pixels.
struct Jury {
    members: [usize; JURY],
    len: usize,
}

impl Jury {
    fn sources(&self) -> &[usize] {
        &self.members[..self.len]
    }
}

/// The least costs of what was heard, in rising order.
struct Bench {
    least: [Lanes; BEST_SOURCES],
    num_heard: usize,
}

impl Bench {
    fn new() -> Self {
        Self { least: [[f32::INFINITY; LANES]; BEST_SOURCES], num_heard: 0 }
    }

    fn hear(&mut self, mut costs: Lanes) {
        self.num_heard += 1;
        for kept in &mut self.least {
            for (kept, cost) in kept.iter_mut().zip(&mut costs) {
                (*kept, *cost) = (kept.min(*cost), kept.max(*cost));
            }
        }
    }

    /// Mean of the least costs.
    fn verdict(&self) -> Lanes {
        let num = self.num_heard.min(BEST_SOURCES);
        let mut mean = [0.0; LANES];
        for kept in &self.least[..num] {
            for (sum, cost) in mean.iter_mut().zip(kept) {
                *sum += cost / num as f32;
            }
        }
        mean
    }
}

/// Pixels between a pixel and where it comes back to by the depth that `map` has where the pixel
/// lands in the source, at most [`MAX_DISAGREEMENT_PX`].
///
/// Source: Xu and Tao, CVPR 2019, eq. (8).
pub(crate) fn disagreement(source: &Source, map: &[f32], [u, v]: [f32; 2], w: f32) -> f32 {
    let [x, y, z] = source.from_reference.apply(u, v, w);
    let (x, y) = (x / z, y / z);
    let (width, height) = (source.image.width, source.image.height);
    let inside = z > 0.0 && x >= 0.0 && y >= 0.0 && x < width as f32 && y < height as f32;
    if !inside {
        return MAX_DISAGREEMENT_PX;
    }
    let there = map[y as usize * width + x as usize];
    if there <= 0.0 {
        return MAX_DISAGREEMENT_PX;
    }
    let [back_x, back_y, back_z] = source.to_reference.apply(x, y, there);
    let (du, dv) = (back_x / back_z - u, back_y / back_z - v);
    let off = (du * du + dv * dv).sqrt();
    if back_z > 0.0 && off < MAX_DISAGREEMENT_PX { off } else { MAX_DISAGREEMENT_PX }
}

fn planes_of(planes: &[Plane; LANES]) -> Planes {
    [planes.map(|p| p.w), planes.map(|p| p.slope_u), planes.map(|p| p.slope_v)]
}
