//! Levenberg–Marquardt.

use std::ops::Range;

use arrayvec::ArrayVec;
use rayon::prelude::*;
use volery_geometry::SimdLevel;
use volery_scene::Progress;

use super::layout::{LANES, Layout, MAX_CHUNKS};
use super::linearize::{Factor, Pass, PointTerms, Sums};
use super::priors::{add_priors, priors_cost};
use super::schur::{MIN_DIAGONAL, Pattern};
use super::simd;
use super::solve::ReducedSystem;
use super::state::State;
use super::{BundleError, BundleOptions, BundleProblem, BundleReport};

/// First damping, relative to the diagonal (Ceres' initial trust region).
const INITIAL_DAMPING: f64 = 1e-4;

/// Least damping: holds the gauge against rounding, and slows convergence by a hundred-millionth.
const MIN_DAMPING: f64 = 1e-8;

/// With so much damping a step is a hair along the gradient; if that fails nothing helps.
const MAX_DAMPING: f64 = 1e12;

/// Smallest cost per observation worth lowering, pixels².
const NEGLIGIBLE_COST: f64 = 1e-22;

/// Everything an adjustment holds; nothing is allocated between iterations.
pub(super) struct Minimizer<'a> {
    problem: &'a BundleProblem,
    /// Of the priors towards the rotations of the problem, radians.
    rotation_sigma: Option<f64>,
    layout: Layout,
    level: SimdLevel,
    loss_scale_inv2: f64,
    free_points: Vec<bool>,
    state: State,
    candidate: State,
    factors: Vec<Factor>,
    point_terms: Vec<PointTerms>,
    chunk_sums: Vec<Sums>,
    sums: Sums,
    pattern: Pattern,
    system: ReducedSystem,
    step: Vec<f64>,
    block_steps: Vec<[f64; LANES]>,
}

impl<'a> Minimizer<'a> {
    /// `None` if the memory for it is not to be had.
    pub(super) fn new(
        problem: &'a BundleProblem,
        options: &BundleOptions,
        rotation_sigma: Option<f64>,
        level: SimdLevel,
    ) -> Option<Self> {
        let layout = Layout::new(problem);
        let state = State::new(problem, &layout);
        let pattern = Pattern::new(&layout);
        Some(Self {
            problem,
            rotation_sigma,
            level,
            loss_scale_inv2: options.loss_scale_px.map_or(0.0, |c| 1.0 / (c * c)),
            free_points: layout.point_ids.iter().map(|&p| !problem.is_constant_point(p)).collect(),
            candidate: state.clone(),
            state,
            factors: vec![Factor::default(); layout.factor_blocks.len()],
            point_terms: vec![PointTerms::default(); layout.point_ids.len()],
            chunk_sums: vec![Sums::new(&layout); layout.chunks.len()],
            sums: Sums::new(&layout),
            system: ReducedSystem::new(&layout, &pattern)?,
            pattern,
            step: vec![0.0; layout.num_unknowns()],
            block_steps: vec![[0.0; LANES]; layout.num_blocks()],
            layout,
        })
    }

    /// Solves by the dense factorization; `false` if that is so anyway.
    #[cfg(test)]
    pub(super) fn make_dense(&mut self) -> bool {
        let was_sparse = !self.pattern.is_dense;
        self.pattern = Pattern::dense(&self.layout);
        self.system = ReducedSystem::new(&self.layout, &self.pattern).unwrap();
        was_sparse
    }

    /// Runs to the end or until `progress` says stop; [`Self::finish`] gives the last accepted
    /// values either way.
    pub(super) fn run(
        &mut self,
        options: &BundleOptions,
        progress: &dyn Progress,
    ) -> Result<BundleReport, BundleError> {
        let mut cost = self.cost(&self.state);
        let mut report = BundleReport {
            initial_cost: cost,
            final_cost: cost,
            num_iterations: 0,
            converged: false,
        };
        let negligible = NEGLIGIBLE_COST * self.layout.observation_poses.len() as f64;
        let (mut damping, mut growth) = (INITIAL_DAMPING, 2.0);
        while report.num_iterations < options.max_iterations {
            progress.check()?;
            if cost <= negligible || damping > MAX_DAMPING {
                report.converged = true;
                break;
            }
            report.num_iterations += 1;
            self.linearize(damping);
            let trial = self.try_step(damping);
            if let Some(predicted) = trial
                && predicted <= f64::EPSILON * cost
            {
                report.converged = true;
                break;
            }
            let candidate_cost = trial.map_or(f64::NAN, |_| self.cost(&self.candidate));
            let gain = (cost - candidate_cost) / trial.unwrap_or(f64::NAN);
            if gain > 0.0 {
                std::mem::swap(&mut self.state, &mut self.candidate);
                report.converged = cost - candidate_cost < options.cost_tolerance * cost;
                cost = candidate_cost;
                report.final_cost = cost;
                if report.converged {
                    break;
                }
                // Nielsen's rule: a good prediction lowers the damping to a third at most.
                let shrink = (1.0 - (2.0 * gain - 1.0).powi(3)).max(1.0 / 3.0);
                damping = (damping * shrink).max(MIN_DAMPING);
                growth = 2.0;
            } else {
                damping *= growth;
                growth *= 2.0;
            }
        }
        Ok(report)
    }

    /// The values and where they go.
    pub(super) fn finish(self) -> (State, Layout) {
        (self.state, self.layout)
    }

