//! Drones: one UDP address, a thread that does nothing else, and everything around it.
//!
//! Every decision is made by [`volery_flight::Fleet`], which is pure. Here it gets a socket and a
//! clock. Whoever changes it sends at once what that calls for: no queue lies between a request
//! and the wire.

mod journal;
mod leases;
mod news;
mod orders;
mod places;
mod recorder;
mod service;
mod signing_time;
mod sockets;
mod wire;

pub(crate) use leases::LeaseRefusal;
pub(crate) use news::{DroneNews, States};
pub(crate) use orders::NotCommanded;
pub(crate) use recorder::RecordingError;
pub(crate) use service::Drones;
pub(crate) use wire::key as parse_key;
