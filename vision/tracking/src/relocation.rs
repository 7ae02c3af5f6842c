//! When a pose found out of nowhere is believed: when three agree.

use std::time::Duration;

use nalgebra::{Isometry3, Matrix6};
use volery_localization::PoseEstimate;

use crate::motion::MotionLimits;

/// Fixes of different frames that must agree.
const NUM_AGREEING: usize = 3;
/// A fix is forgotten after this time.
const MEMORY: Duration = Duration::from_millis(1500);
/// Deviations by which two fixes may differ on top of what a drone can fly.
const DEVIATIONS: f64 = 5.0;

/// A pose found without regard to those before.
#[derive(Debug, Clone)]
struct Fix {
    time: Duration,
    map_from_camera: Isometry3<f64>,
    covariance: Matrix6<f64>,
}

/// Fixes that wait for others.
#[derive(Debug, Clone, Default)]
pub(crate) struct Candidates(Vec<Fix>);

impl Candidates {
    /// Takes a fix; tells whether so many agree with it that it is to be believed. Fixes that
    /// disagree with it are forgotten.
    pub(crate) fn add(
        &mut self,
        time: Duration,
        estimate: &PoseEstimate,
        limits: &MotionLimits,
    ) -> bool {
        let PoseEstimate { map_from_camera, covariance, .. } = estimate;
        let new = Fix { time, map_from_camera: *map_from_camera, covariance: *covariance };
        self.0.retain(|old| time.saturating_sub(old.time) <= MEMORY && agree(old, &new, limits));
        self.0.push(new);
        self.0.len() >= NUM_AGREEING
    }

    pub(crate) fn clear(&mut self) {
        self.0.clear();
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

/// Whether a drone can have flown from one fix to the other.
fn agree(a: &Fix, b: &Fix, limits: &MotionLimits) -> bool {
    let seconds = b.time.abs_diff(a.time).as_secs_f64();
    let covariance = a.covariance + b.covariance;
    let deviation = |first: usize| {
        let trace: f64 = (first..first + 3).map(|k| covariance[(k, k)]).sum();
        trace.max(0.0).sqrt()
    };
    let shift =
        (b.map_from_camera.translation.vector - a.map_from_camera.translation.vector).norm();
    let turn = b.map_from_camera.rotation.angle_to(&a.map_from_camera.rotation);
    // False for NaN.
    shift < limits.max_speed * seconds + DEVIATIONS * deviation(0)
        && turn < limits.max_turn_rate * seconds + DEVIATIONS * deviation(3)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn add(candidates: &mut Candidates, millis: u64, x: f64) -> bool {
        let estimate = PoseEstimate {
            map_from_camera: Isometry3::translation(x, 0.0, 0.0),
            covariance: Matrix6::identity() * 1e-4,
            num_inliers: 50,
            num_correspondences: 50,
            reprojection_px: 0.5,
            sightings: Vec::new(),
        };
        let limits = MotionLimits { max_speed: 5.0, ..MotionLimits::default() };
        candidates.add(Duration::from_millis(millis), &estimate, &limits)
    }

    #[test]
    fn three_that_agree_are_believed() {
        let mut candidates = Candidates::default();
        assert!(!add(&mut candidates, 0, 3.0));
        assert!(!add(&mut candidates, 100, 3.1));
        assert!(add(&mut candidates, 200, 3.2));
    }

    #[test]
    fn what_no_drone_can_fly_starts_anew() {
        let mut candidates = Candidates::default();
        add(&mut candidates, 0, 3.0);
        add(&mut candidates, 100, 3.1);
        assert!(!add(&mut candidates, 200, 5.0));
        assert!(!add(&mut candidates, 300, 3.2));
        assert!(!add(&mut candidates, 400, f64::NAN));
        assert!(!add(&mut candidates, 500, 3.1));
        assert!(!add(&mut candidates, 600, 3.1));
        assert!(add(&mut candidates, 700, 3.1));
    }

    #[test]
    fn old_ones_do_not_count() {
        let mut candidates = Candidates::default();
        add(&mut candidates, 0, 3.0);
        add(&mut candidates, 1000, 3.0);
        assert!(!add(&mut candidates, 2000, 3.0));
        assert!(add(&mut candidates, 2100, 3.0));
    }
}
