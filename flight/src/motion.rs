//! The way of one vehicle: legs to a goal, the views between, and the timed trajectory.

mod path;
mod segment;
mod trajectory;
mod views;

pub(crate) use path::route;
pub use path::{Goal, Leg, PathStyle, legs, turn_towards};
pub use segment::{LegKind, Segment};
pub use trajectory::{MotionLimits, Trajectory, Waypoint};
pub use views::{ViewRange, with_views};

use std::f64::consts::{PI, TAU};

/// The angle in (-pi, pi] that points the same way.
pub fn wrapped(angle: f64) -> f64 {
    let turned = angle.rem_euclid(TAU);
    if turned > PI { turned - TAU } else { turned }
}
