//! Sparse models of one frame to one model.

use std::collections::BTreeMap;

use nalgebra::{Point3, Similarity3, Vector3};
use volery_estimation::bundle_adjustment::{BundleCamera, BundleObservation, BundlePose};
use volery_estimation::{
    BundleError, BundleOptions, BundleProblem, IntrinsicsRefinement, adjust_bundle,
};
use volery_geometry::{median, similarity_from_points};
use volery_scene::{
    CameraId, ImageId, Observation, Point3d, PointId, Progress, RegisteredImage, SparseModel,
};

/// A sighting that is off by more after adjustment is not one of the point, pixels.
const MAX_ERROR_PX: f64 = 6.0;
/// Scale of the last losses, median errors: where Cauchy's loss has 95 % of the efficiency of least
/// squares under normal noise. Mappers end with it, too, and so does who asks how far a map is off.
const LOSS_MEDIANS: f64 = 2.0;
/// Adjustments with that loss, until no sighting is taken out any more.
const MAX_LAST_ROUNDS: usize = 4;

/// A point as one of several models knows it.
pub type PointOfPart = (usize, PointId);

/// The models in one: all cameras, all images and all points, the shared ones once.
///
/// * `parts`: models, each with the transform into the common frame. Images keep their order:
///   those of the first part come first.
/// * `shared`: pairs of points of different parts that are the same. Chains of pairs are followed
///   as long as no part is asked for two of its points; the earlier pair wins.
///
/// Point positions are means over sightings; nothing is refined yet, see [`adjust_merged`].
pub fn merge_models(
    parts: &[(&SparseModel, Similarity3<f64>)],
    shared: &[(PointOfPart, PointOfPart)],
) -> SparseModel {
    let mut merged = SparseModel::default();
    let mut images: BTreeMap<(usize, ImageId), ImageId> = BTreeMap::new();
    for (part, (model, frame_from_model)) in parts.iter().enumerate() {
        let first_camera = merged.cameras.len() as u32;
        let camera_ids: BTreeMap<CameraId, CameraId> = model
            .cameras
            .keys()
            .zip(first_camera..)
            .map(|(&old, new)| (old, CameraId(new)))
            .collect();
        merged.cameras.extend(model.cameras.iter().map(|(id, camera)| (camera_ids[id], *camera)));
        let mut moved = SparseModel { images: model.images.clone(), ..Default::default() };
        moved.transform(frame_from_model);
        for (old, image) in moved.images {
            let Some(&camera) = camera_ids.get(&image.camera) else { continue };
            let id = ImageId(merged.images.len() as u32);
            images.insert((part, old), id);
            let points = vec![None; image.keypoints.len()];
            merged.images.insert(id, RegisteredImage { camera, points, ..image });
        }
    }
    for group in groups(parts, shared) {
        let mut track: Vec<Observation> = Vec::new();
        let (mut sum, mut weight, mut color) = (Vector3::zeros(), 0.0, [0; 3]);
        let mut error_px = 0.0;
        for &(part, id) in &group {
            let (model, frame_from_model) = &parts[part];
            let point = &model.points[&id];
            let n = point.track.len() as f64;
            if n > weight {
                color = point.color;
            }
            sum += (frame_from_model * point.position).coords * n;
            error_px += point.error_px * n;
            weight += n;
            track.extend(point.track.iter().filter_map(|o| {
                let image = *images.get(&(part, o.image))?;
                let is_there = (o.keypoint as usize) < merged.images[&image].points.len();
                is_there.then_some(Observation { image, keypoint: o.keypoint })
            }));
        }
        track.sort_unstable();
        if track.is_empty() {
            continue;
        }
        let id = PointId(merged.points.len() as u64);
        for o in &track {
            if let Some(image) = merged.images.get_mut(&o.image) {
                image.points[o.keypoint as usize] = Some(id);
            }
        }
        let position = Point3::from(sum / weight);
        merged.points.insert(id, Point3d { position, color, error_px: error_px / weight, track });
    }
    merged
}

/// All points, those that are the same together, in the order of the first of each group.
fn groups(
    parts: &[(&SparseModel, Similarity3<f64>)],
    shared: &[(PointOfPart, PointOfPart)],
) -> Vec<Vec<PointOfPart>> {
    let mut group_of: BTreeMap<PointOfPart, usize> = BTreeMap::new();
    let mut groups: Vec<Vec<PointOfPart>> = Vec::new();
    for (part, (model, _)) in parts.iter().enumerate() {
        for &id in model.points.keys() {
            group_of.insert((part, id), groups.len());
            groups.push(vec![(part, id)]);
        }
    }
    for (a, b) in shared {
        let (Some(&a), Some(&b)) = (group_of.get(a), group_of.get(b)) else { continue };
        let (keep, drop) = (a.min(b), a.max(b));
        let has_both = groups[keep].iter().any(|x| groups[drop].iter().any(|y| x.0 == y.0));
        if keep == drop || has_both {
            continue;
        }
        let dropped = std::mem::take(&mut groups[drop]);
        dropped.iter().for_each(|member| {
            group_of.insert(*member, keep);
        });
        groups[keep].extend(dropped);
    }
    groups.retain(|group| !group.is_empty());
    groups
}

