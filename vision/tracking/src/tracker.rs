//! From frames to poses and states.

mod answer;
mod catch_up;
mod work;

use std::sync::Arc;
use std::time::Duration;

use nalgebra::Isometry3;
use volery_geometry::{Camera, SimdLevel};
use volery_localization::{
    LocalizationIndex, LocalizationPrior, LocalizeOptions, PoseEstimate, SeenPose, StepTimings,
    localize_features, pose_from_points,
};
use volery_scene::GrayImage;

pub use self::answer::{
    PoseSource, TrackAnswer, TrackProblem, TrackState, TrackTimings, TrackedPose,
};
use self::catch_up::Behind;
use self::work::{Measured, Work, is_same, seen_pose};
use crate::follow::{Anchor, Followed, anchored, follow};
use crate::frame_check::{FrameCheck, FrameFault};
use crate::motion::{Motion, MotionLimits, Telemetry};
use crate::pyramid::Pyramid;
use crate::relocation::Candidates;

/// The first octave in which to look for features quickly: at 320x240, a quarter of the time and of
/// the features.
const QUICK: i32 = 0;
/// Images are doubled to find all features up to this size, pixels.
const SMALL: u32 = 400;
/// Points are followed as long as they were recognized not longer ago.
const FOLLOW: Duration = Duration::from_millis(2500);
/// Time without a pose after which a camera is lost.
const LOST: Duration = Duration::from_secs(1);
/// Time without a pose after which nothing of what was known before counts.
const FORGET: Duration = Duration::from_secs(3);
/// Least part of the followed points in view that must agree with a pose.
const MIN_AGREEING: f64 = 0.35;
/// Greatest deviation of a predicted position and rotation that a single fix may confirm, map
/// units and radians: beyond it, a wrong one may agree by chance.
const MAX_CONFIRMED: f64 = 0.5;
const MAX_CONFIRMED_TURN: f64 = 0.3;
/// Options of a [`Tracker`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TrackerOptions {
    /// How hard the drone moves.
    pub limits: MotionLimits,
    /// How a frame is compared with the map.
    pub localize: LocalizeOptions,
}

/// A frame of a flight.
#[derive(Debug, Clone, Copy)]
pub struct Frame<'a> {
    /// Of the tracker's camera.
    pub image: &'a GrayImage,
    /// Since any start, the same for all frames.
    pub capture_time: Duration,
    /// Reported at that time.
    pub telemetry: Telemetry,
}

/// Follows one camera through one map.
pub struct Tracker {
    camera: Camera,
    options: TrackerOptions,
    simd: SimdLevel,
    check: FrameCheck,
    motion: Option<Motion>,
    followed: Vec<Followed>,
    candidates: Candidates,
    /// The whole map speaks for another place.
    is_contradicted: bool,
    last_frame: Option<(Duration, GrayImage)>,
    last_pose: Option<Duration>,
    /// Of the search that goes on, or of the first frame.
    searching_since: Option<Duration>,
    last_refresh: Duration,
    last_recognized: Duration,
    last_check: Duration,
    /// The last frame, if its pose rests on points that were followed.
    behind: Option<Behind>,
    reset_counter: u32,
}

impl Tracker {
    /// Knows nothing yet.
    pub fn new(camera: &Camera, options: &TrackerOptions) -> Self {
        Self {
            camera: *camera,
            options: *options,
            simd: SimdLevel::detect(),
            check: FrameCheck::default(),
            motion: None,
            followed: Vec::new(),
            candidates: Candidates::default(),
            is_contradicted: false,
            last_frame: None,
            last_pose: None,
            searching_since: None,
            last_refresh: Duration::ZERO,
            last_recognized: Duration::ZERO,
            last_check: Duration::ZERO,
            behind: None,
            reset_counter: 0,
        }
    }

