//! Where a vehicle's estimator is beside the poses that it is sent.

use nalgebra::{Matrix3, Matrix4, Matrix4x3, Vector3, Vector4};

/// How quickly an estimator without poses strays, by the sensors that feel its motion: standard
/// deviation, meters per second.
const STRAY: f64 = 0.03;
/// The same of one that gets its poses late, per second that they are.
const WANDER: f64 = 0.2;
/// Standard deviation of what clocks and autopilots do not know of the delay of poses: seconds, and
/// part of the delay.
const DELAY_SD: (f64, f64) = (0.02, 0.5);
/// How quickly that changes, seconds per second.
const DELAY_STRAY: f64 = 0.01;
/// An estimator that says it is slower may stand, meters per second: what it says then is noise, and
/// the same noise as that of its place, which taught a delay below zero.
const STANDING: f64 = 0.4;
/// Acceleration that a motion told earlier does not show: standard deviation, meters per second
/// squared.
const ACCELERATION: f64 = 1.5;
/// Standard deviation of the offset before anything is known, meters.
const OFFSET_SD: f64 = 0.5;
/// Longest time for which an estimator is let stray, seconds: a vehicle that has been without poses
/// for long lands, and must not follow a wrong place then.
const MAX_GAP: f64 = 2.0;

/// A pose beside what the estimator said at its time.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sighting {
    /// Pose less estimate, meters.
    pub(super) offset: Vector3<f64>,
    /// Of the estimate, meters per second.
    pub(super) velocity: Vector3<f64>,
    /// Standard deviation of each coordinate of the pose, meters.
    pub(super) sd: f64,
    /// From the image until the vehicle has the pose, seconds.
    pub(super) delay: f64,
    /// From what the estimator said until the image, seconds.
    pub(super) ahead: f64,
}

impl Sighting {
    /// The velocity, where there is one, meters per second.
    fn motion(&self) -> Vector3<f64> {
        if self.velocity.norm() < STANDING { Vector3::zeros() } else { self.velocity }
    }
}

/// A filter of the offset `b` of an estimator and of the delay `d` that it does not know of:
///
/// ```text
/// pose − estimate = b + d v + ε
/// ```
///
/// An autopilot is told one constant delay of its poses. What that leaves out of the true one makes
/// its estimate lag behind a motion with velocity `v` by `d v`; so does an error between the clocks.
/// Both are the same in all poses, while a place that is mistaken for another is not.
#[derive(Debug, Clone, Copy)]
pub(super) struct Beside {
    /// `b`, `d`.
    state: Vector4<f64>,
    covariance: Matrix4<f64>,
}

impl Beside {
    /// After a first pose.
    pub(super) fn new(seen: &Sighting) -> Self {
        let b = OFFSET_SD.powi(2);
        let d = (DELAY_SD.0 + DELAY_SD.1 * seen.delay).powi(2);
        let covariance = Matrix4::from_diagonal(&Vector4::new(b, b, b, d));
        Self { state: Vector4::zeros(), covariance }.with(seen)
    }

    /// `gap` seconds later.
    pub(super) fn after(self, gap: f64) -> Self {
        let [b, d] = [STRAY, DELAY_STRAY].map(|rate| (rate * gap.min(MAX_GAP)).powi(2));
        let grown = Matrix4::from_diagonal(&Vector4::new(b, b, b, d));
        Self { covariance: self.covariance + grown, ..self }
    }

    /// How far a pose is from where it is expected: meters, and standard deviations.
    pub(super) fn distance(&self, seen: &Sighting) -> (f64, f64) {
        let (innovation, covariance, _) = self.innovation(seen);
        let squared = covariance.cholesky().map(|s| innovation.dot(&s.solve(&innovation)));
        (innovation.norm(), squared.map_or(f64::INFINITY, f64::sqrt))
    }

    /// With one more pose.
    pub(super) fn with(self, seen: &Sighting) -> Self {
        let (innovation, covariance, cross) = self.innovation(seen);
        let Some(inverse) = covariance.try_inverse() else { return self };
        let gain = cross * inverse;
        Self {
            state: self.state + gain * innovation,
            covariance: self.covariance - gain * cross.transpose(),
        }
    }

    /// `z − H x`, `H P Hᵀ + R`, `P Hᵀ` with `H = (I, v)`.
    fn innovation(&self, seen: &Sighting) -> (Vector3<f64>, Matrix3<f64>, Matrix4x3<f64>) {
        let mut h = Matrix4x3::identity();
        h.set_row(3, &seen.motion().transpose());
        let cross = self.covariance * h;
        let unseen = 0.5 * ACCELERATION * seen.ahead.powi(2);
        let variance = seen.sd.powi(2) + (WANDER * seen.delay).powi(2) + unseen.powi(2);
        let covariance = h.transpose() * cross + Matrix3::identity() * variance;
        (seen.offset - h.transpose() * self.state, covariance, cross)
    }
}

