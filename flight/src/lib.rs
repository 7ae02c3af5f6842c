//! Poses and targets in a map to MAVLink commands, safely.
//!
//! Pure: datagrams, poses and the time come in as arguments, datagrams and events go out. Time is
//! a [`Duration`](std::time::Duration) on one monotonic clock of the caller.
//!
//! Frames: `map` is right-handed, meters, z up, x forward, y left (FLU); `local` is the frame of
//! a vehicle's estimator, z down; `body` is FRD towards the vehicle and FLU towards people.

pub mod group;
pub mod motion;
mod setpoint;
pub mod watchdog;

pub use setpoint::{Setpoint, VehicleId};
