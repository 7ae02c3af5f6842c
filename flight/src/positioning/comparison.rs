//! Figures of a positioning system on a path whose truth is known.

use nalgebra::Point3;

/// How well a system told where a vehicle was. Meters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Figures {
    /// Places asked for.
    pub num_asked: usize,
    /// Places answered.
    pub num_answered: usize,
    /// Half of the errors are smaller.
    pub median: f64,
    /// Nineteen of twenty errors are smaller.
    pub p95: f64,
    /// The largest error.
    pub max: f64,
    /// Root of the mean squared error in the plane.
    pub rmse_horizontal: f64,
    /// Root of the mean squared error of the height.
    pub rmse_height: f64,
}

/// Errors of `estimates` against `truth`, place by place; `None` where there was no answer.
///
/// Returns `None` if nothing was answered.
pub fn compare(truth: &[Point3<f64>], estimates: &[Option<Point3<f64>>]) -> Option<Figures> {
    let pairs = truth.iter().zip(estimates);
    let errors: Vec<_> = pairs.filter_map(|(t, e)| e.map(|e| e - t)).collect();
    let mut lengths: Vec<f64> = errors.iter().map(|error| error.norm()).collect();
    lengths.sort_by(f64::total_cmp);
    let n = lengths.len();
    let quantile = |q: f64| lengths[((n as f64 * q).ceil() as usize).clamp(1, n) - 1];
    let mean = |squared: f64| (squared / n as f64).sqrt();
    (n > 0).then(|| Figures {
        num_asked: truth.len(),
        num_answered: n,
        median: quantile(0.5),
        p95: quantile(0.95),
        max: lengths[n - 1],
        rmse_horizontal: mean(errors.iter().map(|e| e.xy().norm_squared()).sum()),
        rmse_height: mean(errors.iter().map(|e| e.z * e.z).sum()),
    })
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    #[test]
    fn figures_of_known_errors() {
        let truth = vec![Point3::new(1.0, 2.0, 3.0); 21];
        let mut estimates: Vec<_> =
            (1..=20).map(|k| Some(truth[0] + Vector3::new(0.0, 0.0, f64::from(k) * 0.1))).collect();
        estimates.push(None);
        let figures = compare(&truth, &estimates).unwrap();
        assert_eq!((figures.num_asked, figures.num_answered), (21, 20));
        let close = |a: f64, b: f64| (a - b).abs() < 1e-9;
        assert!(close(figures.median, 1.0) && close(figures.p95, 1.9) && close(figures.max, 2.0));
        assert!(close(figures.rmse_horizontal, 0.0));
        // Σ k² = 2870 for k = 1..=20.
        assert!(close(figures.rmse_height, (28.70f64 / 20.0).sqrt()));
        assert_eq!(compare(&truth, &[None]), None);
    }
}
