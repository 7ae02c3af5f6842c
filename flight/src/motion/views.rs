//! Views on the way that a camera frame can be compared with.

use std::time::Duration;

use super::{Leg, LegKind, MotionLimits, Trajectory, Waypoint};

/// How far apart two views may be for one to be found in the other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViewRange {
    /// Distance from the goal to what its view shows. Meters.
    pub scene_depth: f64,
    /// Largest ratio of image scales between neighboring views.
    pub max_scale: f64,
    /// Vertical field of view of the camera. Radians.
    pub vertical_fov: f64,
    /// Smallest part of a view that its neighbor above or below must share.
    pub min_overlap: f64,
    /// Stay at each view while a frame is taken.
    pub stay: Duration,
}

impl Default for ViewRange {
    /// A wall 3 m behind the goal, scales up to 1.6, a field of view of 45 deg, half of the
    /// picture shared, half a second at each view.
    fn default() -> Self {
        Self {
            scene_depth: 3.0,
            max_scale: 1.6,
            vertical_fov: 45f64.to_radians(),
            min_overlap: 0.5,
            stay: Duration::from_millis(500),
        }
    }
}

impl ViewRange {
    /// How far along the leg, as parts of it, the views stand; the last is its end.
    ///
    /// Flying ahead by `L` towards a scene `d` behind the end magnifies it by `(L + d)/d`: views
    /// stand where the depth shrinks by equal factors. Flying up or down by `L` moves the picture
    /// by `L` of the `2 d tan(φ/2)` that it covers: views stand at regular intervals.
    fn stations(&self, kind: LegKind, length: f64) -> Vec<f64> {
        match kind {
            LegKind::Horizontal => {
                let d = self.scene_depth;
                let magnification = (length + d) / d;
                let count = (magnification.ln() / self.max_scale.ln()).ceil().max(1.0);
                let depth = |k: f64| (length + d) * magnification.powf(-k / count);
                (1..=count as usize).map(|k| (length + d - depth(k as f64)) / length).collect()
            }
            LegKind::Vertical => {
                let height = 2.0 * self.scene_depth * (0.5 * self.vertical_fov).tan();
                let count = (length / (height * (1.0 - self.min_overlap))).ceil().max(1.0);
                (1..=count as usize).map(|k| k as f64 / count).collect()
            }
            _ => vec![1.0],
        }
    }

    /// Every number makes sense.
    pub fn is_valid(&self) -> bool {
        self.scene_depth > 0.0
            && self.scene_depth.is_finite()
            && self.max_scale > 1.0
            && (0.0..std::f64::consts::PI).contains(&self.vertical_fov)
            && self.vertical_fov > 0.0
            && (0.0..1.0).contains(&self.min_overlap)
    }
}

/// The legs from `start` with a stay at the end of each level or vertical one, and at as many
/// views between as `range` asks for: a goal whose view is too far to be found at once is reached
/// over nearer ones.
pub fn with_views(
    start: Waypoint,
    legs: &[Leg],
    range: &ViewRange,
    limits: &MotionLimits,
) -> Trajectory {
    let mut trajectory = Trajectory::standing(start);
    for leg in legs {
        let from = trajectory.end().position;
        let way = leg.to.position - from;
        if !matches!(leg.kind, LegKind::Horizontal | LegKind::Vertical) {
            trajectory.fly(leg.kind, leg.to, limits);
            continue;
        }
        for part in range.stations(leg.kind, way.norm()) {
            let to = Waypoint { position: from + way * part, yaw: leg.to.yaw };
            trajectory.fly(leg.kind, to, limits);
            trajectory.stay(LegKind::View, range.stay);
        }
    }
    trajectory
}

#[cfg(test)]
mod tests;