#[cfg(test)]
mod tests {
    use volery_geometry::Rng;

    use super::*;

    /// A vehicle that flies to and fro for `seconds`, with an estimator that is `b` beside its poses
    /// and does not know of `d` seconds.
    fn flown(rng: &mut Rng, b: &Vector3<f64>, d: f64, seconds: u32) -> (Beside, Vector3<f64>) {
        let mut beside: Option<Beside> = None;
        let mut velocity = Vector3::zeros();
        for frame in 0..20 * seconds {
            let time = 0.05 * f64::from(frame);
            velocity = Vector3::new(time.sin(), 0.3 * (1.3 * time).cos(), 0.2 * (0.7 * time).sin());
            let offset = b + velocity * d + rng.normal3() * 0.02;
            let seen = Sighting { offset, velocity, sd: 0.02, delay: 0.2, ahead: 0.0 };
            let known = beside.map(|beside| beside.after(0.05).with(&seen));
            beside = Some(known.unwrap_or_else(|| Beside::new(&seen)));
        }
        (beside.unwrap(), velocity)
    }

    /// Dies if `v` is left out of `H`: offset and delay are told from each other by the motion.
    #[test]
    fn offset_and_delay_are_found() {
        let mut rng = Rng::new(1);
        for _ in 0..20 {
            let (b, d) = (rng.normal3() * 0.1, rng.range(-0.05, 0.25));
            let (beside, _) = flown(&mut rng, &b, d, 20);
            assert!((beside.state.fixed_rows::<3>(0) - b).norm() < 0.03, "{b} {beside:?}");
            assert!((beside.state[3] - d).abs() < 0.03, "{d} {beside:?}");
        }
    }

    /// Once the delay is known, a stop changes the offset by it, and nothing else is forgiven.
    #[test]
    fn a_stop_is_foreseen_and_a_step_is_not() {
        let mut rng = Rng::new(2);
        let (b, d) = (Vector3::new(0.1, 0.0, -0.1), 0.18);
        let (beside, _) = flown(&mut rng, &b, d, 20);
        let stands =
            Sighting { offset: b, velocity: Vector3::zeros(), sd: 0.02, delay: 0.2, ahead: 0.0 };
        assert!(beside.after(0.05).distance(&stands).1 < 2.0);
        let steps = Sighting { offset: b + Vector3::new(0.0, 0.3, 0.0), ..stands };
        let (distance, sigmas) = beside.after(0.05).distance(&steps);
        assert!(sigmas > 5.0 && (distance - 0.3).abs() < 0.05, "{distance} {sigmas}");
    }

    /// An estimator whose place and velocity err together, as those of a filter of few poses do, says
    /// nothing of its delay while it stands: when it starts, what it lags behind is not a jump. Dies
    /// if noise is taken for motion.
    #[test]
    fn standing_teaches_no_delay() {
        let mut rng = Rng::new(4);
        let mut beside: Option<Beside> = None;
        for _ in 0..500 {
            let error = rng.normal3() * 0.05;
            let offset = rng.normal3() * 0.02 - error * 0.4;
            let seen = Sighting { offset, velocity: error, sd: 0.02, delay: 0.12, ahead: 0.0 };
            let known = beside.map(|beside| beside.after(0.02).with(&seen));
            beside = Some(known.unwrap_or_else(|| Beside::new(&seen)));
        }
        let velocity = Vector3::z() * 0.8;
        let starts =
            Sighting { offset: velocity * 0.15, velocity, sd: 0.02, delay: 0.12, ahead: 0.0 };
        assert!(beside.unwrap().after(0.02).distance(&starts).1 < 3.0);
    }

    /// A start that the estimator told of too early to show it is not a jump. Dies if the age of its
    /// motion does not count.
    #[test]
    fn an_old_motion_proves_less() {
        let (beside, _) = flown(&mut Rng::new(5), &Vector3::zeros(), 0.1, 20);
        // At 2 m/s² for 0.35 s.
        let offset = Vector3::x() * 0.12;
        let velocity = Vector3::zeros();
        let starts = |ahead| Sighting { offset, velocity, sd: 0.02, delay: 0.05, ahead };
        assert!(beside.distance(&starts(0.35)).1 < 2.5 && beside.distance(&starts(0.05)).1 > 4.0);
    }

    /// Without poses an estimator strays, but not for ever.
    #[test]
    fn a_gap_forgives_more_and_no_more() {
        let (beside, velocity) = flown(&mut Rng::new(3), &Vector3::zeros(), 0.0, 5);
        let seen =
            Sighting { offset: Vector3::x() * 0.3, velocity, sd: 0.02, delay: 0.05, ahead: 0.0 };
        let sigmas = |gap: f64| beside.after(gap).distance(&seen).1;
        assert!(sigmas(0.05) > sigmas(1.0) && sigmas(1.0) > sigmas(2.0));
        assert_eq!(sigmas(2.0), sigmas(60.0));
    }
}
