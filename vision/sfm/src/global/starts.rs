//! From rotations to first positions: several starts, the best one kept.

use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};
use volery_scene::{Cancelled, Progress};

use super::positioning::{Positions, PositioningOptions, RayObservation, position_globally};
use crate::incremental::WorkingModel;

/// Random starts beside the one from a sphere of points.
const NUM_RANDOM_STARTS: u64 = 2;
/// Sightings of an image that positioning uses; tracks beyond are left to triangulation.
const MAX_SIGHTINGS: usize = 400;
/// Views of a track that positioning uses.
const MIN_VIEWS: usize = 3;
/// Shift of the centers of a start on a sphere, relative to its radius.
const SPHERE_CENTER_SPREAD: f64 = 1e-2;

impl WorkingModel<'_> {
    /// Gives the images with a rotation a center, and tracks a point. `false` if there is too
    /// little to go by.
    pub(super) fn position(
        &mut self,
        rotations: &[Option<UnitQuaternion<f64>>],
        progress: &dyn Progress,
    ) -> Result<bool, Cancelled> {
        let (tracks, observations) = self.ray_observations(rotations);
        if observations.is_empty() {
            return Ok(false);
        }
        let mut best: Option<(f64, Positions)> = None;
        for start in 0..=NUM_RANDOM_STARTS {
            progress.check()?;
            let mut positions = match start {
                0 => sphere(rotations.len(), tracks.len(), &observations),
                seed => scattered(
                    rotations.len(),
                    tracks.len(),
                    self.input.options.seed.wrapping_add(seed),
                ),
            };
            let cost =
                position_globally(&mut positions, &observations, &PositioningOptions::default());
            #[cfg(test)]
            println!("  start {start} cost {cost:.3e} obs {}", observations.len());
            if best.as_ref().is_none_or(|(least, _)| cost < *least) {
                best = Some((cost, positions));
            }
        }
        let Some((_, positions)) = best else { return Ok(false) };
        for (image, rotation) in rotations.iter().enumerate() {
            self.poses[image] = rotation.map(|rotation| {
                let translation = -(rotation * positions.centers[image].coords);
                Isometry3::from_parts(Translation3::from(translation), rotation)
            });
        }
        for (&track, &point) in tracks.iter().zip(&positions.points) {
            self.tracks[track].position = Some(point);
        }
        Ok(true)
    }

    /// Rays of the longest tracks, enough for every image, sorted by track; and the tracks.
    fn ray_observations(
        &self,
        rotations: &[Option<UnitQuaternion<f64>>],
    ) -> (Vec<usize>, Vec<RayObservation>) {
        let views = |track: usize| {
            self.tracks[track].sightings.iter().filter_map(|s| {
                let rotation = (*rotations.get(s.image as usize)?)?;
                let xy = self.rays[s.image as usize][s.keypoint as usize]?;
                let ray = rotation.inverse() * Vector3::new(xy.x, xy.y, 1.0);
                Some((s.image as usize, Unit::new_normalize(ray)))
            })
        };
        let mut order: Vec<(usize, usize)> = (0..self.tracks.len())
            .map(|track| (views(track).count(), track))
            .filter(|&(num_views, _)| num_views >= MIN_VIEWS)
            .collect();
        order.sort_by_key(|&(num_views, track)| (std::cmp::Reverse(num_views), track));
        let mut num_sightings = vec![0; rotations.len()];
        let mut chosen: Vec<usize> = order
            .into_iter()
            .filter(|&(_, track)| {
                let is_needed =
                    views(track).any(|(image, _)| num_sightings[image] < MAX_SIGHTINGS);
                if is_needed {
                    views(track).for_each(|(image, _)| num_sightings[image] += 1);
                }
                is_needed
            })
            .map(|(_, track)| track)
            .collect();
        chosen.sort_unstable();
        let observations = chosen
            .iter()
            .enumerate()
            .flat_map(|(point, &track)| {
                views(track).map(move |(image, ray_in_world)| RayObservation {
                    image,
                    point,
                    ray_in_world,
                })
            })
            .collect();
        (chosen, observations)
    }
}

/// Points at distance 1 along their mean ray, centers near the origin: right for scans in place.
fn sphere(num_images: usize, num_points: usize, observations: &[RayObservation]) -> Positions {
    let mut points = vec![Point3::origin(); num_points];
    for o in observations {
        points[o.point] += o.ray_in_world.into_inner();
    }
    for point in &mut points {
        let norm = point.coords.norm();
        if norm > 1e-9 {
            point.coords /= norm;
        }
    }
    let mut centers = scattered(num_images, 0, 0).centers;
    for center in &mut centers {
        center.coords *= SPHERE_CENTER_SPREAD;
    }
    Positions { centers, points }
}

/// Everything anywhere in a cube.
fn scattered(num_images: usize, num_points: usize, seed: u64) -> Positions {
    // SplitMix64.
    let mut state = seed;
    let mut random = move || {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    };
    let mut any = |n: usize| (0..n).map(|_| Point3::new(random(), random(), random())).collect();
    Positions { centers: any(num_images), points: any(num_points) }
}
