//! The part of a pose's error that it takes over from the map: neighboring points err together,
//! because the poses that they were triangulated from do, and no residual of the query tells.

use std::collections::BTreeMap;

use nalgebra::{Matrix6, Vector6};
use volery_geometry::{Camera, linearize};

use crate::LocalizationIndex;
use crate::refine::{Sight, WeightedPose};

/// Covariance of the left perturbation of a pose by the errors δ of the map's poses. Points follow
/// them, `δₚ = −Hₚ⁻¹ Σ BᵀA δ` (A, B: derivatives of a sighting by pose and point), and the pose
/// follows the points, `ξ = −N⁻¹ Σ JᵀS⁻¹D δₚ` (J, D: those of the query), so that
///
/// ```text
/// ξ = Σ_c M_c δ_c,     Cov ξ = Σ_ab Mₐ Σ_ab M_bᵀ
/// ```
pub(crate) fn map_share(
    index: &LocalizationIndex,
    sights: &[Sight],
    camera: &Camera,
    pose: &WeightedPose,
) -> Matrix6<f64> {
    let followed = following(index, sights, camera, pose);
    let mut modes: Vec<Vector6<f64>> = Vec::new();
    for (&image, m) in &followed {
        let noise = &index.images[image as usize].noise;
        modes.resize(noise.0.len(), Vector6::zeros());
        for (sum, mode) in modes.iter_mut().zip(&noise.0) {
            *sum += m * mode.map(f64::from);
        }
    }
    modes.iter().map(|mode| mode * mode.transpose()).sum()
}

/// M per image.
fn following(
    index: &LocalizationIndex,
    sights: &[Sight],
    camera: &Camera,
    pose: &WeightedPose,
) -> BTreeMap<u32, Matrix6<f64>> {
    let mut followed: BTreeMap<u32, Matrix6<f64>> = BTreeMap::new();
    for sight in sights {
        let point = &index.points[sight.point_index as usize];
        let Some(seen) = linearize(camera, &pose.cam_from_world, &point.position) else { continue };
        let Some(s) = sight.noise(&seen.by_point, pose.squared_sigma).try_inverse() else {
            continue;
        };
        let unit = point.covariance.map(f64::from) / (index.sigma_px * index.sigma_px);
        let gain = pose.inverse_information * seen.by_pose.tr_mul(&s) * seen.by_point * unit;
        for sighting in index.sightings(sight.point_index) {
            let image = &index.images[sighting.image as usize];
            let map_camera = &index.cameras[image.camera as usize];
            let Some(at) = linearize(map_camera, &image.cam_from_world, &point.position) else {
                continue;
            };
            *followed.entry(sighting.image).or_default() += gain * at.by_point.tr_mul(&at.by_pose);
        }
    }
    followed
}
