//! Joint refinement of poses, points and intrinsics.

use nalgebra::{Isometry3, Point2, Point3, Unit, Vector3};
use volery_geometry::Camera;
use volery_scene::{Cancelled, Progress};

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
    /// In and out.
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
    /// Poses.
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
pub fn adjust_bundle(
    problem: &mut BundleProblem,
    options: &BundleOptions,
    progress: &dyn Progress,
) -> Result<BundleReport, BundleError> {
    let _ = (problem, options, progress);
    todo!()
}
