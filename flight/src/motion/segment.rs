//! A piece of a trajectory with constant acceleration.

use nalgebra::{Point3, Vector3};

use super::wrapped;
use crate::Setpoint;

/// What a piece of the way is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum LegKind {
    /// Turn in place.
    Turn,
    /// Level flight.
    Horizontal,
    /// Straight up or down.
    Vertical,
    /// Straight through space, turning on the way.
    Straight,
    /// Stay and wait for the others.
    Wait,
    /// Stay for a frame to be taken and compared.
    View,
}

impl LegKind {
    /// Stable name of the kind.
    pub fn code(self) -> &'static str {
        match self {
            Self::Turn => "turn",
            Self::Horizontal => "horizontal",
            Self::Vertical => "vertical",
            Self::Straight => "straight",
            Self::Wait => "wait",
            Self::View => "view",
        }
    }
}

/// Motion `p + v t + a t²/2` for `0 ≤ t ≤ duration`, the same for the yaw.
///
/// Two such motions differ by a quadratic in time, which is what makes closest approaches and
/// limits exact instead of sampled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// Leg of the way that the piece belongs to.
    pub kind: LegKind,
    /// Seconds from the start of the trajectory.
    pub start: f64,
    /// Seconds.
    pub duration: f64,
    /// Position at the start of the piece.
    pub position: Point3<f64>,
    /// Velocity at the start of the piece.
    pub velocity: Vector3<f64>,
    /// Acceleration throughout.
    pub acceleration: Vector3<f64>,
    /// Yaw at the start of the piece, not wrapped.
    pub yaw: f64,
    /// Yaw rate at the start of the piece.
    pub yaw_rate: f64,
    /// Yaw acceleration throughout.
    pub yaw_acceleration: f64,
}

impl Segment {
    /// Rest at one place.
    pub fn rest(kind: LegKind, start: f64, duration: f64, position: Point3<f64>, yaw: f64) -> Self {
        Self {
            kind,
            start,
            duration,
            position,
            velocity: Vector3::zeros(),
            acceleration: Vector3::zeros(),
            yaw,
            yaw_rate: 0.0,
            yaw_acceleration: 0.0,
        }
    }

    /// Seconds from the start of the trajectory to the end of the piece.
    pub fn end(&self) -> f64 {
        self.start + self.duration
    }

    /// Position `t` seconds into the piece.
    pub fn position_at(&self, t: f64) -> Point3<f64> {
        self.position + self.velocity * t + self.acceleration * (0.5 * t * t)
    }

    /// Velocity `t` seconds into the piece.
    pub fn velocity_at(&self, t: f64) -> Vector3<f64> {
        self.velocity + self.acceleration * t
    }

    /// Yaw `t` seconds into the piece, not wrapped.
    pub fn yaw_at(&self, t: f64) -> f64 {
        self.yaw + self.yaw_rate * t + 0.5 * self.yaw_acceleration * t * t
    }

    /// Where a vehicle shall be `t` seconds into the piece.
    pub fn setpoint_at(&self, t: f64) -> Setpoint {
        Setpoint {
            position: self.position_at(t),
            velocity: self.velocity_at(t),
            yaw: wrapped(self.yaw_at(t)),
        }
    }

    /// The part from `from` to `to`, seconds into the piece, as a piece that starts at `start`.
    pub(crate) fn part(&self, from: f64, to: f64, start: f64) -> Self {
        Self {
            start,
            duration: to - from,
            position: self.position_at(from),
            velocity: self.velocity_at(from),
            yaw: self.yaw_at(from),
            yaw_rate: self.yaw_rate + self.yaw_acceleration * from,
            ..*self
        }
    }

    /// No number of the piece is infinite or NaN, and time runs forward.
    pub fn is_finite(&self) -> bool {
        let scalars = [self.start, self.duration, self.yaw, self.yaw_rate, self.yaw_acceleration];
        self.position.coords.iter().all(|v| v.is_finite())
            && self.velocity.iter().all(|v| v.is_finite())
            && self.acceleration.iter().all(|v| v.is_finite())
            && scalars.iter().all(|v| v.is_finite())
            && self.duration >= 0.0
    }
}
