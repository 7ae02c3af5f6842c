//! Poses and targets in a map to MAVLink commands, safely.
//!
//! Pure: datagrams, poses and the time come in as arguments, datagrams and events go out. Time is
//! a [`Duration`](std::time::Duration) on one monotonic clock of the caller.
//!
//! Frames: `map` is right-handed, meters, z up, x forward, y left (FLU); `local` is the frame of
//! a vehicle's estimator, z down; `body` is FRD towards the vehicle and FLU towards people.

mod autopilot;
mod command;
mod event;
mod feed;
mod fleet;
pub mod frames;
pub mod group;
mod link;
mod message;
pub mod motion;
mod options;
pub mod parameters;
mod pilot;
pub mod positioning;
mod refusal;
mod setpoint;
mod signing;
mod task;
mod telemetry;
pub mod tlog;
mod vehicle;
pub mod watchdog;
pub mod wire;

pub use autopilot::{Autopilot, Mode};
pub use event::{Alert, Event, Happening};
pub use feed::{FeedState, PoseFix, PoseGate, PoseRefusal};
pub use fleet::Fleet;
pub use link::{Link, LinkState};
pub use message::VisionMessage;
pub use options::{Datagram, FleetOptions};
pub use refusal::{CommandRefusal, Refused};
pub use setpoint::{Setpoint, VehicleId};
pub use signing::{
    Key, SIGNATURE_BYTES, Signature, SignatureError, StreamTime, Verifier, signing_time,
};
pub use task::{Command, CommandId, CommandState};
pub use telemetry::{Landed, Motion, Telemetry};
pub use vehicle::Vehicle;
