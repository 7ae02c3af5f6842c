//! The model while it grows: poses, cameras, tracks with their points.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Point2, Point3, Vector2};
use volery_geometry::triangulation::camera_center;
use volery_geometry::{Camera, median};
use volery_scene::{
    CameraId, ImageId, Observation, Point3d, PointId, RegisteredImage, SparseModel, TwoViewGeometry,
};

use crate::triangulation::{View, has_angle};
use crate::{MapperOptions, SfmCamera, SfmImage};

/// One sighting of a track.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sighting {
    pub(crate) image: u32,
    pub(crate) keypoint: u32,
    /// Whether it takes part in the point.
    pub(crate) active: bool,
}

/// A track with its point, if it has one.
#[derive(Debug, Clone)]
pub(crate) struct Track {
    pub(crate) sightings: Vec<Sighting>,
    pub(crate) position: Option<Point3<f64>>,
}

impl Track {
    pub(crate) fn num_active(&self) -> usize {
        self.sightings.iter().filter(|s| s.active).count()
    }

    /// Takes the point away.
    pub(crate) fn clear(&mut self) {
        self.position = None;
        for sighting in &mut self.sightings {
            sighting.active = false;
        }
    }
}

/// What mapping starts from.
#[derive(Clone, Copy)]
pub(crate) struct Input<'a> {
    pub(crate) images: &'a [SfmImage],
    pub(crate) cameras: &'a [SfmCamera],
    pub(crate) pairs: &'a [TwoViewGeometry],
    pub(crate) options: &'a MapperOptions,
}

/// The growing model.
#[derive(Clone)]
pub(crate) struct WorkingModel<'a> {
    pub(crate) input: Input<'a>,
    /// Current intrinsics.
    pub(crate) cameras: Vec<Camera>,
    /// Cameras whose refinement went wrong and which stay as they are.
    pub(crate) frozen: Vec<bool>,
    pub(crate) poses: Vec<Option<Isometry3<f64>>>,
    /// Images that may join: not part of an earlier model.
    pub(crate) usable: Vec<bool>,
    pub(crate) tracks: Vec<Track>,
    /// Per image: (track, position in its sightings).
    pub(crate) image_tracks: Vec<Vec<(u32, u32)>>,
    /// Per image and keypoint: undistorted normalized coordinates under `cameras`.
    pub(crate) rays: Vec<Vec<Option<Vector2<f64>>>>,
    /// Cameras the rays were made with.
    ray_cameras: Vec<Camera>,
}

impl<'a> WorkingModel<'a> {
    pub(crate) fn new(
        input: Input<'a>,
        cameras: Vec<Camera>,
        tracks: &[Vec<Observation>],
        usable: Vec<bool>,
    ) -> Self {
        let mut model = Self {
            input,
            frozen: vec![false; cameras.len()],
            poses: vec![None; input.images.len()],
            usable,
            tracks: Vec::with_capacity(tracks.len()),
            image_tracks: vec![Vec::new(); input.images.len()],
            rays: vec![Vec::new(); input.images.len()],
            ray_cameras: cameras.clone(),
            cameras,
        };
        for track in tracks {
            model.add_track(
                track
                    .iter()
                    .map(|o| Sighting { image: o.image.0, keypoint: o.keypoint, active: false })
                    .collect(),
            );
        }
        for index in 0..input.images.len() {
            model.unproject(index);
        }
        model
    }

    /// Adds a track without a point.
    pub(crate) fn add_track(&mut self, sightings: Vec<Sighting>) -> usize {
        let index = self.tracks.len();
        for (slot, sighting) in sightings.iter().enumerate() {
            self.image_tracks[sighting.image as usize].push((index as u32, slot as u32));
        }
        self.tracks.push(Track { sightings, position: None });
        index
    }

