//! True states and events as lines.

use std::time::Duration;

use nalgebra::Isometry3;
use serde::Serialize;
use volery_client::api::CameraPose;

use crate::{Closest, Drone, Event, Mode, World};

/// A line of the log.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Line {
    /// How a drone is.
    State(Box<State>),
    /// What happened to it.
    Event {
        /// Seconds.
        t: f64,
        /// Drone.
        system_id: u8,
        /// What.
        #[serde(flatten)]
        event: Event,
    },
    /// Where its pictures are served.
    Camera {
        /// Drone.
        system_id: u8,
        /// Motion JPEG over HTTP.
        camera_url: String,
    },
    /// What the server said of a picture, or why it cannot be told.
    Frame {
        /// Seconds.
        t: f64,
        /// Drone.
        system_id: u8,
        /// `ok`, `not_found`, `ambiguous`, `tracking`, `relocalizing`, `lost`, `dropped` or an error.
        frame: String,
        /// Where it was placed.
        #[serde(flatten, skip_serializing_if = "Option::is_none")]
        placed: Option<Box<Placed>>,
    },
}

/// Where a camera was when it took a picture, and where the server says that it was.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Placed {
    /// When it was taken, seconds.
    pub taken: f64,
    /// `world_from_camera`.
    pub truth: CameraPose,
    /// `map_from_camera`.
    pub pose: CameraPose,
    /// From the arrival at the server to its answer, milliseconds.
    pub server_ms: f64,
}

/// True state of a drone beside what it believes. World: z up; the estimate is in the drone's
/// local frame, z down.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct State {
    /// Seconds.
    pub t: f64,
    /// Drone.
    pub system_id: u8,
    /// Feet, meters.
    pub position: [f64; 3],
    /// m/s.
    pub velocity: [f64; 3],
    /// Counter-clockwise from the world's x axis, radians.
    pub yaw: f64,
    /// Local, z down, meters.
    pub estimate: [f64; 3],
    /// Clockwise from the local x axis, radians.
    pub estimated_yaw: f64,
    /// Who steers.
    pub mode: Mode,
    /// Motors run.
    pub armed: bool,
    /// In the air.
    pub flying: bool,
    /// What it acts against by itself.
    pub failsafe: Option<&'static str>,
    /// Percent.
    pub battery: f64,
    /// Poses taken so far.
    pub poses: u64,
}

/// The run in figures.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Summary {
    /// Drones.
    pub drones: usize,
    /// Seconds.
    pub seconds: f64,
    /// Smallest distance of two flying drones, meters.
    pub min_separation_m: Option<f64>,
    /// Who they were.
    pub closest_pair: Option<[u8; 2]>,
    /// Walls, things, drones and floors that were hit.
    pub contacts: u32,
}

impl Line {
    pub(super) fn event(time: Duration, system_id: u8, event: Event) -> Self {
        Self::Event { t: rounded(time.as_secs_f64()), system_id, event }
    }

    pub(super) fn state(time: Duration, drone: &Drone) -> Self {
        let (body, estimator) = (drone.body(), drone.estimator());
        Self::State(Box::new(State {
            t: rounded(time.as_secs_f64()),
            system_id: drone.options().system_id,
            position: body.position.coords.map(rounded).into(),
            velocity: body.velocity.map(rounded).into(),
            yaw: rounded(body.yaw),
            estimate: estimator.position().map(rounded).into(),
            estimated_yaw: rounded(estimator.yaw()),
            mode: drone.mode(),
            armed: drone.is_armed(),
            flying: drone.is_flying(),
            failsafe: drone.failsafe(),
            battery: rounded(drone.battery()),
            poses: drone.num_poses(),
        }))
    }
}

impl Summary {
    pub(super) fn new(world: &World) -> Self {
        let closest = world.closest();
        Self {
            drones: world.drones.len(),
            seconds: rounded(world.now().as_secs_f64()),
            min_separation_m: closest.map(|c: Closest| rounded(c.distance)),
            closest_pair: closest.map(|c| c.pair),
            contacts: world.num_contacts(),
        }
    }
}

pub(super) fn camera_pose(target_from_camera: &Isometry3<f64>) -> CameraPose {
    let Isometry3 { rotation: q, translation } = target_from_camera;
    CameraPose { position: translation.vector.into(), orientation: [q.w, q.i, q.j, q.k] }
}

/// To a tenth of a millimeter.
pub(super) fn rounded(value: f64) -> f64 {
    (value * 1e4).round() / 1e4
}