    /// The pose of the next frame in the map of `index`, which must be the same for all frames.
    /// Deterministic. `clock` gives seconds from any start, for the timings. What can wait is left
    /// to [`Self::catch_up`].
    pub fn track(
        &mut self,
        frame: &Frame<'_>,
        index: &LocalizationIndex,
        clock: &dyn Fn() -> f64,
    ) -> TrackAnswer {
        let start = clock();
        let Frame { image, capture_time: time, telemetry } = *frame;
        let mut timings = TrackTimings::default();
        self.behind = None;
        let (pyramid, fault) = match self.arrive(image, time) {
            Ok(checked) => checked,
            Err(fault) => {
                timings.track_ms = (clock() - start) * 1e3;
                return self.without_pose(time, Some(fault), TrackProblem::Frame, timings);
            }
        };
        if let Some(motion) = &mut self.motion {
            motion.report(&telemetry);
        }
        let mut work = Work { image, time, pyramid, index, clock, features: None, timings };
        let outcome = match fault {
            Some(fault) if fault.is_fatal() => Err(TrackProblem::Frame),
            _ => self.measure(&mut work),
        };
        let mut timings = work.timings;
        let answer = match outcome {
            Ok(measured) => self.accept(&work, measured, fault),
            Err(problem) => self.without_pose(time, fault, problem, timings),
        };
        // What is left of the whole.
        timings.track_ms = (clock() - start) * 1e3 - timings.sum_ms();
        TrackAnswer { timings, ..answer }
    }

    /// Checks a frame and moves the time on to it.
    fn arrive(
        &mut self,
        image: &GrayImage,
        time: Duration,
    ) -> Result<(Arc<Pyramid>, Option<FrameFault>), FrameFault> {
        if (image.width(), image.height()) != (self.camera.width, self.camera.height) {
            return Err(FrameFault::WrongSize);
        }
        let elapsed = match &self.last_frame {
            None => Duration::ZERO,
            Some((last, _)) if time <= *last => return Err(FrameFault::OutOfOrder),
            Some((last, _)) => time - *last,
        };
        if let Some(motion) = &mut self.motion {
            motion.predict(elapsed.as_secs_f64());
        }
        if self.last_pose.is_some_and(|last| time - last > FORGET) {
            self.motion = None;
            self.followed.clear();
        }
        let before = self.last_frame.replace((time, image.clone()));
        if before.is_some_and(|(_, before)| before == *image) {
            return Err(FrameFault::Frozen);
        }
        let pyramid = Pyramid::new(image);
        let fault = self.check.judge(&pyramid);
        Ok((Arc::new(pyramid), fault))
    }

    /// The pose of a frame, if it is believed.
    fn measure(&mut self, work: &mut Work<'_>) -> Result<Measured, TrackProblem> {
        let Some(followed) = self.follow(work) else { return self.search(work) };
        let mut measured = Measured::followed(followed);
        if self.is_contradicted {
            self.check_place(work, &mut measured);
        }
        if self.is_contradicted { Err(TrackProblem::Contradicted) } else { Ok(measured) }
    }

    /// Asks the whole map whether a pose is right; where three frames say that it is not, theirs
    /// takes its place.
    fn check_place(&mut self, work: &mut Work<'_>, measured: &mut Measured) {
        self.last_check = work.time;
        let octave = if self.is_contradicted { self.thorough() } else { QUICK };
        // Not recognized is no contradiction.
        let Some(found) = self.ask_map(work, octave) else { return };
        self.is_contradicted = !is_same(&found.estimate, &measured.pose.estimate);
        if !self.is_contradicted {
            self.candidates.clear();
            self.join(work, measured, found);
        } else if self.candidates.add(work.time, &found.estimate, &self.options.limits) {
            self.relocate(&found.estimate);
            *measured = Measured::recognized(found);
        }
    }

    /// The first octave in which to look for all features: small images are doubled.
    fn thorough(&self) -> i32 {
        if self.camera.width.max(self.camera.height) <= SMALL { -1 } else { QUICK }
    }

    /// The pose by the points that were seen before.
    fn follow(&self, work: &mut Work<'_>) -> Option<SeenPose> {
        let motion = self.motion.as_ref()?;
        let predicted = motion.map_from_camera().inverse();
        let found = follow(&self.followed, &work.pyramid, &self.camera, &predicted, self.simd);
        let (seen, tried) = (&found.seen, found.num_tried);
        let pose = pose_from_points(seen, tried, &self.camera, work.index, &predicted).ok()?;
        let is_supported = pose.estimate.inlier_ratio() > MIN_AGREEING;
        (is_supported && motion.admits(&pose.estimate)).then_some(pose)
    }

    /// The pose by the whole map, without regard to what was before.
    fn ask_map(&self, work: &mut Work<'_>, first_octave: i32) -> Option<SeenPose> {
        let options = &self.options.localize;
        let features = &*work.detect(options, first_octave);
        let mut steps = StepTimings::default();
        let prior = LocalizationPrior::default();
        let camera = &self.camera;
        let answer = localize_features(
            features, camera, work.index, &prior, options, work.clock, &mut steps,
        );
        work.timings.match_ms += steps.match_ms;
        work.timings.solve_ms += steps.solve_ms;
        seen_pose(answer.status, features)
    }

