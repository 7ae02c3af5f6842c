//! Map points from the frame in which they were recognized to another.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

use nalgebra::{Isometry3, Matrix2, Matrix3x2, Point2, Point3};
use volery_geometry::{Camera, SimdLevel};
use volery_localization::{LocalizationIndex, SeenPoint};

use crate::klt::{Found, Template};
use crate::pyramid::Pyramid;

/// Points followed at most.
const MAX_POINTS: usize = 200;
/// Least correlation of a patch that is found.
const MIN_LIKENESS: f32 = 0.8;
/// Greatest distance of a patch that is looked for the other way round from its start, pixels of
/// the level.
const MAX_RETURN: f32 = 0.5;
/// The way back starts this far off at most, pixels of the level.
const MAX_DETOUR: f32 = 2.0;
/// Levels that say where a patch is; coarser ones only lead there.
const NUM_EXACT: usize = 2;
/// Change of size of a patch that can be followed, either way.
const MAX_ZOOM: f32 = 3.0;

/// A frame in which points were recognized.
pub(crate) struct Anchor {
    pub(crate) pyramid: Arc<Pyramid>,
    pub(crate) cam_from_map: Isometry3<f64>,
    pub(crate) time: Duration,
}

/// A point of the map in the frame in which it was recognized.
#[derive(Clone)]
pub(crate) struct Followed {
    seen: SeenPoint,
    position: Point3<f64>,
    anchor: Arc<Anchor>,
}

/// Those of `old` that were anchored after `since` and of which `seen` is still in view, then points
/// of `support` that can be followed and are not among them.
pub(crate) fn anchored(
    anchor: &Arc<Anchor>,
    support: &[SeenPoint],
    index: &LocalizationIndex,
    old: &[Followed],
    seen: &[SeenPoint],
    since: Duration,
) -> Vec<Followed> {
    let among =
        |points: &[SeenPoint]| -> BTreeSet<u32> { points.iter().map(|s| s.point).collect() };
    let still_seen = among(seen);
    let stays = |f: &&Followed| f.anchor.time >= since && still_seen.contains(&f.seen.point);
    let mut followed: Vec<Followed> = old.iter().filter(stays).cloned().collect();
    let known: BTreeSet<u32> = followed.iter().map(|f| f.seen.point).collect();
    let fine = &anchor.pyramid.levels[0];
    followed.extend(support.iter().filter(|s| !known.contains(&s.point)).filter_map(|&seen| {
        let position = index.position(seen.point)?;
        Template::new(fine, seen.pixel.cast::<f32>(), &Matrix2::identity())?;
        Some(Followed { seen, position, anchor: Arc::clone(anchor) })
    }));
    thin(&mut followed);
    followed
}

/// Every n-th, so that not more than [`MAX_POINTS`] stay.
fn thin(followed: &mut Vec<Followed>) {
    let step = followed.len().div_ceil(MAX_POINTS).max(1);
    let mut index = 0;
    followed.retain(|_| {
        index += 1;
        (index - 1) % step == 0
    });
}

/// What became of the followed points in a frame.
pub(crate) struct Sightings {
    /// Where they were found.
    pub(crate) seen: Vec<SeenPoint>,
    /// Points that should be in view.
    pub(crate) num_tried: usize,
}

/// Looks for points in a frame that was taken near `cam_from_map`.
pub(crate) fn follow(
    points: &[Followed],
    pyramid: &Pyramid,
    camera: &Camera,
    cam_from_map: &Isometry3<f64>,
    simd: SimdLevel,
) -> Sightings {
    let mut sightings = Sightings { seen: Vec::with_capacity(points.len()), num_tried: 0 };
    for point in points {
        let Some((predicted, by_anchor)) = view(point, camera, cam_from_map) else { continue };
        sightings.num_tried += 1;
        if let Some((place, level)) = find(point, pyramid, predicted, &by_anchor, simd) {
            let scale = f64::from(1_u32 << level);
            sightings.seen.push(SeenPoint {
                pixel: place.cast::<f64>() * scale,
                relative_sigma: point.seen.relative_sigma * scale,
                ..point.seen
            });
        }
    }
    sightings
}

/// Where a point should appear, and how a surface there that faces the anchor's camera moves: the
/// derivative of pixels by pixels of the anchor.
fn view(
    point: &Followed,
    camera: &Camera,
    cam_from_map: &Isometry3<f64>,
) -> Option<(Point2<f64>, Matrix2<f32>)> {
    let now = camera.project_with_jacobians(&(cam_from_map * point.position))?;
    if !camera.contains(&now.pixel) {
        return None;
    }
    let depth = (point.anchor.cam_from_map * point.position).z;
    let cam_from_anchor =
        (cam_from_map.rotation * point.anchor.cam_from_map.rotation.inverse()).to_rotation_matrix();
    let focal = camera.focal();
    let per_pixel = Matrix3x2::new(depth / focal.x, 0.0, 0.0, depth / focal.y, 0.0, 0.0);
    let by_anchor = (now.d_point * cam_from_anchor.matrix() * per_pixel).cast::<f32>();
    let zoom = by_anchor.determinant();
    (1.0 / MAX_ZOOM..MAX_ZOOM).contains(&zoom).then_some((now.pixel, by_anchor))
}

/// Where a patch is, in pixels of the finest level that shows it, and that level.
fn find(
    point: &Followed,
    pyramid: &Pyramid,
    predicted: Point2<f64>,
    by_anchor: &Matrix2<f32>,
    simd: SimdLevel,
) -> Option<(Point2<f32>, usize)> {
    let from_current = by_anchor.try_inverse()?;
    let anchor = &point.anchor.pyramid;
    let (mut place, mut exact) = (predicted.cast::<f32>(), None);
    for level in (0..pyramid.levels.len().min(anchor.levels.len())).rev() {
        let scale = (1_u32 << level) as f32;
        let center = point.seen.pixel.cast::<f32>() / scale;
        let start = place / scale;
        let template = Template::new(&anchor.levels[level], center, &from_current);
        let found = template.and_then(|t| t.find(simd, &pyramid.levels[level], start));
        let Some(Found { place: here, .. }) = found.filter(|f| f.likeness > MIN_LIKENESS) else {
            continue;
        };
        place = here * scale;
        if level >= NUM_EXACT {
            continue;
        }
        // The way back starts as far off as this one did.
        let detour = from_current * (predicted.cast::<f32>() / scale - here);
        let detour = detour * (MAX_DETOUR / detour.norm().max(MAX_DETOUR));
        let back = Template::new(&pyramid.levels[level], here, by_anchor);
        let back = back.and_then(|t| t.find(simd, &anchor.levels[level], center + detour));
        if back.is_some_and(|back| (back.place - center).norm() < MAX_RETURN) {
            exact = Some((here, level));
        }
    }
    exact
}