    /// Adds an active sighting to a track. Returns 1, the number of sightings that joined.
    pub(crate) fn add_sighting(&mut self, track: usize, image: usize, keypoint: u32) -> usize {
        let slot = self.tracks[track].sightings.len() as u32;
        let sighting = Sighting { image: image as u32, keypoint, active: true };
        self.tracks[track].sightings.push(sighting);
        self.image_tracks[image].push((track as u32, slot));
        1
    }

    /// Takes a sighting out of one track and makes it an active one of another. Returns 1, the
    /// number of sightings that joined.
    pub(crate) fn move_sighting(&mut self, from: usize, slot: usize, to: usize) -> usize {
        let sightings = &mut self.tracks[from].sightings;
        let taken = sightings.swap_remove(slot);
        let (last, filler) = (sightings.len(), sightings.get(slot).copied());
        let image = taken.image as usize;
        self.image_tracks[image].retain(|&entry| entry != (from as u32, slot as u32));
        if let Some(filler) = filler {
            for entry in &mut self.image_tracks[filler.image as usize] {
                if *entry == (from as u32, last as u32) {
                    entry.1 = slot as u32;
                }
            }
        }
        self.add_sighting(to, image, taken.keypoint)
    }

    /// Brings the rays up to date with the intrinsics.
    pub(crate) fn update_rays(&mut self) {
        for index in 0..self.input.images.len() {
            let camera = self.camera_index(index);
            if self.cameras[camera] != self.ray_cameras[camera] {
                self.unproject(index);
            }
        }
        self.ray_cameras.clone_from(&self.cameras);
    }

    fn unproject(&mut self, index: usize) {
        let image = &self.input.images[index];
        let camera = self.cameras[image.camera.0 as usize];
        self.rays[index] = image.keypoints.iter().map(|pixel| camera.unproject(pixel)).collect();
    }

    pub(crate) fn num_images(&self) -> usize {
        self.poses.len()
    }

    pub(crate) fn camera_index(&self, image: usize) -> usize {
        self.input.images[image].camera.0 as usize
    }

    pub(crate) fn camera(&self, image: usize) -> &Camera {
        &self.cameras[self.camera_index(image)]
    }

    pub(crate) fn pixel(&self, sighting: &Sighting) -> Point2<f64> {
        self.input.images[sighting.image as usize].keypoints[sighting.keypoint as usize]
    }

    /// Images with a pose, ascending.
    pub(crate) fn registered(&self) -> Vec<usize> {
        (0..self.poses.len()).filter(|&i| self.poses[i].is_some()).collect()
    }

    pub(crate) fn num_registered(&self) -> usize {
        self.poses.iter().flatten().count()
    }

    pub(crate) fn num_points(&self) -> usize {
        self.tracks.iter().filter(|track| track.position.is_some()).count()
    }

    /// The sighting as a ray of a posed image.
    pub(crate) fn view(&self, sighting: &Sighting) -> Option<View> {
        let image = sighting.image as usize;
        let pose = self.poses[image]?;
        let xy = self.rays[image][sighting.keypoint as usize]?;
        Some(View::new(pose, xy, self.camera(image).mean_focal()))
    }

    /// Reprojection error, pixels; infinite behind the camera or without a pose.
    pub(crate) fn reprojection_error(&self, sighting: &Sighting, point: &Point3<f64>) -> f64 {
        let image = sighting.image as usize;
        let Some(pose) = self.poses[image] else { return f64::INFINITY };
        match self.camera(image).project(&(pose * point)) {
            Some(projected) => (projected - self.pixel(sighting)).norm(),
            None => f64::INFINITY,
        }
    }

    /// Median error, pixels, of the sightings of points that three images see (two hardly
    /// contradict each other): the scale of the Cauchy distribution that such errors follow.
    /// `None` without any.
    pub(crate) fn median_error_px(&self) -> Option<f64> {
        let mut errors = Vec::new();
        for track in self.tracks.iter().filter(|track| track.num_active() >= 3) {
            let Some(point) = track.position else { continue };
            let active = track.sightings.iter().filter(|s| s.active);
            errors.extend(active.map(|s| self.reprojection_error(s, &point)));
        }
        median(&mut errors)
    }

