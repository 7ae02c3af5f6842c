//! From rotations to first positions: several starts, the best one kept.

use nalgebra::{Isometry3, Point3, Unit, UnitQuaternion, Vector3};
use volery_estimation::bundle_adjustment::{BundleCamera, BundleObservation, BundlePose};
use volery_estimation::{
    BundleError, BundleOptions, BundleProblem, IntrinsicsRefinement, adjust_bundle_near_rotations,
};
use volery_scene::{Cancelled, Progress};

use super::positioning::{PositioningOptions, Positions, RayObservation, position_globally};
use crate::incremental::WorkingModel;

/// Random starts beside the one from a sphere of points.
const NUM_RANDOM_STARTS: u64 = 2;
/// Sightings of an image that positioning uses; tracks beyond are left to triangulation.
const MAX_SIGHTINGS: usize = 400;
/// Views of a track that positioning uses.
const MIN_VIEWS: usize = 3;
/// Losses of the adjustments of a start, pixels.
const START_LOSSES_PX: [f64; 2] = [10.0, 2.0];
/// What averaging leaves of a rotation error, radians.
const ROTATION_SIGMA: f64 = 0.15 * std::f64::consts::PI / 180.0;
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
        let mut best: Option<(f64, BundleProblem)> = None;
        for start in 0..=NUM_RANDOM_STARTS {
            progress.check()?;
            let positions = match start {
                0 => sphere(rotations.len(), tracks.len(), &observations),
                seed => {
                    let seed = self.input.options.seed.wrapping_add(seed);
                    let mut positions = scattered(rotations.len(), tracks.len(), seed);
                    position_globally(
                        &mut positions,
                        &observations,
                        &PositioningOptions::default(),
                    );
                    positions
                }
            };
            let mut problem = self.bundle_problem(rotations, &tracks, positions);
            // A sphere is within pixels of the truth where it helps at all; a wide loss would let
            // points run off.
            let losses = if start == 0 { &START_LOSSES_PX[1..] } else { &START_LOSSES_PX };
            let cost = adjust_start(&mut problem, losses, progress)?;
            if best.as_ref().is_none_or(|(least, _)| cost < *least) {
                best = Some((cost, problem));
            }
        }
        let Some((_, problem)) = best else { return Ok(false) };
        let mut poses = problem.poses.iter();
        for (image, rotation) in rotations.iter().enumerate() {
            self.poses[image] = rotation.and_then(|_| poses.next()).map(|pose| pose.cam_from_world);
        }
        for (&track, &point) in tracks.iter().zip(&problem.points) {
            self.tracks[track].position = Some(point);
        }
        Ok(true)
    }

    /// All sightings of the tracks by the images with a rotation; intrinsics stay.
    fn bundle_problem(
        &self,
        rotations: &[Option<UnitQuaternion<f64>>],
        tracks: &[usize],
        positions: Positions,
    ) -> BundleProblem {
        let mut slots = vec![None; rotations.len()];
        let mut problem = BundleProblem { points: positions.points, ..BundleProblem::default() };
        problem.cameras.extend(self.cameras.iter().map(|camera| BundleCamera {
            camera: *camera,
            refine: IntrinsicsRefinement::FIXED,
            focal_prior: None,
        }));
        for (image, rotation) in rotations.iter().enumerate() {
            let Some(rotation) = *rotation else { continue };
            slots[image] = Some(problem.poses.len() as u32);
            let translation = -(rotation * positions.centers[image].coords);
            problem.poses.push(BundlePose {
                cam_from_world: Isometry3::from_parts(translation.into(), rotation),
                camera: self.camera_index(image) as u32,
                constant: false,
                position_prior: None,
                gravity_prior: None,
            });
        }
        for (point, &track) in tracks.iter().enumerate() {
            for sighting in &self.tracks[track].sightings {
                if let Some(pose) = slots[sighting.image as usize] {
                    let pixel = self.pixel(sighting);
                    problem.observations.push(BundleObservation {
                        pose,
                        point: point as u32,
                        pixel,
                    });
                }
            }
        }
        problem
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
                let is_needed = views(track).any(|(image, _)| num_sightings[image] < MAX_SIGHTINGS);
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

/// Adjusts with a loss that narrows, rotations held near the averaged ones. Returns the cost.
fn adjust_start(
    problem: &mut BundleProblem,
    losses_px: &[f64],
    progress: &dyn Progress,
) -> Result<f64, Cancelled> {
    let mut cost = f64::INFINITY;
    for &loss_scale_px in losses_px {
        let options = BundleOptions {
            max_iterations: 50,
            loss_scale_px: Some(loss_scale_px),
            cost_tolerance: 1e-4,
        };
        match adjust_bundle_near_rotations(problem, &options, ROTATION_SIGMA, progress) {
            Ok(report) => cost = report.final_cost,
            Err(BundleError::Cancelled(cancelled)) => return Err(cancelled),
            Err(_) => return Ok(f64::INFINITY),
        }
    }
    Ok(cost)
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
