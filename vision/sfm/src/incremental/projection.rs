//! Points looked for in the images where the model says they show, as visual SLAM does.
//!
//! Two-view matching must choose among all keypoints of an image, and forgoes what is not clearly
//! the most similar. With the model at hand only the few keypoints near the projection compete.

use nalgebra::{Point3, Unit};
use rayon::prelude::*;
use volery_features::squared_distance;
use volery_geometry::triangulation::camera_center;
use volery_scene::Descriptor;

use super::working::{Sighting, Track, WorkingModel};
use crate::keypoint_grid::KeypointGrid;
use crate::tracks::same_place;

/// Shared points that make two images neighbors.
const MIN_SHARED: u32 = 10;
/// Least cosine between the expected line of sight and the nearest known one: descriptors bear
/// about 45 degrees.
const MIN_COS_VIEW: f64 = 0.7;
/// Greatest ratio of the scale found to the scale expected, and of its inverse.
const MAX_SCALE_RATIO: f64 = 1.7;
/// Keypoints compete within so many times the error limit around the projection.
const RIVAL_RADIUS_FACTOR: f64 = 6.0;
/// Greatest ratio of the best to the second-best distance of descriptors, squared.
const MAX_SQUARED_RATIO: f64 = 0.8 * 0.8;
/// Part of the known sightings whose distance to another one of their point is accepted.
const DISTANCE_QUANTILE: f64 = 0.9;
/// Known sightings that a keypoint is compared to, those from the nearest directions.
const NUM_WITNESSES: usize = 4;

const NONE: u32 = u32::MAX;

/// A keypoint that shows a point.
#[derive(Debug, Clone, Copy)]
struct Find {
    track: u32,
    keypoint: u32,
    /// Squared, between descriptors.
    distance: u32,
}

