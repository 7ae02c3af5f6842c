//! Cameras that no one builds.

use volery_scene::SparseModel;

use crate::SfmCamera;
use crate::incremental::{FOV_RANGE_DEG, MAX_DISTORTION};

/// Refined focal lengths believed of cameras whose focal length was given, as parts of it.
const FOCAL_CHANGE: std::ops::RangeInclusive<f64> = 0.7..=1.4;

/// Cameras outside what is built, in words. `given` are the intrinsics before mapping.
pub(super) fn absurd_cameras(model: &SparseModel, given: &[SfmCamera]) -> Vec<String> {
    let mut absurd = Vec::new();
    for (id, camera) in &model.cameras {
        let fov = camera.horizontal_fov().to_degrees();
        if !(FOV_RANGE_DEG.0..=FOV_RANGE_DEG.1).contains(&fov) {
            absurd.push(format!("camera {} has a field of view of {fov:.0} degrees", id.0));
        }
        let distortion = &camera.params()[camera.model.distortion_start()..];
        if let Some(k) = distortion.iter().take(2).find(|k| k.abs() > MAX_DISTORTION) {
            absurd.push(format!("camera {} has a distortion coefficient of {k:.1}", id.0));
        }
        if let Some(first) = given.get(id.0 as usize)
            && !first.focal_is_guess
        {
            let change = camera.mean_focal() / first.camera.mean_focal();
            if !FOCAL_CHANGE.contains(&change) {
                absurd.push(format!(
                    "camera {}: refined focal length is {change:.2} times the given one",
                    id.0
                ));
            }
        }
    }
    absurd
}
