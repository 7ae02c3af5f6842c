//! Settings of a fleet, and what it sends.

use core::net::SocketAddr;
use std::time::Duration;

use crate::signing::{Key, StreamTime};

/// Settings of a fleet.
#[derive(Debug, Clone)]
pub struct FleetOptions {
    /// Whether vehicles without a key may take part: whoever reaches the socket can then be one.
    pub accept_unsigned: bool,
    /// Key of vehicles that have none of their own.
    pub default_key: Option<Key>,
    /// The signing time at time zero; never ahead of true time, never behind what was used before.
    pub signing_time_at_zero: u64,
    /// Signing times of streams that were taken before.
    pub stream_times: Vec<StreamTime>,
    /// Oldest pose that is sent.
    pub max_pose_age: Duration,
}

impl Default for FleetOptions {
    fn default() -> Self {
        Self {
            accept_unsigned: false,
            default_key: None,
            signing_time_at_zero: 0,
            stream_times: Vec::new(),
            max_pose_age: Duration::from_millis(100),
        }
    }
}

/// Bytes for one vehicle.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Datagram {
    /// Where to.
    pub to: SocketAddr,
    /// One or more frames.
    pub bytes: Vec<u8>,
}
