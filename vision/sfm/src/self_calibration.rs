//! A first focal length from fundamental matrices, for cameras nothing is known of.

use nalgebra::Matrix3;
use volery_geometry::Camera;
use volery_scene::TwoViewGeometry;

use crate::{SfmCamera, SfmImage};

/// Horizontal fields of view searched, degrees.
const FOV_RANGE_DEG: (f64, f64) = (25.0, 120.0);
/// Steps of the search, evenly spaced in the logarithm of the focal length.
const NUM_STEPS: usize = 80;
/// Inliers of a pair whose fundamental matrix is worth asking.
const MIN_INLIERS: usize = 50;
/// Pairs asked, those with most inliers first.
const MAX_PAIRS: usize = 400;
/// Difference of the singular values of E, relative to their sum, that is mere noise.
const SCALE: f64 = 0.02;
/// The best focal length must explain the pairs so much better than the average one.
const MIN_CONTRAST: f64 = 0.8;

/// Intrinsics to start mapping with: as given, guessed focal lengths replaced by those that turn
/// the fundamental matrices into essential ones.
///
/// An essential matrix has two equal singular values. For guessed cameras of one image size a
/// common focal length is searched that minimizes, over the pairs among them,
///
/// ```text
/// Σ w ρ((σ₁ − σ₂) / (σ₁ + σ₂)),   σ of K₂ᵀ F K₁,   ρ(c) = c² / (c² + s²)
/// ```
///
/// Guesses stay where the pairs do not tell (pure rotation, planes, too few pairs).
///
/// Source: Mendonça & Cipolla, "A Simple Technique for Self-Calibration", CVPR 1999.
pub fn start_cameras(
    images: &[SfmImage],
    cameras: &[SfmCamera],
    pairs: &[TwoViewGeometry],
) -> Vec<Camera> {
    let mut start: Vec<Camera> = cameras.iter().map(|camera| camera.camera).collect();
    let mut done = vec![false; cameras.len()];
    for first in 0..cameras.len() {
        if done[first] || !cameras[first].focal_is_guess || !cameras[first].refine.focal {
            continue;
        }
        let size = |i: usize| (cameras[i].camera.width, cameras[i].camera.height);
        let group: Vec<bool> = (0..cameras.len())
            .map(|i| size(i) == size(first) && cameras[i].focal_is_guess && cameras[i].refine.focal)
            .collect();
        let witnesses = witnesses(images, pairs, &group);
        let focal = best_focal(&start[first], &witnesses);
        for camera in (0..cameras.len()).filter(|&i| group[i]) {
            done[camera] = true;
            if let Some(focal) = focal {
                let num_focals = start[camera].model.num_focals();
                start[camera].params_mut()[..num_focals].fill(focal);
            }
        }
    }
    start
}

/// Fundamental matrices with weights of pairs both of whose cameras are in the group.
fn witnesses(
    images: &[SfmImage],
    pairs: &[TwoViewGeometry],
    group: &[bool],
) -> Vec<(Matrix3<f64>, f64)> {
    let in_group = |id: u32| {
        images
            .get(id as usize)
            .and_then(|image| group.get(image.camera.0 as usize))
            .copied()
            .unwrap_or(false)
    };
    let mut witnesses: Vec<(Matrix3<f64>, f64)> = pairs
        .iter()
        .filter(|pair| pair.num_inliers() >= MIN_INLIERS)
        .filter(|pair| in_group(pair.image1.0) && in_group(pair.image2.0))
        .filter_map(|pair| Some((pair.fundamental?, (pair.num_inliers() as f64).sqrt())))
        .collect();
    witnesses.sort_by(|a, b| b.1.total_cmp(&a.1));
    witnesses.truncate(MAX_PAIRS);
    witnesses
}

fn best_focal(camera: &Camera, witnesses: &[(Matrix3<f64>, f64)]) -> Option<f64> {
    if witnesses.is_empty() {
        return None;
    }
    let focal_of =
        |fov_deg: f64| f64::from(camera.width) / 2.0 / (fov_deg.to_radians() / 2.0).tan();
    let (least, greatest) = (focal_of(FOV_RANGE_DEG.1), focal_of(FOV_RANGE_DEG.0));
    let c = camera.principal_point();
    let cost = |focal: f64| -> f64 {
        let k = Matrix3::new(focal, 0.0, c.x, 0.0, focal, c.y, 0.0, 0.0, 1.0);
        witnesses
            .iter()
            .map(|(f, weight)| {
                let s = (k.transpose() * f * k).singular_values();
                let c = (s[0] - s[1]) / (s[0] + s[1]);
                if c.is_finite() { weight * c * c / (c * c + SCALE * SCALE) } else { *weight }
            })
            .sum()
    };
    let step = (greatest / least).ln() / (NUM_STEPS - 1) as f64;
    let costs: Vec<f64> = (0..NUM_STEPS).map(|i| cost(least * (step * i as f64).exp())).collect();
    let best = (0..NUM_STEPS).min_by(|&a, &b| costs[a].total_cmp(&costs[b]))?;
    let mean = costs.iter().sum::<f64>() / NUM_STEPS as f64;
    // At the rim of the range or on a plateau the pairs tell nothing.
    if best == 0 || best == NUM_STEPS - 1 || costs[best] > MIN_CONTRAST * mean {
        return None;
    }
    // Vertex of the parabola through the best step and its neighbors.
    let (a, b, c) = (costs[best - 1], costs[best], costs[best + 1]);
    let offset = 0.5 * (a - c) / (a - 2.0 * b + c);
    Some(least * (step * (best as f64 + offset.clamp(-1.0, 1.0))).exp())
}
