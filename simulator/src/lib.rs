//! Simulated MAVLink drones with cameras that look into rooms.
//!
//! A drone here knows of Volery what a real one knows: what arrives by UDP, HTTP and WebSocket. It
//! flies on nothing but the poses that it is sent, so a wrong frame, a stale pose or a stream that
//! stopped shows in its true motion.
//!
//! The world is right-handed, meters, z up, with the floor at z = 0. A drone's local frame has z
//! down; where its x axis points is what the poses say. The simulation has one clock, a
//! [`Duration`](std::time::Duration) of the caller; equal seeds and equal datagrams at equal times
//! give equal flights.

mod body;
mod camera;
mod channel;
mod drone;
mod estimator;
mod event;
mod fault;
mod flavor;
mod link;
mod options;
mod parameters;
mod poses;
pub mod shell;
mod space;
mod world;

pub use body::{Body, Felt, Thrust};
pub use camera::{CameraFault, Eye, Mount, Scenery, jpeg};
pub use channel::{Channel, LinkFaults};
pub use drone::{Drone, TICK};
pub use estimator::Estimator;
pub use event::Event;
pub use fault::{FAULTS, Fault, FaultKind, UnknownFault};
pub use flavor::{Flavor, Mode};
pub use link::{Link, Received, Refusal, Signing};
pub use options::{DroneOptions, InertialFaults};
pub use parameters::Parameters;
pub use poses::{PoseFault, PoseOptions, PoseSample, PoseSource};
pub use space::Space;
pub use world::{Closest, RADIUS, World};
