//! Where drones are, by whoever knows: to their estimators.

use std::time::Instant;

use volery_api::{DronePose, FramePlace, Localization, TrackedFrame};
use volery_flight::{PoseRefusal, VehicleId};

use super::{service::Drones, wire};
use crate::clock;

impl Drones {
    /// Sends a pose to a drone's estimator, if it can be true.
    pub(crate) fn pose(&self, id: u8, pose: &DronePose) -> Result<(), PoseRefusal> {
        self.shared.relay(|state, now| {
            let fix = wire::pose_fix(pose, now).ok_or(PoseRefusal::NotFinite)?;
            state.fleet.pose(VehicleId(id), fix, now)
        })
    }

    /// Sends the pose that a frame of a drone's camera gave to its estimator, if it can be true. A
    /// frame without a pose says nothing.
    pub(crate) fn camera_pose(
        &self,
        id: u8,
        captured: Instant,
        frame: &TrackedFrame,
    ) -> Result<(), PoseRefusal> {
        let Some(pose) = &frame.pose else { return Ok(()) };
        let captured = captured.saturating_duration_since(self.shared.start);
        self.shared.relay(|state, now| {
            let mount = state.registered.get(&id).map(|drone| drone.body_from_camera);
            let covariance = frame.covariance.as_deref();
            let fix = wire::camera_fix(pose, covariance, mount, captured, frame.reset_counter)
                .ok_or(PoseRefusal::NotFinite)?;
            state.fleet.pose(VehicleId(id), fix, now)
        })
    }

    /// What one frame says of the drone's place; sent to its estimator if it can be true.
    pub(crate) fn frame(
        &self,
        id: u8,
        captured: Instant,
        frame: &Localization,
        is_metric: bool,
    ) -> Option<FramePlace> {
        let pose = frame.pose.as_ref()?;
        let captured = captured.saturating_duration_since(self.shared.start);
        self.shared.relay(|state, now| {
            let mount = state.registered.get(&id).map(|drone| drone.body_from_camera);
            // One frame alone gives up no place.
            let last = state.fleet.vehicle(VehicleId(id)).and_then(|vehicle| vehicle.last_pose());
            let resets = last.map_or(0, |last| last.resets);
            let covariance = frame.covariance.as_deref();
            let fix = wire::camera_fix(pose, covariance, mount, captured, resets)?;
            let vehicle = state.fleet.vehicle(VehicleId(id));
            let here = vehicle.and_then(|vehicle| vehicle.here());
            let told = vehicle.and_then(|vehicle| vehicle.setpoint());
            let goal = state.flights.goal(VehicleId(id)).or(told.map(|told| told.position));
            let sent = if is_metric {
                let sent = state.fleet.pose(VehicleId(id), fix, now);
                sent.map_err(|refusal| refusal.to_string())
            } else {
                Err("the map is not metric".to_owned())
            };
            let place = wire::frame_place(&fix, here, goal, sent);
            state.flights.note_frame(VehicleId(id), clock::now_ns(), &place);
            Some(place)
        })
    }
}
