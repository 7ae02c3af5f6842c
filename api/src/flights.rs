//! Group flights: plans, their checks, fences.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

/// How goals are approached.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum FlightStyle {
    /// Turn towards the goal, fly level, then straight up or down; ways round each other differ in
    /// height, bends and waits.
    #[default]
    HorizontalVertical,
    /// Straight lines; ways round each other differ in waits.
    Straight,
}

/// A flight of one or more drones to be planned and checked.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CreateFlight {
    /// The map whose frame the goals are in; it must be metric.
    pub map_id: Uuid,
    /// Who flies where.
    #[schema(min_items = 1, max_items = 100)]
    pub drones: Vec<FlightDrone>,
    /// How goals are approached.
    #[serde(default)]
    pub style: FlightStyle,
    /// Whether drones may exchange their goals, for shorter ways.
    #[serde(default)]
    pub exchange_goals: bool,
    /// Smallest distance between drones, heights counted half, meters; 1 when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub separation_m: Option<f64>,
    /// Distance planned beyond that for drones that lag, meters; 0.5 when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub margin_m: Option<f64>,
    /// Largest level speed, meters per second; 1 when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speed: Option<f64>,
    /// Whether drones stop at views on the way that their frames can be compared with.
    #[serde(default)]
    pub views: bool,
    /// Whether ways may lead where no camera has looked.
    #[serde(default)]
    pub allow_unseen: bool,
}

/// A place for one drone to fly to from where it is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CreateTarget {
    /// The map whose frame the place is in; it must be metric.
    pub map_id: Uuid,
    /// In the map, meters.
    pub position: [f64; 3],
    /// About the map's z axis, counter-clockwise from x, radians; along the way when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub yaw: Option<f64>,
    /// How it is approached.
    #[serde(default)]
    pub style: FlightStyle,
    /// Whether the drone stops at views on the way that its frames can be compared with.
    #[serde(default)]
    pub views: bool,
    /// Largest level speed, meters per second; 1 when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speed: Option<f64>,
    /// Smallest distance to other drones in the air, heights counted half, meters; 1 when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub separation_m: Option<f64>,
    /// Whether the way may lead where no camera has looked.
    #[serde(default)]
    pub allow_unseen: bool,
    /// Only plan and check.
    #[serde(default)]
    pub dry_run: bool,
}

/// The planned way of a drone to its target.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Target {
    /// MAVLink system id.
    pub drone: u8,
    /// Where it is.
    pub start: FlightGoal,
    /// From its front to the direction of the target in the horizontal plane, counter-clockwise,
    /// radians; absent when the target is straight above or below.
    pub turn: Option<f64>,
    /// Its legs in order.
    pub legs: Vec<FlightLeg>,
    /// Time for it, seconds.
    pub duration_s: f64,
    /// Nearest approach to another drone in the air, heights counted half, meters.
    pub closest_m: Option<f64>,
    /// What it was checked against.
    pub checks: Vec<TargetCheck>,
    /// The flight that it became, unless it was only planned.
    pub flight_id: Option<Uuid>,
}

/// One check of a way.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct TargetCheck {
    /// `map_metric`, `geofence`, `free_space`, `separation`, `limits`, `drone`.
    pub rule: String,
    /// `passed`, `failed`, or `unknown` where the map does not tell.
    pub state: String,
    /// What is wrong, where and when.
    pub detail: Option<String>,
}

/// One drone of a flight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct FlightDrone {
    /// MAVLink system id.
    pub id: u8,
    /// Where its way starts; where it hovers when absent. One that stands beneath its start takes
    /// off when the flight starts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start: Option<FlightGoal>,
    /// Where it goes, in order; the group goes to its next goals together. None stays.
    #[schema(max_items = 100)]
    pub goals: Vec<FlightGoal>,
}

/// A place to fly to.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct FlightGoal {
    /// In the map, meters.
    pub position: [f64; 3],
    /// About the map's z axis, counter-clockwise from x, radians; along the way when absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub yaw: Option<f64>,
}

/// A flight whose plan has passed its check.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Flight {
    /// Within the life of the service.
    pub id: Uuid,
    /// The map that it is in.
    pub map_id: Uuid,
    /// `ready`, `running`, `paused`, `finished`, `aborted` (to land, or where it was by a command
    /// or by all-stop).
    pub state: String,
    /// Whether drones are on their way up to the start.
    pub taking_off: bool,
    /// Time on the plan, seconds.
    pub clock_s: f64,
    /// Length of the plan, seconds.
    pub duration_s: f64,
    /// Nearest approach of two drones on the plan, heights counted half, meters.
    pub closest_m: Option<f64>,
    /// The drone that the clock of all waits for.
    pub clock_held_by: Option<u8>,
    /// Who flies how.
    pub drones: Vec<FlightWay>,
    /// What happened, in order; the last 200.
    pub events: Vec<FlightNews>,
}

/// The way of one drone.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FlightWay {
    /// MAVLink system id.
    pub id: u8,
    /// Where it starts, in the map, meters.
    pub start: [f64; 3],
    /// Its legs in order.
    pub legs: Vec<FlightLeg>,
    /// Whether it is out of the flight and lands.
    pub taken_out: bool,
}

/// One move of a drone, from rest to rest.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FlightLeg {
    /// `turn`, `horizontal`, `vertical`, `straight`, `wait`, `view`.
    pub kind: String,
    /// Seconds on the plan.
    pub start_s: f64,
    /// Seconds on the plan.
    pub end_s: f64,
    /// Where it ends, in the map, meters.
    pub to: [f64; 3],
    /// Yaw at its end, radians.
    pub yaw: f64,
}

/// Something that happened in a flight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct FlightNews {
    /// Nanoseconds since the Unix epoch.
    pub t_ns: u64,
    /// `state`, `leg`, `held`, `released`, `clock_held`, `clock_runs`, `taken_out`, `landed`,
    /// `replanned`, `no_way`, `frame` (one of the drone's frames was placed by its features).
    pub kind: String,
    /// Whom it concerns.
    pub drone: Option<u8>,
    /// The new state, the kind of the leg, the reason, or how far a frame corrected the drone.
    pub value: Option<String>,
}

/// Where drones may fly in a map.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Geofence {
    /// Of which map.
    pub map_id: Uuid,
    /// Drones stay inside.
    pub area: FenceBlock,
    /// Drones stay outside.
    #[schema(max_items = 100)]
    #[serde(default)]
    pub keep_out: Vec<FenceBlock>,
    /// Distance kept to all walls, floors and ceilings, meters.
    pub margin_m: f64,
}

/// An upright block.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct FenceBlock {
    /// Corners in order, in the map, meters.
    #[schema(min_items = 3, max_items = 1000)]
    pub outline: Vec<[f64; 2]>,
    /// Lowest height, meters.
    pub floor: f64,
    /// Highest height, meters.
    pub ceiling: f64,
}