/// Refines poses and points of a merged model together until it is at rest; intrinsics stay.
///
/// The frame stays that of the first `num_reference` images: their centers move as little as they
/// can. Sightings that do not fit any more are taken out, and points that are left with less than
/// two.
///
/// # Errors
///
/// As [`adjust_bundle`].
pub fn adjust_merged(
    model: &mut SparseModel,
    num_reference: usize,
    progress: &dyn Progress,
) -> Result<(), BundleError> {
    let centers = |model: &SparseModel| -> Vec<Point3<f64>> {
        model.images.values().take(num_reference).map(RegisteredImage::center).collect()
    };
    let before = centers(model);
    let mut loss_scale_px = BundleOptions::default().loss_scale_px;
    for round in 0..=MAX_LAST_ROUNDS {
        let options = BundleOptions { loss_scale_px, ..BundleOptions::default() };
        adjust(model, &options, progress)?;
        let num_removed = take_out_what_does_not_fit(model);
        if round > 0 && num_removed == 0 {
            break;
        }
        let mut errors: Vec<f64> = errors_px(model).collect();
        loss_scale_px = median(&mut errors).map(|error| LOSS_MEDIANS * error).or(loss_scale_px);
    }
    // Centers on a line say nothing of the turn about it, and then the frame stays as damping left it.
    if let Ok(back) = similarity_from_points(&centers(model), &before) {
        model.transform(&back);
    }
    Ok(())
}

fn adjust(
    model: &mut SparseModel,
    options: &BundleOptions,
    progress: &dyn Progress,
) -> Result<(), BundleError> {
    let mut problem = problem_of(model);
    adjust_bundle(&mut problem, options, progress)?;
    for (image, pose) in model.images.values_mut().zip(&problem.poses) {
        image.cam_from_world = pose.cam_from_world;
    }
    for (point, position) in model.points.values_mut().zip(&problem.points) {
        point.position = *position;
    }
    Ok(())
}

/// Of all sightings.
fn errors_px(model: &SparseModel) -> impl Iterator<Item = f64> {
    model.points.values().flat_map(|point| {
        point.track.iter().filter_map(|o| {
            let image = &model.images[&o.image];
            let camera = &model.cameras[&image.camera];
            let pixel = camera.project(&(image.cam_from_world * point.position))?;
            Some((pixel - image.keypoints[o.keypoint as usize]).norm())
        })
    })
}

fn problem_of(model: &SparseModel) -> BundleProblem {
    let position =
        |ids: &mut dyn Iterator<Item = u64>| -> BTreeMap<u64, u32> { ids.zip(0..).collect() };
    let camera_slot = position(&mut model.cameras.keys().map(|id| id.0.into()));
    let pose_slot = position(&mut model.images.keys().map(|id| id.0.into()));
    let cameras = model.cameras.values().map(|camera| BundleCamera {
        camera: *camera,
        refine: IntrinsicsRefinement::FIXED,
        focal_prior: None,
    });
    let poses = model.images.values().map(|image| BundlePose {
        cam_from_world: image.cam_from_world,
        camera: camera_slot[&image.camera.0.into()],
        constant: false,
        position_prior: None,
        gravity_prior: None,
    });
    let observations = model.points.values().zip(0..).flat_map(|(point, slot)| {
        point
            .track
            .iter()
            .map(|o| BundleObservation {
                pose: pose_slot[&o.image.0.into()],
                point: slot,
                pixel: model.images[&o.image].keypoints[o.keypoint as usize],
            })
            .collect::<Vec<_>>()
    });
    BundleProblem {
        cameras: cameras.collect(),
        poses: poses.collect(),
        points: model.points.values().map(|point| point.position).collect(),
        constant_points: Vec::new(),
        observations: observations.collect(),
    }
}

/// Returns how many sightings went.
fn take_out_what_does_not_fit(model: &mut SparseModel) -> usize {
    let before = model.num_observations();
    let SparseModel { cameras, images, points } = model;
    points.retain(|_, point| {
        let position = point.position;
        let mut errors = Vec::new();
        point.track.retain(|o| {
            let Some(image) = images.get_mut(&o.image) else { return false };
            let keypoint = image.keypoints[o.keypoint as usize];
            let pixel = cameras[&image.camera].project(&(image.cam_from_world * position));
            let error = pixel.map_or(f64::INFINITY, |pixel| (pixel - keypoint).norm());
            let fits = error < MAX_ERROR_PX;
            if fits {
                errors.push(error);
            } else {
                image.points[o.keypoint as usize] = None;
            }
            fits
        });
        let is_point = point.track.len() >= 2;
        if !is_point {
            for o in &point.track {
                if let Some(image) = images.get_mut(&o.image) {
                    image.points[o.keypoint as usize] = None;
                }
            }
        }
        point.error_px = errors.iter().sum::<f64>() / errors.len().max(1) as f64;
        is_point
    });
    before - model.num_observations()
}

#[cfg(test)]
mod tests;
