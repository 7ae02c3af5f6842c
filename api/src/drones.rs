//! Drones: what they are, what they say, what they are told.

use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};
use uuid::Uuid;

use crate::{LocalizeAnswer, vision::pose_problem};

/// Which MAVLink message carries poses to a drone's estimator.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum VisionMessage {
    /// VISION_POSITION_ESTIMATE.
    #[default]
    PositionEstimate,
    /// ODOMETRY in the frame LOCAL_FRD.
    Odometry,
}

/// Where a camera sits on a drone and where it looks: `body_from_camera`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CameraMount {
    /// Place of the camera in the body (x forward, y left, z up), meters.
    pub position: [f64; 3],
    /// Unit quaternion w, x, y, z that turns camera axes (x right, y down, z forward) into the
    /// body's.
    pub orientation: [f64; 4],
}

impl CameraMount {
    /// What is wrong with it, if anything.
    pub fn problem(&self) -> Option<String> {
        pose_problem(&self.position, &self.orientation)
    }
}

impl Default for CameraMount {
    /// In the middle of the drone, level, looking ahead.
    fn default() -> Self {
        Self { position: [0.0; 3], orientation: [0.5, -0.5, 0.5, -0.5] }
    }
}

/// A drone to be registered, or the settings of one to be replaced.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PutDrone {
    /// For people.
    #[schema(min_length = 1, max_length = 200)]
    pub name: String,
    /// Its own signing key, 64 hex digits; never shown again. Without it the key of the service is
    /// its key.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub signing_key: Option<String>,
    /// How it takes poses.
    #[serde(default)]
    pub vision: VisionMessage,
    /// Its camera; in the middle, level and looking ahead when absent.
    #[serde(default)]
    pub body_from_camera: CameraMount,
}

/// Settings of a registered drone to be changed; what is absent stays, also its key.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PatchDrone {
    /// For people.
    #[schema(min_length = 1, max_length = 200)]
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Its own signing key, 64 hex digits; never shown again.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub signing_key: Option<String>,
    /// How it takes poses.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vision: Option<VisionMessage>,
    /// Its camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub body_from_camera: Option<CameraMount>,
}

impl PatchDrone {
    /// The settings once they are changed.
    pub fn applied_to(self, drone: PutDrone) -> PutDrone {
        PutDrone {
            name: self.name.unwrap_or(drone.name),
            signing_key: self.signing_key.or(drone.signing_key),
            vision: self.vision.unwrap_or(drone.vision),
            body_from_camera: self.body_from_camera.unwrap_or(drone.body_from_camera),
        }
    }
}

/// A drone that is registered, or was heard, or both.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Drone {
    /// Its MAVLink system id.
    pub id: u8,
    /// As registered.
    pub name: Option<String>,
    /// Whether it has a key of its own.
    pub has_own_key: bool,
    /// How it takes poses.
    pub vision: VisionMessage,
    /// Its camera.
    pub body_from_camera: CameraMount,
    /// What it says; absent when it was not heard.
    pub state: Option<DroneState>,
}

/// What a drone says of itself, and what it is told.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DroneState {
    /// Its MAVLink system id.
    pub id: u8,
    /// When this was so, nanoseconds since the Unix epoch.
    pub t_ns: u64,
    /// `ardupilot` or `px4`.
    pub autopilot: String,
    /// UDP address.
    pub endpoint: String,
    /// How it is heard.
    pub link: DroneLink,
    /// Motors may turn.
    pub armed: bool,
    /// It may be in the air.
    pub flying: bool,
    /// The autopilot acts on its own because something failed.
    pub failsafe: bool,
    /// `guided`, `land` or `other`; absent when it was not said.
    pub mode: Option<String>,
    /// It flies to the targets of the service.
    pub in_control: bool,
    /// Charge, 0 to 1.
    pub battery: Option<f64>,
    /// Whether its estimator follows the poses that it is sent: `idle`, `origin`, `feeding`,
    /// `ready`, `degraded`, `failed`.
    pub feed: String,
    /// Age of the latest pose that was sent to it, milliseconds.
    pub sent_pose_age_ms: Option<f64>,
    /// Where its estimator is, in the map.
    pub estimate: Option<DronePlace>,
    /// Where it is told to be, in the map.
    pub target: Option<DronePlace>,
}

/// How a drone is heard.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DroneLink {
    /// `seen`, `linked`, `stale`, `lost`.
    pub state: String,
    /// Since the last heartbeat, milliseconds.
    pub silence_ms: f64,
    /// Part of its messages that did not arrive.
    pub loss: f64,
    /// There and back, milliseconds.
    pub round_trip_ms: Option<f64>,
}

/// A place of a drone in the map.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DronePlace {
    /// In the map, meters.
    pub position: [f64; 3],
    /// In the map, meters per second.
    pub velocity: [f64; 3],
    /// About the map's z axis, counter-clockwise from x, radians.
    pub yaw: f64,
    /// How long ago this was heard, milliseconds; absent for a target.
    pub age_ms: Option<f64>,
}

/// What a drone is told.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum DroneCommand {
    /// Motors on.
    Arm {},
    /// Motors off, on the ground.
    Disarm {},
    /// Motors on if they are not, up, and hover.
    Takeoff {
        /// Above the place where it stands, meters.
        height: f64,
    },
    /// Straight to a place.
    Goto(DroneTarget),
    /// Stop and stay.
    Hold {},
    /// Down where it is, motors off.
    Land {},
    /// Motors off at once: it falls.
    Stop {},
}

