//! Joint refinement of poses, points and intrinsics.

mod cost;
mod layout;
mod lens;
mod linearize;
mod minimize;
mod point_chart;
mod priors;
mod residuals;
mod schur;
mod simd;
mod solve;
mod state;
#[cfg(test)]
mod tests;

pub use residuals::squared_residuals;

use nalgebra::{Isometry3, Point2, Point3, Unit, Vector3};
use volery_geometry::{Camera, SimdLevel};
use volery_scene::{Cancelled, Progress};

use minimize::Minimizer;

/// Which intrinsics move.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct IntrinsicsRefinement {
    /// Focal lengths.
    pub focal: bool,
    /// Principal point.
    pub principal_point: bool,
    /// Distortion.
    pub distortion: bool,
}

impl IntrinsicsRefinement {
    /// None moves.
    pub const FIXED: Self = Self { focal: false, principal_point: false, distortion: false };
    /// Focal lengths and distortion move, the principal point stays.
    pub const FOCAL_AND_DISTORTION: Self =
        Self { focal: true, principal_point: false, distortion: true };
}

/// A camera of a problem.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BundleCamera {
    /// Intrinsics, in and out.
    pub camera: Camera,
    /// Which of them move.
    pub refine: IntrinsicsRefinement,
    /// Prior on the focal length: (pixels, sigma pixels).
    pub focal_prior: Option<(f64, f64)>,
}

/// A pose of a problem.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BundlePose {
    /// Camera axes x right, y down, z forward; in and out.
    pub cam_from_world: Isometry3<f64>,
    /// Index of its camera.
    pub camera: u32,
    /// Stays as it is.
    pub constant: bool,
    /// World position of the center with its sigma per axis, world units.
    pub position_prior: Option<(Point3<f64>, f64)>,
    /// Direction of world "up" (+z of the world) in the camera frame with its sigma, radians.
    pub gravity_prior: Option<(Unit<Vector3<f64>>, f64)>,
}

/// One sighting.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BundleObservation {
    /// Index of the pose.
    pub pose: u32,
    /// Index of the point.
    pub point: u32,
    /// Where, pixels.
    pub pixel: Point2<f64>,
}

/// What to refine. Observations need not be sorted.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct BundleProblem {
    /// Intrinsics.
    pub cameras: Vec<BundleCamera>,
    /// Poses, in and out.
    pub poses: Vec<BundlePose>,
    /// Points, in and out.
    pub points: Vec<Point3<f64>>,
    /// Points that stay; empty or as long as `points`.
    pub constant_points: Vec<bool>,
    /// Sightings.
    pub observations: Vec<BundleObservation>,
}

/// Options of [`adjust_bundle`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BundleOptions {
    /// Bound on Levenberg–Marquardt iterations.
    pub max_iterations: usize,
    /// Scale of the Cauchy loss, pixels; `None` is plain least squares.
    pub loss_scale_px: Option<f64>,
    /// Stop when an accepted step lowers the cost by less than this fraction.
    pub cost_tolerance: f64,
}

impl Default for BundleOptions {
    fn default() -> Self {
        Self { max_iterations: 50, loss_scale_px: Some(1.0), cost_tolerance: 1e-6 }
    }
}

/// How a bundle adjustment went.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BundleReport {
    /// Robust cost before: ½ Σ ρ(‖r‖²), pixels².
    pub initial_cost: f64,
    /// Robust cost after.
    pub final_cost: f64,
    /// Steps tried.
    pub num_iterations: usize,
    /// Whether a tolerance ended it rather than the bound.
    pub converged: bool,
}

/// Why a problem was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum BundleError {
    /// An index points past its list.
    #[error("observation {observation} points past the poses, cameras or points")]
    IndexOutOfRange {
        /// Which.
        observation: usize,
    },
    /// A value is not finite.
    #[error("the problem holds a value that is not finite")]
    NotFinite,
    /// A pose names a camera that does not exist.
    #[error("a pose points past the {num_cameras} cameras")]
    NoSuchCamera {
        /// Cameras there are.
        num_cameras: usize,
    },
    /// The reduced system does not fit into memory.
    #[error("the reduced system does not fit into memory")]
    OutOfMemory,
    /// There is nothing to minimize.
    #[error("the problem has no observations")]
    Empty,
    /// Asked to stop; the problem holds the last accepted step.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// Minimizes the robust reprojection error (P31, P32, Eq. (5)) plus priors over all that is not
