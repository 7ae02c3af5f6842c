//! Local and global bundle adjustment of the growing model.

use volery_estimation::bundle_adjustment::{BundleCamera, BundleObservation, BundlePose};
use volery_estimation::{
    BundleError, BundleOptions, BundleProblem, IntrinsicsRefinement, adjust_bundle,
};
use volery_geometry::Camera;
use volery_scene::{Cancelled, Progress};

use super::working::WorkingModel;

/// Images whose poses a local adjustment moves, the new one included.
const NUM_LOCAL_IMAGES: usize = 7;
/// Images with one camera before its focal length may move.
const MIN_IMAGES_FOCAL: usize = 3;
/// Images of a model before distortion and principal point may move.
const MIN_IMAGES_DISTORTION: usize = 5;
/// Sightings by a camera before its intrinsics may move.
const MIN_SIGHTINGS: usize = 60;
/// Fields of view outside this range, degrees, are a sign that self-calibration ran away.
pub(crate) const FOV_RANGE_DEG: (f64, f64) = (15.0, 140.0);
/// Greatest believable radial or tangential coefficient of a lens that is not a fisheye.
pub(crate) const MAX_DISTORTION: f64 = 1.0;
/// Relative standard deviation given to a focal length that is known from metadata.
const FOCAL_PRIOR_SIGMA: f64 = 0.15;