impl WorkingModel<'_> {
    /// Looks for every point in the neighbors of the images that see it and lets the keypoints
    /// that show it join; two points that prove to be one are merged. Returns how many sightings
    /// joined. Does nothing where the descriptors are not at hand.
    pub(crate) fn search_by_projection(&mut self) -> usize {
        let images = self.input.images;
        if images.iter().any(|image| image.features.len() != image.keypoints.len()) {
            return 0;
        }
        let Some(max_distance) = self.usual_distance() else { return 0 };
        let places: Vec<Vec<u32>> = images.par_iter().map(same_place).collect();
        let wanted = self.unseen_points();
        let this = &*self;
        let finds: Vec<Vec<Find>> = wanted
            .par_iter()
            .zip(&places)
            .enumerate()
            .map(|(image, (tracks, place))| this.search_image(image, tracks, place, max_distance))
            .collect();
        finds
            .into_iter()
            .zip(&places)
            .enumerate()
            .map(|(image, (finds, place))| self.join(image, finds, place))
            .sum()
    }

    /// Squared distance within which most known sightings of a point lie.
    fn usual_distance(&self) -> Option<u32> {
        let mut distances: Vec<u32> = Vec::new();
        for track in self.tracks.iter().filter(|track| track.position.is_some()) {
            let mut active = track.sightings.iter().filter(|s| s.active);
            let Some(first) = active.next() else { continue };
            distances.extend(
                active.map(|s| squared_distance(self.descriptor(first), self.descriptor(s))),
            );
        }
        let index = (distances.len().checked_sub(1)? as f64 * DISTANCE_QUANTILE) as usize;
        Some(*distances.select_nth_unstable(index).1)
    }

    fn descriptor(&self, sighting: &Sighting) -> &Descriptor {
        let features = &self.input.images[sighting.image as usize].features;
        &features.descriptors[sighting.keypoint as usize]
    }

    /// Per posed image the points that its neighbors see and it does not.
    fn unseen_points(&self) -> Vec<Vec<u32>> {
        let neighbors = self.neighbors();
        let mut unseen = vec![Vec::new(); self.num_images()];
        let mut looked_at_for = vec![NONE; self.num_images()];
        for (index, track) in self.tracks.iter().enumerate() {
            if track.position.is_none() {
                continue;
            }
            let index = index as u32;
            let seen_by = || track.sightings.iter().filter(|s| s.active).map(|s| s.image as usize);
            for image in seen_by() {
                looked_at_for[image] = index;
            }
            for &neighbor in seen_by().flat_map(|image| &neighbors[image]) {
                if looked_at_for[neighbor] != index {
                    looked_at_for[neighbor] = index;
                    unseen[neighbor].push(index);
                }
            }
        }
        unseen
    }

    /// Per posed image those that share enough points with it.
    fn neighbors(&self) -> Vec<Vec<usize>> {
        (0..self.num_images())
            .map(|image| {
                let shared = self.num_shared(image);
                let is_near = |&other: &usize| other != image && shared[other] >= MIN_SHARED;
                (0..self.num_images()).filter(is_near).collect()
            })
            .collect()
    }

    /// The keypoints of an image that show one of the `tracks`.
    fn search_image(
        &self,
        image: usize,
        tracks: &[u32],
        place: &[u32],
        max_distance: u32,
    ) -> Vec<Find> {
        let Some(pose) = self.poses[image] else { return Vec::new() };
        let (camera, center) = (self.camera(image), camera_center(&pose));
        let photo = &self.input.images[image];
        let grid = KeypointGrid::new(&photo.keypoints, camera.width, camera.height);
        let limit = self.input.options.max_error_px;
        let mut near = Vec::new();
        let mut finds = Vec::new();
        for &index in tracks {
            let track = &self.tracks[index as usize];
            let Some(point) = track.position else { continue };
            let Some(pixel) = camera.project(&(pose * point)).filter(|p| camera.contains(p)) else {
                continue;
            };
            let Some((witnesses, scale)) = self.witnesses(track, &point, &center) else { continue };
            near.clear();
            grid.near(&pixel, RIVAL_RADIUS_FACTOR * limit, &mut near);
            let scales = scale / MAX_SCALE_RATIO..=scale * MAX_SCALE_RATIO;
            near.retain(|&k| {
                scales.contains(&f64::from(photo.features.keypoints[k as usize].scale))
            });
            let candidates = near.iter().map(|&k| {
                let own = &photo.features.descriptors[k as usize];
                let distances = witnesses.iter().map(|w| squared_distance(w, own));
                (distances.min().unwrap_or(u32::MAX), place[k as usize])
            });
            let Some((distance, keypoint)) = clearly_best(candidates) else { continue };
            let error = (photo.keypoints[keypoint as usize] - pixel).norm();
            if distance <= max_distance && error <= limit {
                finds.push(Find { track: index, keypoint, distance });
            }
        }
        finds
    }

    /// Descriptors of the known sightings from the nearest directions, and the scale, pixels, at
    /// which the point shows in an image taken from `center`. `None` if nobody saw it from there.
    fn witnesses(
        &self,
        track: &Track,
        point: &Point3<f64>,
        center: &Point3<f64>,
    ) -> Option<(Vec<&Descriptor>, f64)> {
        let (direction, distance) = Unit::new_and_get(point - center);
        let mut seen: Vec<(f64, f64, &Sighting)> = track
            .sightings
            .iter()
            .filter(|s| s.active)
            .filter_map(|s| {
                let from = camera_center(self.poses[s.image as usize].as_ref()?);
                let (known, range) = Unit::new_and_get(point - from);
                Some((known.dot(&direction), range, s))
            })
            .collect();
        seen.sort_by(|a, b| b.0.total_cmp(&a.0));
        let &(cos_view, range, nearest) = seen.first()?;
        let features = &self.input.images[nearest.image as usize].features;
        let known_scale = f64::from(features.keypoints[nearest.keypoint as usize].scale);
        seen.truncate(NUM_WITNESSES);
        let descriptors = seen.iter().map(|(_, _, s)| self.descriptor(s)).collect();
        (cos_view >= MIN_COS_VIEW).then_some((descriptors, known_scale * range / distance))
    }

    /// Joins the finds of an image to their points; of two points that want one keypoint the more
    /// similar gets it.
    fn join(&mut self, image: usize, mut finds: Vec<Find>, place: &[u32]) -> usize {
        let mut owners = vec![NONE; place.len()];
        for &(track, slot) in &self.image_tracks[image] {
            let keypoint = self.tracks[track as usize].sightings[slot as usize].keypoint;
            owners[place[keypoint as usize] as usize] = track;
        }
        finds.sort_unstable_by_key(|find| (find.distance, find.track));
        let mut num_joined = 0;
        for Find { track, keypoint, .. } in finds {
            let owner = owners[keypoint as usize];
            let point = &self.tracks[track as usize];
            // A merge may have taken the point or given it a sighting here.
            if point.position.is_none() || sighting_of(point, image).is_some() {
                continue;
            }
            let num_new = match owner {
                NONE => self.add_sighting(track as usize, image, keypoint),
                _ => self.take_over(track as usize, owner as usize, image),
            };
            if num_new > 0 {
                owners[keypoint as usize] = track;
            }
            num_joined += num_new;
        }
        num_joined
    }

    /// Gives the sighting of `image` by the track `owner` to `track`, with all others of `owner`
    /// if it belongs to a point. Returns how many sightings moved.
    fn take_over(&mut self, track: usize, owner: usize, image: usize) -> usize {
        let rival = &self.tracks[owner];
        let Some(slot) = sighting_of(rival, image) else { return 0 };
        if rival.position.is_some() && rival.sightings[slot].active {
            self.merge(track, owner)
        } else {
            self.move_sighting(owner, slot, track)
        }
    }

    /// Merges two points if no image shows both and one position fits all sightings. Returns how
    /// many sightings moved to the track `into`.
    fn merge(&mut self, into: usize, from: usize) -> usize {
        let (a, b) = (&self.tracks[into], &self.tracks[from]);
        let (Some(position_a), Some(position_b)) = (a.position, b.position) else { return 0 };
        let active = |t: &Track| -> Vec<Sighting> {
            t.sightings.iter().filter(|s| s.active).copied().collect()
        };
        let (of_a, of_b) = (active(a), active(b));
        if of_b.iter().any(|s| sighting_of(a, s.image as usize).is_some()) {
            return 0;
        }
        let part = of_b.len() as f64 / (of_a.len() + of_b.len()) as f64;
        let position = position_a + (position_b - position_a) * part;
        let limit = self.input.options.max_error_px;
        if of_a.iter().chain(&of_b).any(|s| self.reprojection_error(s, &position) > limit) {
            return 0;
        }
        for slot in (0..self.tracks[from].sightings.len()).rev() {
            if self.tracks[from].sightings[slot].active {
                self.move_sighting(from, slot, into);
            }
        }
        self.tracks[from].clear();
        self.tracks[into].position = Some(position);
        of_b.len()
    }
}

/// Where a track lists its sighting of an image, active or not; it has one at the most.
fn sighting_of(track: &Track, image: usize) -> Option<usize> {
    track.sightings.iter().position(|s| s.image as usize == image)
}

/// The least distance and its place, if those of all other places are clearly greater.
fn clearly_best(candidates: impl Iterator<Item = (u32, u32)>) -> Option<(u32, u32)> {
    let mut best = (u32::MAX, NONE);
    let mut second = u32::MAX;
    for (distance, place) in candidates {
        if place == best.1 {
            best.0 = best.0.min(distance);
        } else if distance < best.0 {
            second = best.0;
            best = (distance, place);
        } else {
            second = second.min(distance);
        }
    }
    let is_clear = f64::from(best.0) <= MAX_SQUARED_RATIO * f64::from(second);
    (best.1 != NONE && is_clear).then_some(best)
}