/// constant, in place, by Levenberg–Marquardt with the Schur complement on the points. The gauge
/// need not be fixed: damping holds it. Deterministic for any number of threads.
///
/// # Errors
///
/// [`BundleError`] for a problem that cannot be minimized, which stays as it was, and when
/// `progress` asks to stop: the problem then holds the last accepted step.
pub fn adjust_bundle(
    problem: &mut BundleProblem,
    options: &BundleOptions,
    progress: &dyn Progress,
) -> Result<BundleReport, BundleError> {
    adjust(problem, options, None, progress)
}

/// [`adjust_bundle`] with rotations that were estimated before: each pose is drawn towards the
/// rotation it comes with, `rotation_sigma` radians.
///
/// # Errors
///
/// As [`adjust_bundle`]; [`BundleError::NotFinite`] also for a sigma that is not positive.
pub fn adjust_bundle_near_rotations(
    problem: &mut BundleProblem,
    options: &BundleOptions,
    rotation_sigma: f64,
    progress: &dyn Progress,
) -> Result<BundleReport, BundleError> {
    if !(rotation_sigma.is_finite() && rotation_sigma > 0.0) {
        return Err(BundleError::NotFinite);
    }
    adjust(problem, options, Some(rotation_sigma), progress)
}

fn adjust(
    problem: &mut BundleProblem,
    options: &BundleOptions,
    rotation_sigma: Option<f64>,
    progress: &dyn Progress,
) -> Result<BundleReport, BundleError> {
    problem.check()?;
    let mut minimizer = Minimizer::new(problem, options, rotation_sigma, SimdLevel::detect())
        .ok_or(BundleError::OutOfMemory)?;
    let result = minimizer.run(options, progress);
    let (state, layout) = minimizer.finish();
    state.store(problem, &layout);
    result
}

impl BundleProblem {
    /// Whether point `index` stays.
    fn is_constant_point(&self, index: u32) -> bool {
        self.constant_points.get(index as usize).copied().unwrap_or(false)
    }

    /// Refuses what cannot be minimized.
    fn check(&self) -> Result<(), BundleError> {
        if self.observations.is_empty() {
            return Err(BundleError::Empty);
        }
        let num_cameras = self.cameras.len();
        for (observation, o) in self.observations.iter().enumerate() {
            let pose = self.poses.get(o.pose as usize);
            if pose.is_none() || o.point as usize >= self.points.len() {
                return Err(BundleError::IndexOutOfRange { observation });
            }
        }
        if self.poses.iter().any(|pose| pose.camera as usize >= num_cameras) {
            return Err(BundleError::NoSuchCamera { num_cameras });
        }
        if self.is_finite() { Ok(()) } else { Err(BundleError::NotFinite) }
    }

    fn is_finite(&self) -> bool {
        let is_sigma = |sigma: f64| sigma.is_finite() && sigma > 0.0;
        self.observations.iter().all(|o| o.pixel.coords.iter().all(|v| v.is_finite()))
            && self.points.iter().all(|p| p.coords.iter().all(|v| v.is_finite()))
            && self.cameras.iter().all(|c| {
                c.camera.params().iter().all(|v| v.is_finite())
                    && c.focal_prior.is_none_or(|(f, sigma)| f.is_finite() && is_sigma(sigma))
            })
            && self.poses.iter().all(|pose| {
                pose.cam_from_world.to_homogeneous().iter().all(|v| v.is_finite())
                    && pose.position_prior.is_none_or(|(center, sigma)| {
                        center.coords.iter().all(|v| v.is_finite()) && is_sigma(sigma)
                    })
                    && pose.gravity_prior.is_none_or(|(up, sigma)| {
                        up.iter().all(|v| v.is_finite()) && is_sigma(sigma)
                    })
            })
    }
}
