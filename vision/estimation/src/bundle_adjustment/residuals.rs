//! Reprojection errors of a problem, for filtering.

use super::BundleProblem;

/// Squared reprojection error of each observation in the order of the problem, pixels²; infinite
/// for a point that does not lie in front of its camera, or an index out of range.
pub fn squared_residuals(problem: &BundleProblem) -> Vec<f64> {
    let squared = |observation: &super::BundleObservation| {
        let pose = problem.poses.get(observation.pose as usize)?;
        let camera = problem.cameras.get(pose.camera as usize)?;
        let point = problem.points.get(observation.point as usize)?;
        let pixel = camera.camera.project(&(pose.cam_from_world * point))?;
        Some((pixel - observation.pixel).norm_squared()).filter(|squared| squared.is_finite())
    };
    problem.observations.iter().map(|o| squared(o).unwrap_or(f64::INFINITY)).collect()
}
