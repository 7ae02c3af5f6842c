//! Random samples and their scoring, independent of the model.
//!
//! LO-RANSAC with the MSAC cost: a hypothesis costs `Σ min(r², t²)`, and each new best hypothesis
//! is refined over all its inliers before the search goes on.

pub(crate) mod least_squares;

use arrayvec::ArrayVec;
use volery_geometry::Rng;

/// Most hypotheses of one sample (the five-point solver has ten).
pub const MAX_HYPOTHESES: usize = 10;
/// Largest sample.
pub const MAX_SAMPLE: usize = 8;

/// Lists of hypotheses of one sample.
pub type Hypotheses<M> = ArrayVec<M, MAX_HYPOTHESES>;

/// How well a hypothesis explains the data.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Score {
    /// `Σ min(r², t²)`, squared units of the residual.
    pub cost: f64,
    /// Data with `r < t`; meaningless where scoring was cut short.
    pub num_inliers: usize,
}

/// A model that can be fitted to samples.
pub trait Estimator {
    /// What is estimated.
    type Model: Clone;
    /// Data of a minimal sample, at most [`MAX_SAMPLE`].
    const SAMPLE_SIZE: usize;

    /// Number of data.
    fn num_data(&self) -> usize;

    /// Hypotheses of a minimal sample.
    fn solve(&self, sample: &[usize], hypotheses: &mut Hypotheses<Self::Model>);

    /// Cost over all data. May stop as soon as the cost exceeds `bound`.
    fn score(&self, model: &Self::Model, bound: f64) -> Score;

    /// A better model near `model`, fitted to all its inliers.
    fn refine(&self, model: &Self::Model) -> Option<Self::Model>;
}

/// When to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RansacOptions {
    /// Chance of never having drawn an all-inlier sample.
    pub failure_probability: f64,
    /// Fewest samples.
    pub min_iterations: usize,
    /// Most samples.
    pub max_iterations: usize,
}

/// The best model found.
#[derive(Debug, Clone, PartialEq)]
pub struct RansacResult<M> {
    /// After local optimization.
    pub model: M,
    /// Its score.
    pub score: Score,
    /// Samples drawn.
    pub num_iterations: usize,
}

/// Samples needed so that all of them are spoiled with a chance of at most
/// `failure_probability`, when `inlier_ratio` of the data are good.
pub fn num_samples(failure_probability: f64, inlier_ratio: f64, sample_size: usize) -> usize {
    let good_sample = inlier_ratio.clamp(0.0, 1.0).powi(sample_size as i32);
    if good_sample >= 1.0 {
        return 1;
    }
    let needed = failure_probability.ln() / (-good_sample).ln_1p();
    if needed.is_finite() && needed >= 0.0 { needed.ceil() as usize } else { usize::MAX }
}

/// Searches the model of least MSAC cost.
///
/// * `start`: hypotheses to try before any sample, refined like the others.
/// * Returns `None` if there are fewer data than a sample or no sample gave a model.
pub fn lo_ransac<E: Estimator>(
    estimator: &E,
    start: &[E::Model],
    options: &RansacOptions,
    random: &mut Rng,
) -> Option<RansacResult<E::Model>> {
    let num_data = estimator.num_data();
    if num_data < E::SAMPLE_SIZE {
        return None;
    }
    let mut search = Search { estimator, options, best: None, limit: options.max_iterations };
    for model in start {
        search.consider(model);
    }
    let mut hypotheses = Hypotheses::new();
    let mut sample = [0; MAX_SAMPLE];
    let mut num_iterations = 0;
    while num_iterations < search.limit {
        num_iterations += 1;
        random.distinct(num_data, &mut sample[..E::SAMPLE_SIZE]);
        hypotheses.clear();
        estimator.solve(&sample[..E::SAMPLE_SIZE], &mut hypotheses);
        for model in &hypotheses {
            search.consider(model);
        }
    }
    let (mut model, mut score) = search.best?;
    for _ in 0..MAX_FINAL_REFINEMENTS {
        let Some(refined) = estimator.refine(&model) else { break };
        let refined_score = estimator.score(&refined, score.cost);
        if refined_score.cost >= score.cost * (1.0 - 1e-6) {
            break;
        }
        (model, score) = (refined, refined_score);
    }
    Some(RansacResult { model, score, num_iterations })
}

const MAX_FINAL_REFINEMENTS: usize = 5;

struct Search<'a, E: Estimator> {
    estimator: &'a E,
    options: &'a RansacOptions,
    best: Option<(E::Model, Score)>,
    limit: usize,
}

impl<E: Estimator> Search<'_, E> {
    fn consider(&mut self, model: &E::Model) {
        let bound = self.best.as_ref().map_or(f64::INFINITY, |(_, score)| score.cost);
        let score = self.estimator.score(model, bound);
        if score.cost.is_nan() || score.cost >= bound {
            return;
        }
        let mut best = (model.clone(), score);
        // A sample explains itself; only what lies beyond it is worth a refinement.
        if score.num_inliers > E::SAMPLE_SIZE + 1
            && let Some(refined) = self.estimator.refine(model)
        {
            let refined_score = self.estimator.score(&refined, score.cost);
            if refined_score.cost < score.cost {
                best = (refined, refined_score);
            }
        }
        let inlier_ratio = best.1.num_inliers as f64 / self.estimator.num_data() as f64;
        let needed = num_samples(self.options.failure_probability, inlier_ratio, E::SAMPLE_SIZE);
        self.limit = needed.max(self.options.min_iterations).min(self.options.max_iterations);
        self.best = Some(best);
    }
}