    fn cost(&self, state: &State) -> f64 {
        let of_chunk = |chunk: &Range<usize>| {
            simd::chunk_cost(self.level, &self.layout, state, self.loss_scale_inv2, chunk.clone())
        };
        let chunks = &self.layout.chunks;
        let mut costs = [0.0; MAX_CHUNKS];
        let costs = &mut costs[..chunks.len()];
        if chunks.len() == 1 {
            costs[0] = of_chunk(&chunks[0]);
        } else {
            costs.par_iter_mut().zip(chunks).for_each(|(cost, chunk)| *cost = of_chunk(chunk));
        }
        costs.iter().sum::<f64>() + priors_cost(self.problem, self.rotation_sigma, state)
    }

    fn pass(&self, damping: f64) -> Pass<'_> {
        Pass {
            layout: &self.layout,
            state: &self.state,
            free_points: &self.free_points,
            loss_scale_inv2: self.loss_scale_inv2,
            damping,
        }
    }

    /// Normal equations at the state, points eliminated, S in `system`.
    fn linearize(&mut self, damping: f64) {
        let pass = Pass {
            layout: &self.layout,
            state: &self.state,
            free_points: &self.free_points,
            loss_scale_inv2: self.loss_scale_inv2,
            damping,
        };
        let level = self.level;
        let mut tasks: ArrayVec<_, MAX_CHUNKS> = ArrayVec::new();
        let (mut factors, mut terms) = (&mut self.factors[..], &mut self.point_terms[..]);
        for (chunk, sums) in self.layout.chunks.iter().zip(&mut self.chunk_sums) {
            let (of_chunk, rest) = factors.split_at_mut(self.layout.factors_of(chunk).len());
            let (terms_of_chunk, rest_of_terms) = terms.split_at_mut(chunk.len());
            tasks.push((chunk.clone(), of_chunk, terms_of_chunk, sums));
            (factors, terms) = (rest, rest_of_terms);
        }
        type Task<'t> = (Range<usize>, &'t mut [Factor], &'t mut [PointTerms], &'t mut Sums);
        let run = |(chunk, factors, terms, sums): &mut Task<'_>| {
            simd::linearize_chunk(level, &pass, chunk.clone(), factors, terms, sums);
        };
        run_tasks(tasks, run);
        self.sums.clear();
        for chunk in &self.chunk_sums {
            self.sums.add(chunk);
        }
        let priors = (self.problem, self.rotation_sigma);
        add_priors(priors, &self.layout, &self.state, &mut self.sums);
        self.pattern.reduce(
            level,
            &self.layout,
            &self.sums,
            &self.factors,
            damping,
            &self.system.column_starts,
            &mut self.system.values,
        );
    }

    /// Solves and moves into `candidate`. Returns the predicted decrease, `None` if the step is of
    /// no use.
    fn try_step(&mut self, damping: f64) -> Option<f64> {
        let layout = &self.layout;
        for block in 0..layout.num_blocks() {
            let (terms, offset) = (&self.sums.blocks[block], layout.block_offsets[block]);
            for lane in 0..layout.block_dims[block] {
                self.step[offset + lane] = terms.eliminated[lane] - terms.gradient[lane];
            }
        }
        if !self.system.solve_in_place(&mut self.step) {
            return None;
        }
        let mut predicted = 0.0;
        for block in 0..layout.num_blocks() {
            let (terms, offset) = (&self.sums.blocks[block], layout.block_offsets[block]);
            for lane in 0..layout.block_dims[block] {
                let delta = self.step[offset + lane];
                let diagonal = terms.hessian[lane][lane].max(MIN_DIAGONAL);
                predicted += 0.5 * delta * (damping * diagonal * delta - terms.gradient[lane]);
                self.block_steps[block][lane] = delta;
            }
        }
        if !self.candidate.step_cameras(&self.state, &self.step, layout) {
            return None;
        }
        let mut moved = std::mem::take(&mut self.candidate.points);
        predicted += self.step_points(damping, &mut moved);
        self.candidate.points = moved;
        predicted.is_finite().then_some(predicted)
    }

    fn step_points(&self, damping: f64, moved: &mut [[f64; 3]]) -> f64 {
        let (level, pass) = (self.level, self.pass(damping));
        let mut predicted = [0.0; MAX_CHUNKS];
        let mut tasks: ArrayVec<_, MAX_CHUNKS> = ArrayVec::new();
        let mut moved = moved;
        for (chunk, predicted) in self.layout.chunks.iter().zip(&mut predicted) {
            let (of_chunk, rest) = moved.split_at_mut(chunk.len());
            tasks.push((chunk.clone(), of_chunk, predicted));
            moved = rest;
        }
        type Task<'t> = (Range<usize>, &'t mut [[f64; 3]], &'t mut f64);
        let run = |(chunk, moved, predicted): &mut Task<'_>| {
            let factors = &self.factors[self.layout.factors_of(chunk)];
            let (terms, chunk) = (&self.point_terms[chunk.clone()], chunk.clone());
            **predicted =
                simd::step_points(level, &pass, chunk, factors, terms, &self.block_steps, moved);
        };
        run_tasks(tasks, run);
        predicted.iter().sum()
    }
}

/// Runs independent tasks, a single one without waking another thread.
pub(super) fn run_tasks<T: Send, const N: usize>(
    mut tasks: ArrayVec<T, N>,
    run: impl Fn(&mut T) + Sync + Send,
) {
    if tasks.len() == 1 {
        tasks.iter_mut().for_each(run);
    } else {
        tasks.par_iter_mut().for_each(run);
    }
}
