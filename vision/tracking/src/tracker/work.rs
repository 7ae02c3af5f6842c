//! A frame while it is looked at, and what comes of it.

use std::sync::Arc;
use std::time::Duration;

use nalgebra::Vector6;
use volery_features::{SiftOptions, detect_and_describe};
use volery_localization::{
    LocalizationIndex, LocalizeOptions, PoseEstimate, SeenPoint, SeenPose, Status,
};
use volery_scene::{Features, GrayImage};

use super::answer::{PoseSource, TrackTimings};
use crate::motion::GATE_6;
use crate::pyramid::Pyramid;

/// Two poses of one frame are the same within this distance and angle, whatever their covariances
/// say of errors that they share.
const SAME_PLACE: f64 = 0.05;
const SAME_TURN: f64 = 0.017;

/// A frame at work.
pub(super) struct Work<'a> {
    pub(super) image: &'a GrayImage,
    pub(super) time: Duration,
    pub(super) pyramid: Arc<Pyramid>,
    pub(super) index: &'a LocalizationIndex,
    pub(super) clock: &'a dyn Fn() -> f64,
    /// With the octave from which on they were looked for.
    pub(super) features: Option<(i32, Arc<Features>)>,
    pub(super) timings: TrackTimings,
}

/// A pose of a frame by that frame.
pub(super) struct Measured {
    pub(super) pose: SeenPose,
    pub(super) source: PoseSource,
    /// Points recognized in this frame.
    pub(super) recognized: Vec<SeenPoint>,
}

impl Measured {
    pub(super) fn followed(pose: SeenPose) -> Self {
        Self { pose, source: PoseSource::Klt, recognized: Vec::new() }
    }

    pub(super) fn recognized(pose: SeenPose) -> Self {
        let recognized = pose.seen.clone();
        Self { pose, source: PoseSource::Pnp, recognized }
    }
}

/// A localization by features, with its points.
pub(super) fn seen_pose(status: Status, features: &Features) -> Option<SeenPose> {
    let Status::Ok(estimate) = status else { return None };
    let seen = estimate.sightings.iter().filter_map(|s| SeenPoint::of_feature(features, s));
    Some(SeenPose { seen: seen.collect(), estimate })
}

impl Work<'_> {
    /// Features of the image; those that are at hand if they are fine enough.
    pub(super) fn detect(&mut self, options: &LocalizeOptions, first_octave: i32) -> Arc<Features> {
        if let Some((_, features)) = self.features.as_ref().filter(|(o, _)| *o <= first_octave) {
            return Arc::clone(features);
        }
        let start = (self.clock)();
        let max_features = options.max_features;
        let sift = SiftOptions { max_features, first_octave, ..SiftOptions::default() };
        let features = Arc::new(detect_and_describe(self.image, &sift));
        self.features = Some((first_octave, Arc::clone(&features)));
        self.timings.features_ms += ((self.clock)() - start) * 1e3;
        features
    }
}

/// Whether two poses of one frame are one.
pub(super) fn is_same(a: &PoseEstimate, b: &PoseEstimate) -> bool {
    let shift = a.map_from_camera.translation.vector - b.map_from_camera.translation.vector;
    let turn = (a.map_from_camera.rotation * b.map_from_camera.rotation.inverse()).scaled_axis();
    if shift.norm() < SAME_PLACE && turn.norm() < SAME_TURN {
        return true;
    }
    let y = Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z);
    let spread = a.covariance + b.covariance;
    // False for NaN.
    spread.cholesky().is_some_and(|c| y.dot(&c.solve(&y)) < GATE_6)
}
