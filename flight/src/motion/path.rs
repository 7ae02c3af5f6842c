//! Legs from a place to a goal.

use nalgebra::{Point3, Vector2};

use super::{LegKind, Waypoint, wrapped};

/// Shorter ways have no direction: the vehicle does not turn for them. Meters.
const NO_WAY: f64 = 0.01;

/// Where to go.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Goal {
    /// Position in the map. Meters.
    pub position: Point3<f64>,
    /// Yaw at the goal; without one the vehicle keeps looking where it flew. Radians.
    pub yaw: Option<f64>,
}

/// How a goal is approached.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PathStyle {
    /// Turn towards the goal, fly level until above or below it, then straight up or down: the
    /// picture of the camera changes least, so that it can be compared with expected views.
    #[default]
    HorizontalVertical,
    /// The straight line, turning on the way.
    Straight,
}

/// One move from rest to rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Leg {
    /// What the move is for.
    pub kind: LegKind,
    /// Where it ends.
    pub to: Waypoint,
}

/// Signed turn from the vehicle's front `F` to the direction `M` of the goal in the horizontal
/// plane, counter-clockwise positive; none if the goal is straight above or below.
///
/// ```text
/// M = C − D without its vertical part,   θ = atan2(F × M, F · M),   |θ| = acos(F·M / ‖F‖‖M‖)
/// ```
///
/// The magnitude is the paper's formula; the sign, which acos loses, says left or right.
pub fn turn_towards(start: &Waypoint, goal: &Point3<f64>) -> Option<f64> {
    let f = Vector2::new(start.yaw.cos(), start.yaw.sin());
    let m = (goal - start.position).xy();
    (m.norm() >= NO_WAY).then(|| f.perp(&m).atan2(f.dot(&m)))
}

/// The legs from `start` to `goal`. Legs that would go nowhere are left out.
pub fn legs(start: Waypoint, goal: &Goal, style: PathStyle) -> Vec<Leg> {
    match style {
        PathStyle::HorizontalVertical => route(start, goal, start.position.z, &[]),
        PathStyle::Straight => {
            let yaw = goal.yaw.unwrap_or(start.yaw);
            let to = Waypoint { position: goal.position, yaw };
            moves(start, [(LegKind::Straight, to)])
        }
    }
}

/// The horizontal-vertical way with its level part at the height `height` and over the places
/// `via`.
pub(crate) fn route(start: Waypoint, goal: &Goal, height: f64, via: &[Vector2<f64>]) -> Vec<Leg> {
    let at = |xy: Vector2<f64>, z: f64| Point3::new(xy.x, xy.y, z);
    let mut here = Waypoint { position: at(start.position.xy().coords, height), ..start };
    let mut steps = vec![(LegKind::Vertical, here)];
    for xy in via.iter().copied().chain([goal.position.xy().coords]) {
        let next = at(xy, height);
        if let Some(turn) = turn_towards(&here, &next) {
            here.yaw = wrapped(here.yaw + turn);
            steps.push((LegKind::Turn, here));
        }
        here.position = next;
        steps.push((LegKind::Horizontal, here));
    }
    here.yaw = goal.yaw.map_or(here.yaw, wrapped);
    steps.push((LegKind::Turn, here));
    here.position = goal.position;
    steps.push((LegKind::Vertical, here));
    moves(start, steps)
}

/// Those of the steps that lead somewhere else.
fn moves(start: Waypoint, steps: impl IntoIterator<Item = (LegKind, Waypoint)>) -> Vec<Leg> {
    let mut here = start;
    let mut legs = Vec::new();
    for (kind, to) in steps {
        let still = to.position == here.position && wrapped(to.yaw - here.yaw).abs() < 1e-9;
        if !still {
            legs.push(Leg { kind, to });
            here = to;
        }
    }
    legs
}

#[cfg(test)]
mod tests;