impl WorkingModel<'_> {
    /// Refines everything. Points with fewer active sightings than two are not part of it.
    pub(crate) fn adjust_all(
        &mut self,
        options: &BundleOptions,
        progress: &dyn Progress,
    ) -> Result<(), Cancelled> {
        let registered = self.registered();
        let variable = vec![true; self.num_images()];
        let before = self.cameras.clone();
        self.adjust(&registered, &variable, true, options, progress)?;
        let mut ran_away = false;
        for (camera, before) in before.iter().enumerate() {
            if !is_believable(&self.cameras[camera]) {
                self.cameras[camera] = *before;
                self.frozen[camera] = true;
                ran_away = true;
            }
        }
        if ran_away {
            self.adjust(&registered, &variable, true, options, progress)?;
        }
        self.update_rays();
        Ok(())
    }

    /// Refines the points; poses and intrinsics stay.
    pub(crate) fn adjust_points(
        &mut self,
        options: &BundleOptions,
        progress: &dyn Progress,
    ) -> Result<(), Cancelled> {
        let constant = vec![false; self.num_images()];
        self.frozen.fill(true);
        self.adjust(&self.registered(), &constant, true, options, progress)
    }

    /// Refines `image`, the images that share most points with it, and the points they see.
    pub(crate) fn adjust_around(
        &mut self,
        image: usize,
        options: &BundleOptions,
        progress: &dyn Progress,
    ) -> Result<Vec<usize>, Cancelled> {
        let local = self.covisible(image, NUM_LOCAL_IMAGES);
        let mut variable = vec![false; self.num_images()];
        for &index in &local {
            variable[index] = true;
        }
        self.adjust(&local, &variable, false, options, progress)?;
        Ok(local)
    }

    /// `image` and the up to `count - 1` images that share most points with it.
    fn covisible(&self, image: usize, count: usize) -> Vec<usize> {
        let mut shared = self.num_shared(image);
        shared[image] = 0;
        let mut order: Vec<usize> =
            (0..shared.len()).filter(|&i| shared[i] > 0 && self.poses[i].is_some()).collect();
        order.sort_by_key(|&i| (std::cmp::Reverse(shared[i]), i));
        order.truncate(count - 1);
        order.push(image);
        order.sort_unstable();
        order
    }

    /// Per image the number of points it shares with `image`.
    pub(crate) fn num_shared(&self, image: usize) -> Vec<u32> {
        let mut shared = vec![0; self.num_images()];
        for &(track, slot) in &self.image_tracks[image] {
            let track = &self.tracks[track as usize];
            if track.position.is_none() || !track.sightings[slot as usize].active {
                continue;
            }
            for sighting in track.sightings.iter().filter(|s| s.active) {
                shared[sighting.image as usize] += 1;
            }
        }
        shared
    }

    /// Refines the poses that are `variable` with the points that the `images` see. In a local
    /// problem a point that the newest images do not share stays if other images see it too.
    fn adjust(
        &mut self,
        images: &[usize],
        variable: &[bool],
        global: bool,
        options: &BundleOptions,
        progress: &dyn Progress,
    ) -> Result<(), Cancelled> {
        let mut tracks: Vec<usize> = if global {
            (0..self.tracks.len()).collect()
        } else {
            let of = |&image: &usize| self.image_tracks[image].iter().map(|&(t, _)| t as usize);
            images.iter().flat_map(of).collect()
        };
        tracks.sort_unstable();
        tracks.dedup();
        tracks.retain(|&t| self.tracks[t].position.is_some());

        let mut problem = BundleProblem::default();
        let mut camera_slot = vec![u32::MAX; self.cameras.len()];
        let mut pose_slot = vec![u32::MAX; self.num_images()];
        let refinement = if global { self.refinement() } else { Vec::new() };
        let mut point_tracks = Vec::new();
        for track in tracks {
            let Some(position) = self.tracks[track].position else { continue };
            let active = || self.tracks[track].sightings.iter().filter(|s| s.active);
            let num_inside = active().filter(|s| variable[s.image as usize]).count();
            if num_inside == 0 && !global {
                continue;
            }
            let num_outside = active().count() - num_inside;
            let constant = !global && num_outside > 0 && num_inside < 2;
            let point = problem.points.len() as u32;
            problem.points.push(position);
            problem.constant_points.push(constant);
            point_tracks.push(track);
            for sighting in active() {
                let image = sighting.image as usize;
                if constant && !variable[image] {
                    continue;
                }
                if pose_slot[image] == u32::MAX {
                    let camera = self.camera_index(image);
                    if camera_slot[camera] == u32::MAX {
                        camera_slot[camera] = problem.cameras.len() as u32;
                        let refine =
                            refinement.get(camera).copied().unwrap_or(IntrinsicsRefinement::FIXED);
                        problem.cameras.push(self.bundle_camera(camera, refine));
                    }
                    let Some(cam_from_world) = self.poses[image] else { continue };
                    pose_slot[image] = problem.poses.len() as u32;
                    problem.poses.push(BundlePose {
                        cam_from_world,
                        camera: camera_slot[camera],
                        constant: !variable[image],
                        position_prior: None,
                        gravity_prior: None,
                    });
                }
                problem.observations.push(BundleObservation {
                    pose: pose_slot[image],
                    point,
                    pixel: self.pixel(sighting),
                });
            }
        }
        match adjust_bundle(&mut problem, options, progress) {
            Ok(_) => {}
            Err(BundleError::Cancelled(cancelled)) => return Err(cancelled),
            // Nothing to refine, or a value that cannot be refined: the model stays as it is.
            Err(_) => return Ok(()),
        }
        for (image, &slot) in pose_slot.iter().enumerate() {
            if slot != u32::MAX {
                self.poses[image] = Some(problem.poses[slot as usize].cam_from_world);
            }
        }
        for (camera, &slot) in camera_slot.iter().enumerate() {
            if slot != u32::MAX {
                self.cameras[camera] = problem.cameras[slot as usize].camera;
            }
        }
        for (&track, position) in point_tracks.iter().zip(&problem.points) {
            self.tracks[track].position = Some(*position);
        }
        Ok(())
    }

    fn bundle_camera(&self, camera: usize, refine: IntrinsicsRefinement) -> BundleCamera {
        let first = &self.input.cameras[camera];
        let focal = first.camera.mean_focal();
        let focal_prior =
            (refine.focal && !first.focal_is_guess).then_some((focal, FOCAL_PRIOR_SIGMA * focal));
        BundleCamera { camera: self.cameras[camera], refine, focal_prior }
    }

    /// Which intrinsics of each camera the model can determine by now.
    fn refinement(&self) -> Vec<IntrinsicsRefinement> {
        let num_registered = self.num_registered();
        let mut num_sightings = vec![0usize; self.cameras.len()];
        for track in self.tracks.iter().filter(|track| track.position.is_some()) {
            for sighting in track.sightings.iter().filter(|s| s.active) {
                num_sightings[self.camera_index(sighting.image as usize)] += 1;
            }
        }
        (0..self.cameras.len())
            .map(|camera| {
                let wanted = self.input.cameras[camera].refine;
                if self.frozen[camera] || num_sightings[camera] < MIN_SIGHTINGS {
                    return IntrinsicsRefinement::FIXED;
                }
                let late = num_registered >= MIN_IMAGES_DISTORTION;
                IntrinsicsRefinement {
                    focal: wanted.focal && num_registered >= MIN_IMAGES_FOCAL,
                    principal_point: wanted.principal_point && late,
                    distortion: wanted.distortion && late,
                }
            })
            .collect()
    }
}

/// Whether a refined camera could be a real one.
pub(crate) fn is_believable(camera: &Camera) -> bool {
    let fov = camera.horizontal_fov().to_degrees();
    let start = camera.model.distortion_start();
    let c = camera.principal_point();
    fov.is_finite()
        && (FOV_RANGE_DEG.0..=FOV_RANGE_DEG.1).contains(&fov)
        && camera.contains(&c)
        && camera.params()[start..].iter().take(2).all(|k| k.abs() <= MAX_DISTORTION)
}