/// A place to fly to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct DroneTarget {
    /// In the map, meters.
    pub position: [f64; 3],
    /// About the map's z axis, counter-clockwise from x, radians; as it is when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub yaw: Option<f64>,
    /// Distance that counts as there, meters; 0.15 when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tolerance_m: Option<f64>,
    /// Time for it; by the distance when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub timeout_s: Option<f64>,
}

/// How far a command has come.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct DroneCommandStatus {
    /// Within the life of the service.
    pub id: u64,
    /// System id of the drone.
    pub drone: u8,
    /// `accepted`, `sent`, `executing`, `done`, `rejected`, `timed_out`, `superseded`.
    pub state: String,
    /// Why it was rejected, in the drone's words.
    pub detail: Option<String>,
}

/// The pose of a drone, from any source that knows it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct DronePose {
    /// In the map, meters.
    pub position: [f64; 3],
    /// `map_from_body` (x forward, y left, z up); w, x, y, z.
    pub orientation: [f64; 4],
    /// Since the image was taken, milliseconds.
    pub age_ms: f64,
    /// Standard deviation of each coordinate, meters.
    pub position_sd: f64,
    /// Standard deviation of each angle, radians.
    pub angle_sd: f64,
    /// Counts places that the source has given up for others: in flight, a place elsewhere that is
    /// not announced so is not believed.
    #[serde(default)]
    pub reset_counter: u32,
}

/// What became of a pose.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct DronePoseAnswer {
    /// Whether it was sent to the drone.
    pub sent: bool,
    /// Why not.
    pub reason: Option<String>,
}

/// Of a frame of a drone's camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct FrameParams {
    /// Where to look.
    pub map_id: Uuid,
    /// Since the frame was taken, milliseconds; 0 when absent.
    pub age_ms: Option<f64>,
    /// Whether the frame joins the map, if it has a place in it: a job makes a new version.
    #[serde(default)]
    #[param(default = false)]
    pub extend: bool,
}

/// What a frame of a drone's camera says.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FrameAnswer {
    /// The pose of the camera, or why there is none.
    pub answer: LocalizeAnswer,
    /// The place of the drone, if there is one.
    pub place: Option<FramePlace>,
    /// The job by which the frame joins the map, if that was asked for.
    pub job_id: Option<Uuid>,
}

/// The place of a drone by a frame of its camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FramePlace {
    /// Of the drone in the map, meters.
    pub position: [f64; 3],
    /// `map_from_body`; w, x, y, z.
    pub orientation: [f64; 4],
    /// How far the drone's estimator is from it, meters.
    pub correction_m: Option<f64>,
    /// How far it is from the goal of the drone's flight, or from where it was told to be, meters.
    pub goal_distance_m: Option<f64>,
    /// Whether it was sent to the drone.
    pub sent: bool,
    /// Why not.
    pub reason: Option<String>,
}

/// Drones that were stopped.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct AllStopped {
    /// One command per drone that was armed.
    pub commands: Vec<DroneCommandStatus>,
}

/// Something that happened to a drone.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct DroneEvent {
    /// Rises by one with every event of any drone.
    pub seq: u64,
    /// System id of the drone.
    pub drone: u8,
    /// Nanoseconds since the Unix epoch.
    pub t_ns: u64,
    /// `link`, `feed`, `armed`, `mode`, `landed`, `rebooted`, `moved`, `text`, `command`, `alert`.
    pub kind: String,
    /// The new state, or what was said.
    pub value: String,
    /// For people, or the id of the command.
    pub detail: Option<String>,
}

/// Something about a drone that somebody should look at.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct DroneAlert {
    /// System id of the drone.
    pub drone: u8,
    /// The flight that it flies in, where the alert comes from the flight.
    pub flight_id: Option<Uuid>,
    /// Nanoseconds since the Unix epoch.
    pub t_ns: u64,
    /// What: `pose_stale`, `link_lost`, `lease_over`, `battery_low`, `too_close`, `pose_refused`,
    /// `control_taken`, `not_in_control`, `impostor`, `shared_address` and others.
    pub code: String,
    /// What the service does about it (`holds`, `lands`), or more about it.
    pub detail: Option<String>,
}

/// A promise to be there for drones: it has to be renewed before its time is over.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CreateLease {
    /// Which drones, by MAVLink system id.
    #[schema(min_items = 1, max_items = 100)]
    pub drones: Vec<u8>,
    /// How long the promise lasts without being renewed, milliseconds.
    #[schema(minimum = 200, maximum = 60000)]
    pub ttl_ms: u32,
}

/// A lease: until it is over, nobody else commands its drones. When it is over, and nobody else
/// takes them, they hold, and land half a minute later.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Lease {
    /// Within the life of the service.
    pub id: Uuid,
    /// Name of the token that holds it.
    pub holder: String,
    /// Which drones, by MAVLink system id.
    pub drones: Vec<u8>,
    /// How long it lasts without being renewed, milliseconds.
    pub ttl_ms: u32,
    /// How long it still lasts, milliseconds.
    pub left_ms: u32,
}
