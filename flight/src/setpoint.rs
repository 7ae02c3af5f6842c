//! Where a vehicle shall be.

use nalgebra::{Point3, Vector3};

/// Number of a vehicle: its MAVLink system id.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct VehicleId(pub u8);

/// Where a vehicle shall be, how fast it shall pass there and where its front shall look.
/// In the map's frame, meters, meters per second, radians about z up from x.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setpoint {
    /// Position in the map.
    pub position: Point3<f64>,
    /// Velocity in the map; zero at a place to stay.
    pub velocity: Vector3<f64>,
    /// Yaw about the map's z axis, counter-clockwise from x.
    pub yaw: f64,
}
