//! Levenberg–Marquardt for models of a few parameters.

use nalgebra::{Cholesky, SMatrix, SVector};

/// A robust cost with its quadratic approximation at a model.
pub(crate) struct Normal<const N: usize> {
    /// ½ Σ ρ(r²).
    pub(crate) cost: f64,
    /// Σ w Jᵀ J.
    pub(crate) hessian: SMatrix<f64, N, N>,
    /// Σ w Jᵀ r.
    pub(crate) gradient: SVector<f64, N>,
}

impl<const N: usize> Normal<N> {
    pub(crate) fn zero() -> Self {
        Self { cost: 0.0, hessian: SMatrix::zeros(), gradient: SVector::zeros() }
    }

    /// Adds one scalar residual; only the lower triangle is filled, see [`Self::finish`].
    #[inline]
    pub(crate) fn add(&mut self, residual: f64, jacobian: &[f64; N], weight: f64) {
        for i in 0..N {
            let wj = weight * jacobian[i];
            self.gradient[i] += wj * residual;
            for (j, d) in jacobian.iter().enumerate().take(i + 1) {
                self.hessian[(i, j)] += wj * d;
            }
        }
    }

    /// Mirrors the lower triangle.
    pub(crate) fn finish(mut self) -> Self {
        for i in 0..N {
            for j in 0..i {
                self.hessian[(j, i)] = self.hessian[(i, j)];
            }
        }
        self
    }
}

/// What a residual costs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Loss {
    /// `min(r², t²)`.
    Truncated {
        /// t².
        squared_threshold: f64,
    },
    /// `s² ln(1 + r²/s²)`, cut off at a threshold t.
    Cauchy {
        /// s².
        squared_scale: f64,
        /// t².
        squared_threshold: f64,
    },
}

impl Loss {
    /// ρ and its derivative, the weight, of a squared residual.
    #[inline]
    pub(crate) fn evaluate(&self, squared: f64) -> (f64, f64) {
        match *self {
            Self::Truncated { squared_threshold } => {
                if squared < squared_threshold {
                    (squared, 1.0)
                } else {
                    (squared_threshold, 0.0)
                }
            }
            Self::Cauchy { squared_scale, squared_threshold } => {
                if squared < squared_threshold {
                    let ratio = squared / squared_scale;
                    (squared_scale * (1.0 + ratio).ln(), 1.0 / (1.0 + ratio))
                } else {
                    (squared_scale * (squared_threshold / squared_scale).ln_1p(), 0.0)
                }
            }
        }
    }
}

/// Steps until the cost falls by less than `tolerance` of itself, at most `max_iterations`.
pub(crate) fn levenberg_marquardt<const N: usize, M: Clone>(
    start: M,
    max_iterations: usize,
    tolerance: f64,
    linearize: impl Fn(&M) -> Normal<N>,
    apply: impl Fn(&M, &SVector<f64, N>) -> M,
) -> M {
    let mut model = start;
    let mut normal = linearize(&model);
    let mut damping = 1e-6;
    for _ in 0..max_iterations {
        let mut damped = normal.hessian;
        let floor = 1e-12 * normal.hessian.diagonal().max();
        for i in 0..N {
            damped[(i, i)] += damping * damped[(i, i)] + floor;
        }
        let Some(cholesky) = Cholesky::new(damped) else {
            damping *= 100.0;
            if damping > 1e6 {
                break;
            }
            continue;
        };
        let candidate = apply(&model, &-cholesky.solve(&normal.gradient));
        let candidate_normal = linearize(&candidate);
        if candidate_normal.cost < normal.cost {
            let gain = normal.cost - candidate_normal.cost;
            let done = gain <= tolerance * normal.cost;
            (model, normal) = (candidate, candidate_normal);
            damping = (damping * 0.1).max(1e-12);
            if done {
                break;
            }
        } else {
            damping *= 10.0;
            if damping > 1e6 || !candidate_normal.cost.is_finite() {
                break;
            }
        }
    }
    model
}
