//! Planes that spread, are perturbed and compete: PatchMatch on a checkerboard.

use nalgebra::Vector3;
use volery_geometry::{SimdLevel, rng::mix};

use crate::checkerboard::{Block, Cells, Field, JURY, Neighbors};
use crate::dice::Dice;
use crate::patch::{LANES, Lanes, PatchBlock, PatchSource};
use crate::plane::{Plane, Planes, Rays};
use crate::simd::{Work, correlation, disagreement, run};
use crate::source::Source;

/// Cost of a plane that one other image speaks against as loudly as it can.
pub(crate) const MAX_COST: f32 = 1.0;
/// How many other images have to agree; of more, the best count (occlusions).
const BEST_SOURCES: usize = 2;
/// Most sources of an image.
pub(crate) const MAX_SOURCES: usize = 16;
/// Cost of a pixel by which the depth map of another image disagrees.
const GEOMETRIC_COST_PER_PX: f32 = 0.15;
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

impl Judge<'_> {
    /// Sets the costs of all planes.
    pub(crate) fn assess(&self, field: &mut Field) {
        for color in 0..2 {
            field.change(color, |block, _, cells| {
                run(self.simd, Assess { judge: self, block, cells });
            });
        }
    }

    /// One iteration: every pixel looks at planes of its neighbors and at perturbed ones of its own.
    pub(crate) fn sweep(&self, field: &mut Field, sweep: Sweep) {
        for color in 0..2 {
            field.change(color, |block, neighbors, cells| {
                run(self.simd, Improve { judge: self, block, neighbors, cells, sweep });
            });
        }
    }

    #[inline(always)]
    fn improve(&self, block: &Block, neighbors: &Neighbors, cells: &mut Cells, sweep: Sweep) {
        let patch = self.patches.block(&block.columns, block.y);
        if sweep.summons {
            self.summon(&patch, cells);
        }
        for direction in 0..4 {
            let planes = neighbors.best(block, direction, &cells.planes);
            self.compete(&patch, &planes, cells);
        }
        for trial in 0..3 {
            let dice = std::array::from_fn(|lane| {
                let pixel = (block.y as u64) << 32 | block.columns[lane] as u64;
                Dice(mix(self.seed ^ mix(pixel ^ mix(sweep.number << 8 | trial))))
            });
            let planes = self.perturbed(&cells.planes, &patch, trial, dice);
            self.compete(&patch, &planes, cells);
        }
    }

    #[inline(always)]
    fn compete(&self, patch: &PatchBlock, planes: &Planes, cells: &mut Cells) {
        let mut bench = Bench::new();
        for &index in &cells.jury[..self.sources.len().min(JURY)] {
            bench.hear(self.source_costs(usize::from(index), patch, planes));
        }
        let costs = self.possible(patch, planes, bench.verdict());
        for lane in 0..LANES {
            let better = costs[lane] < cells.costs[lane];
            for (kept, offered) in cells.planes.iter_mut().zip(planes) {
                kept[lane] = if better { offered[lane] } else { kept[lane] };
            }
            cells.costs[lane] = if better { costs[lane] } else { cells.costs[lane] };
        }
    }

    /// Another depth, another normal, or both.
    #[inline(always)]
    fn perturbed(
        &self,
        planes: &Planes,
        patch: &PatchBlock,
        trial: u64,
        mut dice: [Dice; LANES],
    ) -> Planes {
        let mut perturbed = *planes;
        for lane in 0..LANES {
            let dice = &mut dice[lane];
            let mut plane = plane_of(planes, lane);
            let mut normal = self.rays.normal(&plane, patch.u[lane], patch.v);
            if trial != 1 {
                let step = self.inverse_depth_per_px * dice.power(DEPTH_STEPS);
                plane.w = (plane.w + step * dice.sign()).clamp(self.range[0], self.range[1]);
            }
            if trial != 0 {
                let step = dice.power(NORMAL_STEPS);
                normal += step * Vector3::new(dice.spread(), dice.spread(), dice.spread());
            }
            let Plane { w, slope_u, slope_v } =
                self.rays.plane(patch.u[lane], patch.v, plane.w, &normal);
            for (lanes, value) in perturbed.iter_mut().zip([w, slope_u, slope_v]) {
                lanes[lane] = value;
            }
        }
        perturbed
    }

    /// Finds the sources that agree best with the planes of the cells and sets the costs by them.
    #[inline(always)]
    fn summon(&self, patch: &PatchBlock, cells: &mut Cells) {
        let mut costs = [[0.0; LANES]; MAX_SOURCES];
        let mut ranked = [(f32::INFINITY, 0); MAX_SOURCES];
        for index in 0..self.sources.len() {
            costs[index] = self.source_costs(index, patch, &cells.planes);
            ranked[index] = (costs[index].iter().sum(), index);
        }
        let ranked = &mut ranked[..self.sources.len()];
        ranked.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut bench = Bench::new();
        for (member, &(_, index)) in cells.jury.iter_mut().zip(ranked.iter()) {
            *member = index as u8;
            bench.hear(costs[index]);
        }
        cells.costs = self.possible(patch, &cells.planes, bench.verdict());
    }

    /// What one source says against the planes.
    #[inline(always)]
    fn source_costs(&self, index: usize, patch: &PatchBlock, planes: &Planes) -> Lanes {
        let source = &self.sources[index];
        let mut costs = correlation(self.simd, patch, planes, source);
        for cost in &mut costs {
            *cost = (1.0 - *cost).min(MAX_COST);
        }
        let Some(maps) = self.geometry else { return costs };
        let off = match maps[index] {
            Some(map) => disagreement(self.simd, source, map, &patch.u, patch.v, &planes[0]),
            None => [SILENT_DISAGREEMENT_PX; LANES],
        };
        for (cost, off) in costs.iter_mut().zip(off) {
            *cost += GEOMETRIC_COST_PER_PX * off;
        }
        costs
    }

    /// The costs, infinite for planes out of the depth range or seen too flat.
    #[inline(always)]
    fn possible(&self, patch: &PatchBlock, planes: &Planes, costs: Lanes) -> Lanes {
        let mut possible = costs;
        for lane in 0..LANES {
            let plane = plane_of(planes, lane);
            let is_possible = (plane.w >= self.range[0])
                & (plane.w <= self.range[1])
                & self.rays.is_visible(&plane, patch.u[lane], patch.v);
            possible[lane] = if is_possible { costs[lane] } else { f32::INFINITY };
        }
        possible
    }
}

