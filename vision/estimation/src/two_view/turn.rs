//! Whether a camera of unknown focal length only turned.

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use super::correspondences::{Correspondences, homography_error};
use super::verification::Verification;
use crate::solvers::rotation_from_bearings;

/// Fields of view of the longer side that cameras for mapping have, degrees. Through a narrower lens
/// a turn looks like a wall passed by.
const FOV_RANGE_DEG: (f64, f64) = (35.0, 120.0);
/// Focal lengths tried, evenly spaced in the logarithm.
const NUM_STEPS: usize = 24;
/// Halvings of the best interval.
const NUM_HALVINGS: usize = 8;

/// A turn under a focal length.
#[derive(Debug, Clone, Copy)]
pub(super) struct Turn {
    pub(super) rotation: UnitQuaternion<f64>,
    /// `K R K⁻¹` over scaled coordinates.
    pub(super) homography: Matrix3<f64>,
}

impl Verification<'_> {
    /// The turn that explains `support` best, under whatever focal length that takes. Both focal
    /// lengths change by the same factor.
    ///
    /// A plane under a moving camera is no turn under any of them: `K⁻¹ H K` is a rotation for
    /// the focal length of a camera that turned and for no other matrix H.
    ///
    /// Source: Hartley, "Self-Calibration from Multiple Views with a Rotating Camera", ECCV 1994.
    pub(super) fn best_turn(&self, support: &Correspondences) -> Option<Turn> {
        let camera = self.camera1;
        let half = f64::from(camera.width.max(camera.height)) / 2.0;
        let focal_of = |degrees: f64| half / (degrees.to_radians() / 2.0).tan();
        // Logarithm of the focal length in units of the one that scaled the coordinates.
        let log_factor = |degrees: f64| (focal_of(degrees) / support.focal1).ln();
        let (least, greatest) = (log_factor(FOV_RANGE_DEG.1), log_factor(FOV_RANGE_DEG.0));
        let turn = |log: f64| turn_under(support, log.exp());
        let cost = |log: f64| turn(log).map_or(f64::INFINITY, |turn| cost(support, &turn));
        let mut step = (greatest - least) / (NUM_STEPS - 1) as f64;
        let (mut lowest, mut best) = (0..NUM_STEPS)
            .map(|i| least + step * i as f64)
            .map(|log| (cost(log), log))
            .min_by(|a, b| a.0.total_cmp(&b.0))?;
        for _ in 0..NUM_HALVINGS {
            step *= 0.5;
            for log in [best - step, best + step] {
                let cost = cost(log);
                if cost < lowest {
                    (lowest, best) = (cost, log);
                }
            }
        }
        turn(best)
    }
}

/// Least-squares turn with both focal lengths `factor` times what scaled the coordinates.
fn turn_under(support: &Correspondences, factor: f64) -> Option<Turn> {
    let (focal1, focal2) = (factor * support.focal1, factor * support.focal2);
    let ray = |x: &Vector3<f64>, focal: f64| Vector3::new(x.x, x.y, focal).normalize();
    let rays = support.pairs.iter().map(|p| (ray(&p.x1, focal1), ray(&p.x2, focal2), 1.0));
    let rotation = rotation_from_bearings(rays)?;
    let k = |focal: f64| Matrix3::from_diagonal(&Vector3::new(focal, focal, 1.0));
    let homography = k(focal2) * rotation.to_rotation_matrix().matrix() * k(1.0 / focal1);
    Some(Turn { rotation, homography })
}

fn cost(support: &Correspondences, turn: &Turn) -> f64 {
    let error = |p| homography_error(&turn.homography, p).min(support.squared_threshold);
    support.pairs.iter().map(error).sum()
}
