//! Map points looked for where a pose says that they are.

use nalgebra::{Isometry3, Point2};
use volery_geometry::Camera;
use volery_scene::{Descriptor, Features};

use crate::LocalizationIndex;
use crate::correspondences::Pair;
use crate::index::Sighting;

/// Greatest angle between the query's view of a point and a map image's, degrees: beyond it, SIFT
/// does not recognize a surface.
const MAX_VIEW_ANGLE_DEG: f64 = 45.0;
/// Greatest ratio of the query's distance to a point and a map image's, either way.
const MAX_DISTANCE_RATIO: f64 = 3.0;
/// Sightings of a point whose descriptors are compared.
const MAX_SIGHTINGS: usize = 4;
/// Greatest distance of a match, squared, for descriptors of norm 256: 0.6 of unit length.
const MAX_SQUARED_DISTANCE: i32 = 23_593;
/// Greatest ratio of the nearest to the second-nearest keypoint in the window.
const MAX_RATIO: f64 = 0.9;
/// Two detections at one place are no contradiction to each other, pixels.
const SAME_PLACE_PX: f32 = 3.0;

/// The query's keypoints by cells.
pub(crate) struct KeypointGrid {
    columns: usize,
    rows: usize,
    /// Cell c holds `members[starts[c]..starts[c + 1]]`.
    starts: Vec<u32>,
    members: Vec<u32>,
}

const CELL_PX: f64 = 16.0;

impl KeypointGrid {
    pub(crate) fn new(features: &Features, camera: &Camera) -> Self {
        let columns = (f64::from(camera.width) / CELL_PX) as usize + 1;
        let rows = (f64::from(camera.height) / CELL_PX) as usize + 1;
        let cell = |i: usize| {
            let pixel = features.keypoints[i].pixel();
            let column = ((pixel.x / CELL_PX).max(0.0) as usize).min(columns - 1);
            let row = ((pixel.y / CELL_PX).max(0.0) as usize).min(rows - 1);
            row * columns + column
        };
        let mut starts = vec![0; columns * rows + 1];
        for i in 0..features.len() {
            starts[cell(i) + 1] += 1;
        }
        for c in 1..starts.len() {
            starts[c] += starts[c - 1];
        }
        let mut next = starts.clone();
        let mut members = vec![0; features.len()];
        for i in 0..features.len() {
            let slot = &mut next[cell(i)];
            members[*slot as usize] = i as u32;
            *slot += 1;
        }
        Self { columns, rows, starts, members }
    }

    /// Keypoints in the cells that touch a window.
    fn near(&self, pixel: &Point2<f64>, radius: f64) -> impl Iterator<Item = u32> + '_ {
        let range = |center: f64, count: usize| {
            let low = ((center - radius) / CELL_PX).max(0.0) as usize;
            let high = ((center + radius) / CELL_PX).max(0.0) as usize;
            low.min(count)..(high + 1).min(count)
        };
        let columns = range(pixel.x, self.columns);
        range(pixel.y, self.rows).flat_map(move |row| {
            let columns = columns.clone();
            let start = self.starts[row * self.columns + columns.start] as usize;
            let end = self.starts[row * self.columns + columns.end] as usize;
            self.members[start..end.max(start)].iter().copied()
        })
    }
}

/// What a pose finds of the map.
pub(crate) struct Sighted {
    /// One per keypoint and per point.
    pub(crate) pairs: Vec<Pair>,
    /// Map points that should be in view.
    pub(crate) num_visible: usize,
}

/// The map points near those in `seeds` that the pose brings into view, each matched to the
/// keypoint within `radius_px` that looks like it.
pub(crate) fn match_projected(
    index: &LocalizationIndex,
    features: &Features,
    grid: &KeypointGrid,
    camera: &Camera,
    cam_from_world: &Isometry3<f64>,
    seeds: &[Pair],
    radius_px: f64,
) -> Sighted {
    let mut best_of_keypoint: Vec<Option<(i32, u32)>> = vec![None; features.len()];
    let mut num_visible = 0;
    for point in neighborhood(index, seeds) {
        let Some((pixel, sightings)) = view(index, camera, cam_from_world, point) else {
            continue;
        };
        num_visible += 1;
        let found = look_around(index, features, grid, &pixel, &sightings, radius_px);
        if let Some((distance, keypoint)) = found {
            let best = &mut best_of_keypoint[keypoint as usize];
            if best.is_none_or(|best| (distance, point) < best) {
                *best = Some((distance, point));
            }
        }
    }
    let pairs = best_of_keypoint.iter().enumerate().filter_map(|(keypoint, best)| {
        best.map(|(_, point)| Pair { keypoint: keypoint as u32, point })
    });
    Sighted { pairs: pairs.collect(), num_visible }
}

