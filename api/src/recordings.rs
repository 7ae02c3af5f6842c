//! Recordings of what drones and the service say to each other.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

/// A recording to start.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CreateRecording {
    /// MAVLink system id.
    pub drone: u8,
}

/// Everything that a drone's link sent and received from a start to an end.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Recording {
    /// For life.
    pub id: Uuid,
    /// MAVLink system id.
    pub drone: u8,
    /// When it began, nanoseconds since the Unix epoch.
    pub t_ns: u64,
    /// Whether it goes on.
    pub running: bool,
    /// Bytes so far; the latest second may be missing.
    pub size: u64,
}
