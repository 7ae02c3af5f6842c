//! What can wait until the answer to a frame has left.

use std::sync::Arc;
use std::time::Duration;

use volery_localization::{
    LocalizationIndex, SeenPoint, SeenPose, localize_near, pose_from_points,
};

use super::answer::{PoseSource, TrackTimings};
use super::work::{Measured, Work, seen_pose};
use super::{QUICK, Tracker};
use crate::pyramid::Pyramid;

/// Points are recognized anew after this time, so that none is followed far.
const REFRESH: Duration = Duration::from_millis(500);
/// The whole map is asked after this time, so that nobody is sure of the wrong place for long.
const CHECK: Duration = Duration::from_secs(2);
/// Both may wait so many times as long for who is in a hurry.
const PATIENCE: u32 = 2;
/// With few points it is tried again after this time.
const RETRY: Duration = Duration::from_millis(200);
/// Nothing was recognized for so long that it may take its time.
const URGENT: Duration = Duration::from_secs(1);
/// Fewest points of a pose that is not refreshed at once.
const FEW_POINTS: usize = 30;

/// A frame whose points may be recognized anew, for those that come after it.
pub(super) struct Behind {
    pub(super) time: Duration,
    pub(super) pyramid: Arc<Pyramid>,
    pub(super) pose: SeenPose,
    pub(super) has_fault: bool,
}

impl Tracker {
    /// Recognizes points in the last frame where that is due, so that those to come can be followed
    /// from it, and asks the whole map now and then whether it is the right place. To be called after
    /// every frame, when its answer has left; `is_hurried` where others wait, puts off what can be.
    /// Deterministic, as is the next pose then.
    pub fn catch_up(&mut self, index: &LocalizationIndex, is_hurried: bool) {
        let Some(Behind { time, pyramid, pose, has_fault }) = self.behind.take() else { return };
        let Some((_, image)) = self.last_frame.take() else { return };
        let num_inliers = pose.estimate.num_inliers;
        let patience = if is_hurried { PATIENCE } else { 1 };
        let is_due = |last: Duration, period: Duration| time.saturating_sub(last) >= period;
        let is_weak = num_inliers < FEW_POINTS && is_due(self.last_refresh, RETRY);
        let is_old = !has_fault && is_due(self.last_refresh, REFRESH * patience);
        let is_checked = !has_fault && is_due(self.last_check, CHECK * patience);
        // Nobody asks how long it takes.
        let (clock, timings) = (&|| 0.0, TrackTimings::default());
        let mut work = Work { image: &image, time, pyramid, index, clock, features: None, timings };
        let mut measured = Measured::followed(pose);
        if is_checked {
            self.check_place(&mut work, &mut measured);
        } else if is_weak || is_old {
            let is_urgent = is_weak || is_due(self.last_recognized, URGENT);
            self.last_refresh = time;
            let found = self.recognize(&mut work, &measured.pose, QUICK);
            let found = match found {
                None if is_urgent => self.recognize(&mut work, &measured.pose, self.thorough()),
                found => found,
            };
            if let Some(recognized) = found {
                self.join(&work, &mut measured, recognized);
            }
        }
        if measured.source == PoseSource::Pnp && !self.is_contradicted {
            self.anchor(&work, &measured);
        }
        self.last_frame = Some((time, image));
    }

    /// The pose by features of the map near a pose.
    fn recognize(
        &self,
        work: &mut Work<'_>,
        near: &SeenPose,
        first_octave: i32,
    ) -> Option<SeenPose> {
        let motion = self.motion.as_ref()?;
        let features = &*work.detect(&self.options.localize, first_octave);
        let pose = near.estimate.map_from_camera.inverse();
        let status = localize_near(features, &self.camera, work.index, &pose, &near.seen);
        seen_pose(status, features).filter(|pose| motion.admits(&pose.estimate))
    }

    /// The pose by the points that were followed and those that were recognized.
    pub(super) fn join(&self, work: &Work<'_>, measured: &mut Measured, found: SeenPose) {
        let followed = &measured.pose.seen;
        let is_new = |seen: &&SeenPoint| followed.iter().all(|f| f.point != seen.point);
        let new = found.seen.iter().filter(is_new);
        let all: Vec<SeenPoint> = followed.iter().chain(new).copied().collect();
        let initial = measured.pose.estimate.map_from_camera.inverse();
        let joined = pose_from_points(&all, all.len(), &self.camera, work.index, &initial);
        *measured = Measured {
            recognized: found.seen.clone(),
            pose: joined.unwrap_or(found),
            source: PoseSource::Pnp,
        };
    }
}