    /// Whether the active sightings of a track see `point` under the least angle.
    pub(crate) fn is_well_seen(&self, track: &Track, point: &Point3<f64>, min_angle: f64) -> bool {
        let centers: Vec<Point3<f64>> = track
            .sightings
            .iter()
            .filter(|s| s.active)
            .filter_map(|s| self.poses[s.image as usize].as_ref().map(camera_center))
            .collect();
        has_angle(&centers, point, min_angle)
    }

    /// Number of points an image takes part in.
    pub(crate) fn num_image_points(&self, image: usize) -> usize {
        self.image_tracks[image]
            .iter()
            .filter(|&&(track, slot)| {
                let track = &self.tracks[track as usize];
                track.position.is_some() && track.sightings[slot as usize].active
            })
            .count()
    }

    /// Takes the pose of an image away and its sightings out of their points.
    pub(crate) fn remove_image(&mut self, image: usize) {
        self.poses[image] = None;
        for &(track, slot) in &self.image_tracks[image] {
            let track = &mut self.tracks[track as usize];
            track.sightings[slot as usize].active = false;
            if track.position.is_some() && track.num_active() < 2 {
                track.clear();
            }
        }
    }

    /// Loads the poses and intrinsics of a model; points are left to triangulation.
    pub(crate) fn load(&mut self, model: &SparseModel) {
        for (id, camera) in &model.cameras {
            if let Some(mine) = self.cameras.get_mut(id.0 as usize) {
                *mine = *camera;
            }
        }
        self.update_rays();
        for (id, image) in &model.images {
            if let Some(pose) = self.poses.get_mut(id.0 as usize) {
                *pose = Some(image.cam_from_world);
            }
        }
    }

    /// The model as others see it.
    pub(crate) fn to_sparse(&self) -> SparseModel {
        let mut cameras = BTreeMap::new();
        let mut images = BTreeMap::new();
        for index in self.registered() {
            let image = &self.input.images[index];
            cameras.insert(image.camera, *self.camera(index));
            let Some(cam_from_world) = self.poses[index] else { continue };
            images.insert(
                ImageId(index as u32),
                RegisteredImage {
                    name: image.name.clone(),
                    camera: CameraId(image.camera.0),
                    cam_from_world,
                    keypoints: image.keypoints.clone(),
                    points: vec![None; image.keypoints.len()],
                },
            );
        }
        let mut points = BTreeMap::new();
        for track in &self.tracks {
            let Some(position) = track.position else { continue };
            let id = PointId(points.len() as u64);
            let seen: Vec<&Sighting> = track.sightings.iter().filter(|s| s.active).collect();
            if seen.len() < 2 {
                continue;
            }
            let n = seen.len() as f64;
            let error_px =
                seen.iter().map(|s| self.reprojection_error(s, &position)).sum::<f64>() / n;
            for s in &seen {
                if let Some(image) = images.get_mut(&ImageId(s.image)) {
                    image.points[s.keypoint as usize] = Some(id);
                }
            }
            let track = seen
                .iter()
                .map(|s| Observation { image: ImageId(s.image), keypoint: s.keypoint })
                .collect();
            points.insert(id, Point3d { position, color: self.mean_color(&seen), error_px, track });
        }
        SparseModel { cameras, images, points }
    }

    fn mean_color(&self, seen: &[&Sighting]) -> [u8; 3] {
        let mut sum = [0u32; 3];
        let mut n = 0;
        for s in seen {
            let colors = &self.input.images[s.image as usize].colors;
            if let Some(color) = colors.get(s.keypoint as usize) {
                n += 1;
                for (sum, &c) in sum.iter_mut().zip(color) {
                    *sum += u32::from(c);
                }
            }
        }
        sum.map(|sum| (sum + n / 2).checked_div(n).map_or(128, |mean| mean as u8))
    }
}
