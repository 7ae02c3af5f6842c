//! How much a residual counts.

/// A robust loss. Its scale is that of the residuals at hand: `1.4826` times their median.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Kernel {
    /// Least squares.
    Squared,
    /// Absolute beyond 1.345 sigma.
    Huber,
    /// Bounded influence, 2.385 sigma.
    #[default]
    Cauchy,
    /// None beyond 4.685 sigma.
    Tukey,
}

/// Tunings of 95 % efficiency under normal noise: Holland and Welsch, "Robust Regression Using
/// Iteratively Reweighted Least-Squares", 1977.
const HUBER: f64 = 1.345;
const CAUCHY: f64 = 2.385;
const TUKEY: f64 = 4.685;

impl Kernel {
    /// Weight `ρ'(r) / r` of a residual in sigmas.
    pub fn weight(self, residual: f64) -> f64 {
        let r = residual.abs();
        match self {
            Self::Squared => 1.0,
            Self::Huber => (HUBER / r).min(1.0),
            Self::Cauchy => 1.0 / (1.0 + (r / CAUCHY).powi(2)),
            Self::Tukey if r < TUKEY => (1.0 - (r / TUKEY).powi(2)).powi(2),
            Self::Tukey => 0.0,
        }
    }

    /// Loss `ρ(r)` of a residual in sigmas, `r²/2` near zero.
    pub fn loss(self, residual: f64) -> f64 {
        let r = residual.abs();
        match self {
            Self::Huber if r > HUBER => HUBER * (r - HUBER / 2.0),
            Self::Squared | Self::Huber => r * r / 2.0,
            Self::Cauchy => CAUCHY * CAUCHY / 2.0 * (r / CAUCHY).powi(2).ln_1p(),
            Self::Tukey => {
                let inside = 1.0 - (r / TUKEY).powi(2).min(1.0);
                TUKEY * TUKEY / 6.0 * (1.0 - inside.powi(3))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `ρ(r) = ∫ w(r) r dr`: dies if a weight and its loss are not of one kernel.
    #[test]
    fn losses_are_the_integrals_of_their_weights() {
        for kernel in [Kernel::Squared, Kernel::Huber, Kernel::Cauchy, Kernel::Tukey] {
            assert_eq!((kernel.weight(0.0), kernel.loss(0.0)), (1.0, 0.0));
            for k in 1..80 {
                let r = 0.1 * f64::from(k);
                let slope = (kernel.loss(r + 1e-5) - kernel.loss(r - 1e-5)) / 2e-5;
                assert!((slope - kernel.weight(r) * r).abs() < 1e-8, "{kernel:?} at {r}");
                assert_eq!(kernel.weight(-r), kernel.weight(r));
            }
        }
    }
}
