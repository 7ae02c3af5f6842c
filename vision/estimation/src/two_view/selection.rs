//! Which model explains a pair: does the depth that E allows buy anything?
//!
//! E leaves a point one free coordinate along its epipolar line, H and R leave none. Over the
//! points that E explains, the squared residuals of H (or R) exceed those of E by what the free
//! coordinate absorbs: as much as E's own residuals when it only absorbs noise, more when there
//! is parallax. This is the term GRIC and BIC weigh, with the noise taken from the pair itself
//! instead of from a table (Torr, "An Assessment of Information Criteria for Motion Model
//! Selection", CVPR 1997).

/// How far a simpler model may be off beyond noise.
#[derive(Debug, Clone, Copy)]
pub(super) struct Slack {
    /// Smallest ratio of absorbed to remaining variance that counts as parallax.
    min_excess: f64,
    /// Standard deviations beyond which a point is off the model.
    off_sigmas: f64,
}

impl Slack {
    /// A root mean square of 0.84 of the noise, or points beyond the threshold: lens and shutter
    /// errors of a turning camera come to less.
    pub(super) const ROTATION: Self = Self { min_excess: 1.7, off_sigmas: f64::INFINITY };
    /// The eight parameters of H take up most of the lens errors.
    pub(super) const HOMOGRAPHY: Self = Self { min_excess: 1.3, off_sigmas: 4.0 };
}

/// Standard deviations of the ratio under noise alone that it must exceed.
const EXCESS_SIGMAS: f64 = 3.5;
/// Points off the simpler model that no coincidence explains: at least so many,
const MIN_EXTRA: f64 = 6.0;
/// at least this share of the points on it,
const MIN_EXTRA_SHARE: f64 = 0.05;
/// and so many times what wrong matches give by chance.
const CHANCE_FACTOR: f64 = 2.0;
/// Points this many standard deviations off their epipolar line say nothing about depth.
const TIGHT_SIGMAS: f64 = 2.5;

/// What is known of the inliers of E.
#[derive(Debug, Clone, Copy)]
pub(super) struct Noise {
    /// Standard deviation of their Sampson errors, pixels; not zero.
    pub(super) sigma: f64,
    /// An error beyond it does not fit, pixels².
    pub(super) squared_threshold: f64,
    /// Wrong matches expected among them.
    pub(super) num_by_chance: f64,
}

/// Whether the simpler model explains the inliers of E as well as noise allows.
///
/// * `epipolar`, `simpler`: squared errors of the inliers of E, pixels².
pub(super) fn is_explained(
    epipolar: &[f64],
    simpler: &[f64],
    noise: &Noise,
    slack: &Slack,
) -> bool {
    let off = (slack.off_sigmas * noise.sigma).powi(2).min(noise.squared_threshold);
    let tight = (TIGHT_SIGMAS * noise.sigma).powi(2).min(noise.squared_threshold);
    let (mut num_on, mut num_off, mut sum_epipolar, mut sum_simpler) = (0.0, 0.0, 0.0, 0.0);
    for (&e, &s) in epipolar.iter().zip(simpler) {
        if s < off {
            num_on += 1.0;
            sum_epipolar += e;
            sum_simpler += s;
        } else if e < tight {
            num_off += 1.0;
        }
    }
    // Wrong matches lie evenly about the lines.
    let chance = noise.num_by_chance * (tight / noise.squared_threshold).sqrt();
    let num_extra = num_off - CHANCE_FACTOR * chance;
    if num_on < 4.0 || num_extra > MIN_EXTRA.max(MIN_EXTRA_SHARE * num_on) {
        return false;
    }
    let remaining = sum_epipolar.max(noise.sigma * noise.sigma * num_on);
    let excess = (sum_simpler - sum_epipolar) / remaining;
    // A ratio of two χ² with n degrees of freedom each has variance near 4/n.
    excess < slack.min_excess.max(1.0 + EXCESS_SIGMAS * (4.0 / num_on).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(num_by_chance: f64) -> Noise {
        Noise { sigma: 0.7, squared_threshold: 16.0, num_by_chance }
    }

    #[test]
    fn noise_is_explained_and_parallax_is_not() {
        let epipolar: Vec<f64> = (0..100).map(|i| 0.5 * f64::from(i % 5) / 2.0).collect();
        let twice: Vec<f64> = epipolar.iter().map(|e| 2.0 * e).collect();
        assert!(is_explained(&epipolar, &twice, &noise(0.0), &Slack::ROTATION));
        let parallax: Vec<f64> = epipolar.iter().map(|e| e + 2.0).collect();
        assert!(!is_explained(&epipolar, &parallax, &noise(0.0), &Slack::ROTATION));
    }

    #[test]
    fn a_near_object_breaks_the_rotation_unless_chance_explains_it() {
        let epipolar = vec![0.5; 120];
        let near: Vec<f64> = (0..120).map(|i| if i < 100 { 1.0 } else { 400.0 }).collect();
        assert!(!is_explained(&epipolar, &near, &noise(0.0), &Slack::ROTATION));
        assert!(is_explained(&epipolar, &near, &noise(16.0), &Slack::ROTATION));
    }
}
