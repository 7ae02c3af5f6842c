//! Whether the cameras moved far enough for depth to be more than noise.

use nalgebra::{Point3, Vector3};
use volery_geometry::median;
use volery_geometry::triangulation::camera_center;

use crate::incremental::WorkingModel;

/// Parallax of the median point in multiples of the noise of a sighting, below which the depths
/// are noise.
const MIN_PARALLAX_TO_NOISE: f64 = 4.0;
/// Least noise of a sighting, pixels.
const MIN_NOISE_PX: f64 = 0.1;

/// Whether the points of a model are seen under angles well above the noise.
pub(super) fn has_parallax(model: &WorkingModel<'_>) -> bool {
    parallax_to_noise(model).is_some_and(|ratio| ratio >= MIN_PARALLAX_TO_NOISE)
}

/// Median over the points of the spread of their rays, divided by the noise of the sightings.
pub(super) fn parallax_to_noise(model: &WorkingModel<'_>) -> Option<f64> {
    let centers: Vec<Option<Point3<f64>>> =
        model.poses.iter().map(|pose| pose.as_ref().map(camera_center)).collect();
    let (mut spreads, mut errors) = (Vec::new(), Vec::new());
    for track in &model.tracks {
        let Some(point) = track.position else { continue };
        let seen: Vec<_> = track.sightings.iter().filter(|s| s.active).collect();
        let rays: Vec<Vector3<f64>> = seen
            .iter()
            .filter_map(|s| Some((point - centers[s.image as usize]?).normalize()))
            .collect();
        if rays.len() < 3 {
            continue;
        }
        let mean = rays.iter().sum::<Vector3<f64>>() / rays.len() as f64;
        let variance =
            rays.iter().map(|ray| (ray - mean).norm_squared()).sum::<f64>() / rays.len() as f64;
        let focal = model.camera(seen[0].image as usize).mean_focal();
        spreads.push(focal * variance.sqrt());
        errors.extend(seen.iter().map(|s| model.reprojection_error(s, &point)));
    }
    let noise = median(&mut errors)?.max(MIN_NOISE_PX);
    Some(median(&mut spreads)? / noise)
}