/// All points of the images that see any of the seeds, in order.
fn neighborhood(index: &LocalizationIndex, seeds: &[Pair]) -> impl Iterator<Item = u32> + use<> {
    let mut is_near_image = vec![false; index.images.len()];
    for sighting in seeds.iter().flat_map(|seed| index.sightings(seed.point)) {
        is_near_image[sighting.image as usize] = true;
    }
    let mut is_near = vec![false; index.points.len()];
    for (image, _) in index.images.iter().zip(is_near_image).filter(|(_, near)| *near) {
        for &point in &image.points {
            is_near[point as usize] = true;
        }
    }
    is_near.into_iter().enumerate().filter_map(|(point, near)| near.then_some(point as u32))
}

/// Where a point appears, and its sightings from the most similar directions; `None` where it is
/// out of view, or was never seen from anywhere like here.
fn view(
    index: &LocalizationIndex,
    camera: &Camera,
    cam_from_world: &Isometry3<f64>,
    point: u32,
) -> Option<(Point2<f64>, Vec<Sighting>)> {
    let position = index.points[point as usize].position;
    let in_cam = cam_from_world * position;
    let pixel = camera.project(&in_cam)?;
    let (width, height) = (f64::from(camera.width), f64::from(camera.height));
    if !(0.0..width).contains(&pixel.x) || !(0.0..height).contains(&pixel.y) {
        return None;
    }
    let ray = cam_from_world.rotation.inverse_transform_vector(&in_cam.coords);
    let distance = ray.norm();
    let min_cosine = MAX_VIEW_ANGLE_DEG.to_radians().cos();
    let mut near: Vec<(f64, Sighting)> = Vec::new();
    for &sighting in index.sightings(point) {
        let other = position - index.images[sighting.image as usize].center;
        let other_distance = other.norm();
        let cosine = ray.dot(&other) / (distance * other_distance);
        let ratio = distance / other_distance;
        if cosine > min_cosine && (1.0 / MAX_DISTANCE_RATIO..MAX_DISTANCE_RATIO).contains(&ratio) {
            // Likeness of the view: the angle and the change of scale.
            near.push((1.0 - cosine + 0.1 * ratio.ln().abs(), sighting));
        }
    }
    near.sort_by(|a, b| a.0.total_cmp(&b.0));
    near.truncate(MAX_SIGHTINGS);
    (!near.is_empty()).then(|| (pixel, near.into_iter().map(|(_, sighting)| sighting).collect()))
}

/// The keypoint around `pixel` that looks like the sightings and unlike its neighbors.
fn look_around(
    index: &LocalizationIndex,
    features: &Features,
    grid: &KeypointGrid,
    pixel: &Point2<f64>,
    sightings: &[Sighting],
    radius_px: f64,
) -> Option<(i32, u32)> {
    let mut candidates: Vec<(i32, u32)> = Vec::new();
    for keypoint in grid.near(pixel, radius_px) {
        if (features.keypoints[keypoint as usize].pixel() - pixel).norm() > radius_px {
            continue;
        }
        let descriptor = &features.descriptors[keypoint as usize];
        let distance = sightings
            .iter()
            .map(|s| {
                let image = &index.images[s.image as usize];
                squared_distance(descriptor, &image.descriptors[s.row as usize])
            })
            .min()?;
        candidates.push((distance, keypoint));
    }
    candidates.sort_unstable();
    let &(distance, keypoint) = candidates.first()?;
    if distance > MAX_SQUARED_DISTANCE {
        return None;
    }
    let place = &features.keypoints[keypoint as usize];
    let rival = candidates[1..].iter().find(|(_, other)| {
        let other = &features.keypoints[*other as usize];
        (other.x - place.x).hypot(other.y - place.y) > SAME_PLACE_PX
    });
    let is_distinct = rival
        .is_none_or(|&(second, _)| f64::from(distance) < MAX_RATIO * MAX_RATIO * f64::from(second));
    is_distinct.then_some((distance, keypoint))
}

fn squared_distance(a: &Descriptor, b: &Descriptor) -> i32 {
    let mut sum = 0;
    for (&a, &b) in a.iter().zip(b) {
        let difference = i32::from(i16::from(a) - i16::from(b));
        sum += difference * difference;
    }
    sum
}