    /// A pose out of the whole map: believed at once if it lies where the camera should be, else
    /// when three agree.
    fn search(&mut self, work: &mut Work<'_>) -> Result<Measured, TrackProblem> {
        let found = self.ask_map(work, self.thorough()).ok_or(TrackProblem::NotFound)?;
        let is_expected = self.motion.as_ref().is_some_and(|motion| {
            motion.is_certain(MAX_CONFIRMED, MAX_CONFIRMED_TURN) && motion.admits(&found.estimate)
        });
        if !is_expected {
            if !self.candidates.add(work.time, &found.estimate, &self.options.limits) {
                return Err(TrackProblem::Unconfirmed);
            }
            self.relocate(&found.estimate);
        }
        (self.last_check, self.last_refresh) = (work.time, work.time);
        Ok(Measured::recognized(found))
    }

    /// Begins anew at a pose.
    fn relocate(&mut self, estimate: &PoseEstimate) {
        if self.last_pose.is_some() {
            self.reset_counter += 1;
        }
        self.is_contradicted = false;
        self.followed.clear();
        self.motion = None;
        let PoseEstimate { map_from_camera, covariance, .. } = estimate;
        self.motion = Some(Motion::at(map_from_camera, covariance, self.options.limits));
    }

    /// Takes in a pose that is believed.
    fn accept(
        &mut self,
        work: &Work<'_>,
        measured: Measured,
        fault: Option<FrameFault>,
    ) -> TrackAnswer {
        let Measured { pose: SeenPose { estimate, .. }, source, .. } = &measured;
        let PoseEstimate { map_from_camera, covariance, .. } = estimate;
        let limits = self.options.limits;
        let motion =
            self.motion.get_or_insert_with(|| Motion::at(map_from_camera, covariance, limits));
        motion.measure(map_from_camera, covariance);
        let fused = motion.covariance();
        let is_fused = fused.trace() < 0.5 * covariance.trace();
        let pose = TrackedPose {
            map_from_camera: motion.map_from_camera(),
            covariance: fused,
            source: if is_fused { PoseSource::Fused } else { *source },
            num_points: estimate.num_inliers,
            inlier_ratio: estimate.inlier_ratio(),
            reprojection_px: estimate.reprojection_px,
        };
        if *source == PoseSource::Pnp {
            self.anchor(work, &measured);
        } else {
            let (pyramid, has_fault) = (Arc::clone(&work.pyramid), fault.is_some());
            let pose = measured.pose;
            self.behind = Some(Behind { time: work.time, pyramid, pose, has_fault });
        }
        self.candidates.clear();
        self.last_pose = Some(work.time);
        self.searching_since = None;
        TrackAnswer {
            state: TrackState::Tracking,
            pose: Some(pose),
            fault,
            problem: None,
            since_pose: Some(Duration::ZERO),
            reset_counter: self.reset_counter,
            timings: work.timings,
        }
    }

    /// Points are followed from a frame in which some were recognized.
    fn anchor(&mut self, work: &Work<'_>, measured: &Measured) {
        self.last_recognized = work.time;
        let cam_from_map: Isometry3<f64> = measured.pose.estimate.map_from_camera.inverse();
        let anchor = Anchor { pyramid: Arc::clone(&work.pyramid), cam_from_map, time: work.time };
        let since = work.time.saturating_sub(FOLLOW);
        let (recognized, seen) = (&measured.recognized, &measured.pose.seen);
        self.followed =
            anchored(&Arc::new(anchor), recognized, work.index, &self.followed, seen, since);
    }

    fn without_pose(
        &mut self,
        time: Duration,
        fault: Option<FrameFault>,
        problem: TrackProblem,
        timings: TrackTimings,
    ) -> TrackAnswer {
        let since = *self.searching_since.get_or_insert(self.last_pose.unwrap_or(time));
        let is_lost = time.saturating_sub(since) >= LOST && self.candidates.is_empty();
        TrackAnswer {
            state: if is_lost { TrackState::Lost } else { TrackState::Relocalizing },
            pose: None,
            fault,
            problem: Some(problem),
            since_pose: self.last_pose.map(|last| time.saturating_sub(last)),
            reset_counter: self.reset_counter,
            timings,
        }
    }
}
