//! Which other images help an image, and how far its surfaces may be.

use std::collections::BTreeSet;

use volery_geometry::Camera;
use volery_geometry::triangulation::triangulation_angle;
use volery_scene::{ImageId, Point3d, PointId, RegisteredImage, SparseModel};

use crate::planar_prior::Support;

/// Triangulation angle that is exact enough and changes the picture little, radians.
const BEST_ANGLE: f64 = 12.0 * RADIANS_PER_DEGREE;
/// Spread of the preference below and above [`BEST_ANGLE`], radians.
const ANGLE_SPREAD: [f64; 2] = [5.0 * RADIANS_PER_DEGREE, 14.0 * RADIANS_PER_DEGREE];
/// Least angle of a shared point that counts at all, radians.
const MIN_ANGLE: f64 = 0.5 * RADIANS_PER_DEGREE;
const RADIANS_PER_DEGREE: f64 = std::f64::consts::PI / 180.0;
/// What a point counts that lies in an image's view without being known to be seen by it.
const IN_SIGHT: f64 = 0.25;
/// Help after which more help for the same point counts half.
const ENOUGH_HELP: f64 = 1.0;
/// Images whose depth maps an image's own is compared with at most.
const MAX_RELATIVES: usize = 32;
/// How much nearer than the nearest and farther than the farthest sparse point a surface may be.
const RANGE_SLACK: [f32; 2] = [0.5, 3.0];
/// Part of the sparse points of an image that may be wrong at either end of its depth range.
const RANGE_OUTLIERS: f64 = 0.01;

/// What the sparse model says of one image.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Neighborhood {
    /// Other images, most helpful first.
    pub(crate) sources: Vec<ImageId>,
    /// Images that show most of the same, from wherever, the closest first.
    pub(crate) relatives: Vec<ImageId>,
    /// Least and greatest inverse depth.
    pub(crate) range: [f32; 2],
    /// The sparse points, in pixels of the working camera.
    pub(crate) points: Vec<Support>,
}

/// The neighborhood of an image with at most `max_sources` others; `None` if it has no points or
/// no other image can say anything of its depth.
pub(crate) fn neighborhood(
    model: &SparseModel,
    image: ImageId,
    working: &Camera,
    max_sources: usize,
) -> Option<Neighborhood> {
    let own = model.images.get(&image)?;
    let mut ids: Vec<PointId> = own.points.iter().copied().flatten().collect();
    ids.sort();
    ids.dedup();
    let mut supports = Vec::new();
    let mut points = Vec::new();
    for point in ids.iter().filter_map(|id| model.points.get(id)) {
        let in_cam = own.cam_from_world * point.position;
        if let Some(pixel) = working.project(&in_cam).filter(|pixel| working.contains(pixel)) {
            let w = (1.0 / in_cam.z) as f32;
            supports.push(Support { u: pixel.x as f32, v: pixel.y as f32, w });
            points.push(point);
        }
    }
    let range = depth_range(&supports)?;
    let others: BTreeSet<ImageId> = points
        .iter()
        .flat_map(|point| point.track.iter().map(|seen| seen.image))
        .filter(|&other| other != image)
        .collect();
    let helps: Vec<(ImageId, Vec<Option<f64>>)> = others
        .into_iter()
        .map(|other| (other, points.iter().map(|p| help(model, image, other, p)).collect()))
        .collect();
    let mut shown: Vec<(usize, ImageId)> =
        helps.iter().map(|(other, helps)| (helps.iter().flatten().count(), *other)).collect();
    shown.retain(|&(count, _)| count > 0);
    shown.sort_by_key(|&(count, other)| (std::cmp::Reverse(count), other));
    let relatives = shown.into_iter().map(|(_, other)| other).take(MAX_RELATIVES).collect();
    let helps: Vec<(ImageId, Vec<f64>)> = helps
        .into_iter()
        .map(|(other, helps)| (other, helps.into_iter().map(|h| h.unwrap_or(0.0)).collect()))
        .collect();
    let sources = choose(&helps, points.len(), max_sources);
    (!sources.is_empty()).then_some(Neighborhood { sources, relatives, range, points: supports })
}

/// Images that together help most of the points, the most helpful first. What a point already has
/// counts against what is added.
fn choose(helps: &[(ImageId, Vec<f64>)], num_points: usize, max_sources: usize) -> Vec<ImageId> {
    let mut had = vec![0.0; num_points];
    let mut chosen: Vec<usize> = Vec::new();
    while chosen.len() < max_sources {
        let gain = |helps: &[f64]| -> f64 {
            helps.iter().zip(&had).map(|(help, had)| help / (ENOUGH_HELP + had)).sum()
        };
        let gains = helps.iter().enumerate().filter(|(k, _)| !chosen.contains(k));
        let best = gains
            .map(|(k, (_, helps))| (gain(helps), k))
            .max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
        let Some((_, index)) = best.filter(|(gain, _)| *gain > 0.0) else { break };
        chosen.push(index);
        for (had, help) in had.iter_mut().zip(&helps[index].1) {
            *had += help;
        }
    }
    chosen.into_iter().map(|index| helps[index].0).collect()
}

/// How much image `other` can tell of the depth of a point of image `own`, in [0, 1]: by the angle
/// between the rays, by the resolutions, and by whether it is known to see the point. `None` if
/// the point is not in its view.
fn help(model: &SparseModel, own: ImageId, other: ImageId, point: &Point3d) -> Option<f64> {
    let (own, their) = (model.images.get(&own)?, model.images.get(&other)?);
    let view = |image: &RegisteredImage| {
        let camera = model.cameras.get(&image.camera)?;
        let in_cam = image.cam_from_world * point.position;
        let seen = camera.project(&in_cam).is_some_and(|pixel| camera.contains(&pixel));
        seen.then(|| camera.mean_focal() / in_cam.z)
    };
    let (own_scale, their_scale) = (view(own)?, view(their)?);
    let angle = triangulation_angle(&own.center(), &their.center(), &point.position);
    if angle < MIN_ANGLE {
        return Some(0.0);
    }
    let off = (angle - BEST_ANGLE) / ANGLE_SPREAD[usize::from(angle > BEST_ANGLE)];
    let zoom = (their_scale / own_scale).min(own_scale / their_scale);
    let known = point.track.iter().any(|seen| seen.image == other);
    Some((-0.5 * off * off).exp() * zoom * zoom * if known { 1.0 } else { IN_SIGHT })
}

fn depth_range(points: &[Support]) -> Option<[f32; 2]> {
    let mut inverse: Vec<f32> = points.iter().map(|p| p.w).collect();
    inverse.sort_by(f32::total_cmp);
    let outliers = (inverse.len() as f64 * RANGE_OUTLIERS) as usize;
    let farthest = *inverse.get(outliers)?;
    let nearest = inverse[inverse.len() - 1 - outliers];
    Some([farthest / RANGE_SLACK[1], nearest / RANGE_SLACK[0]])
}
