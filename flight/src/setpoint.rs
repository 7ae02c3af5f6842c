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

/// A coordinate further out is not a place in a building, meters.
const MAX_COORDINATE: f64 = 1000.0;
/// No vehicle of ours is this fast, meters per second.
const MAX_SPEED: f64 = 20.0;

impl Setpoint {
    /// Stays at `position`.
    pub fn at(position: Point3<f64>, yaw: f64) -> Self {
        Self { position, velocity: Vector3::zeros(), yaw }
    }

    /// Whether it can be flown to: one number that is not finite can stop an autopilot for good.
    pub fn is_finite(&self) -> bool {
        self.position.iter().all(|c| c.abs() < MAX_COORDINATE)
            && self.velocity.norm() < MAX_SPEED
            && self.yaw.is_finite()
    }
}
