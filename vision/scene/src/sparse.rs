//! The result of structure from motion.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Point2, Point3};
use serde::{Deserialize, Serialize};
use volery_geometry::Camera;

use crate::{CameraId, ImageId, PointId};

/// One sighting of a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Observation {
    /// Which image.
    pub image: ImageId,
    /// Index of the keypoint in that image.
    pub keypoint: u32,
}

/// A point seen in many images.
#[derive(Debug, Clone, PartialEq)]
pub struct Point3d {
    /// In the frame of the model.
    pub position: Point3<f64>,
    /// sRGB.
    pub color: [u8; 3],
    /// Mean reprojection error over the track, pixels.
    pub error_px: f64,
    /// Its sightings, sorted.
    pub track: Vec<Observation>,
}

/// An image with a pose.
#[derive(Debug, Clone, PartialEq)]
pub struct RegisteredImage {
    /// File name as given.
    pub name: String,
    /// Intrinsics.
    pub camera: CameraId,
    /// Pose.
    pub cam_from_world: Isometry3<f64>,
    /// All keypoints, pixels; observations index into them.
    pub keypoints: Vec<Point2<f64>>,
    /// Which point a keypoint sees; as long as `keypoints`.
    pub points: Vec<Option<PointId>>,
}

/// Cameras, posed images and points in one frame.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SparseModel {
    /// Intrinsics.
    pub cameras: BTreeMap<CameraId, Camera>,
    /// Posed images.
    pub images: BTreeMap<ImageId, RegisteredImage>,
    /// Points.
    pub points: BTreeMap<PointId, Point3d>,
}

impl SparseModel {
    /// Observations over all points.
    pub fn num_observations(&self) -> usize {
        self.points.values().map(|point| point.track.len()).sum()
    }

    /// Mean of the per-observation reprojection errors, pixels; `None` without observations.
    pub fn mean_reprojection_error_px(&self) -> Option<f64> {
        let num_observations = self.num_observations();
        let sum: f64 = self.points.values().map(|p| p.error_px * p.track.len() as f64).sum();
        (num_observations > 0).then(|| sum / num_observations as f64)
    }

    /// Adds an image; the points that its keypoints see are seen by it from now on. Of points that
    /// are not there, and of a point that another keypoint sees already, it keeps nothing.
    pub fn add_image(&mut self, mut image: RegisteredImage) -> ImageId {
        let id = ImageId(self.images.keys().next_back().map_or(0, |last| last.0 + 1));
        for (keypoint, slot) in (0_u32..).zip(&mut image.points) {
            let point = slot.and_then(|point| self.points.get_mut(&point));
            let observation = Observation { image: id, keypoint };
            match point.filter(|point| point.track.iter().all(|o| o.image != id)) {
                Some(point) => {
                    let at = point.track.partition_point(|o| *o < observation);
                    point.track.insert(at, observation);
                }
                None => *slot = None,
            }
        }
        self.images.insert(id, image);
        id
    }

    /// Removes an image and its sightings; points that less than two others see go, too.
    pub fn remove_image(&mut self, image: ImageId) {
        let Some(removed) = self.images.remove(&image) else { return };
        for id in removed.points.into_iter().flatten() {
            let Some(point) = self.points.get_mut(&id) else { continue };
            point.track.retain(|o| o.image != image);
            if point.track.len() >= 2 {
                continue;
            }
            for o in self.points.remove(&id).into_iter().flat_map(|point| point.track) {
                let slot = self.images.get_mut(&o.image);
                if let Some(slot) = slot.and_then(|i| i.points.get_mut(o.keypoint as usize)) {
                    *slot = None;
                }
            }
        }
    }

    /// Moves the whole model: `x_in_target = target_from_world * x`.
    pub fn transform(&mut self, target_from_world: &nalgebra::Similarity3<f64>) {
        let rotation = target_from_world.isometry.rotation;
        for point in self.points.values_mut() {
            point.position = target_from_world * point.position;
        }
        for image in self.images.values_mut() {
            let center = target_from_world * image.center();
            let cam_from_target = image.cam_from_world.rotation * rotation.inverse();
            let translation = -(cam_from_target * center.coords);
            image.cam_from_world = Isometry3::from_parts(translation.into(), cam_from_target);
        }
    }
}

impl RegisteredImage {
    /// Camera center in the frame of the model.
    pub fn center(&self) -> Point3<f64> {
        volery_geometry::triangulation::camera_center(&self.cam_from_world)
    }
}

/// Why an image has no pose. The names are stable codes of the API.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum UnplacedReason {
    /// The bytes could not be decoded.
    Undecodable,
    /// Fewer features than any pose needs.
    TooFewFeatures,
    /// Too blurred to yield features.
    Blurred,
    /// No other image shows enough of the same.
    NoOverlap,
    /// It only turned: it matches, but nothing gives it a position.
    NoParallax,
    /// Its matches fit no single pose.
    Ambiguous,
    /// It has a pose in a smaller, unconnected part.
    OtherZone,
    /// The map is made at given poses, and it was given none.
    NoGivenPose,
}

impl UnplacedReason {
    /// The stable code.
    pub fn code(self) -> &'static str {
        match self {
            Self::Undecodable => "undecodable",
            Self::TooFewFeatures => "too_few_features",
            Self::Blurred => "blurred",
            Self::NoOverlap => "no_overlap",
            Self::NoParallax => "no_parallax",
            Self::Ambiguous => "ambiguous",
            Self::OtherZone => "other_zone",
            Self::NoGivenPose => "no_given_pose",
        }
    }
}

/// An image without a pose, and why.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct UnplacedImage {
    /// Which image.
    pub image: ImageId,
    /// Why.
    pub reason: UnplacedReason,
}