/// An iteration over all pixels.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sweep {
    /// Tells its perturbations from those of other iterations.
    pub(crate) number: u64,
    /// Whether the sources that judge are chosen anew.
    pub(crate) summons: bool,
}

struct Assess<'a, 'b> {
    judge: &'a Judge<'b>,
    block: &'a Block,
    cells: &'a mut Cells,
}

impl Work for Assess<'_, '_> {
    #[inline(always)]
    fn run(self) {
        let patch = self.judge.patches.block(&self.block.columns, self.block.y);
        self.judge.summon(&patch, self.cells);
    }
}

struct Improve<'a, 'b> {
    judge: &'a Judge<'b>,
    block: &'a Block,
    neighbors: &'a Neighbors<'a>,
    cells: &'a mut Cells,
    sweep: Sweep,
}

impl Work for Improve<'_, '_> {
    #[inline(always)]
    fn run(self) {
        self.judge.improve(self.block, self.neighbors, self.cells, self.sweep);
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

    #[inline(always)]
    fn hear(&mut self, mut costs: Lanes) {
        self.num_heard += 1;
        for kept in &mut self.least {
            for (kept, cost) in kept.iter_mut().zip(&mut costs) {
                (*kept, *cost) = (kept.min(*cost), kept.max(*cost));
            }
        }
    }

    /// Mean of the least costs.
    #[inline(always)]
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

#[inline(always)]
fn plane_of(planes: &Planes, lane: usize) -> Plane {
    Plane { w: planes[0][lane], slope_u: planes[1][lane], slope_v: planes[2][lane] }
}
