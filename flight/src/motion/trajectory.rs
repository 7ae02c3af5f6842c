//! Timed way of one vehicle.

use std::time::Duration;

use nalgebra::{Point3, Vector3};

use super::{Leg, LegKind, Segment, wrapped};
use crate::Setpoint;

/// A place to be at rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Waypoint {
    /// Position in the map. Meters.
    pub position: Point3<f64>,
    /// Yaw about the map's z axis. Radians.
    pub yaw: f64,
}

/// How fast a vehicle may move. A path is flown from rest to rest with trapezoidal speed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionLimits {
    /// Largest horizontal speed. Meters per second.
    pub speed: f64,
    /// Largest vertical speed. Meters per second.
    pub climb_speed: f64,
    /// Largest acceleration in any direction. Meters per second squared.
    pub acceleration: f64,
    /// Largest yaw rate. Radians per second.
    pub yaw_rate: f64,
    /// Largest yaw acceleration. Radians per second squared.
    pub yaw_acceleration: f64,
}

impl Default for MotionLimits {
    /// Indoors: 1 m/s level, 0.5 m/s up and down, 0.5 m/s², 45 deg/s, 90 deg/s². Slow enough for
    /// a small camera's exposure and for estimators with a latency of 150 ms.
    fn default() -> Self {
        Self {
            speed: 1.0,
            climb_speed: 0.5,
            acceleration: 0.5,
            yaw_rate: 45f64.to_radians(),
            yaw_acceleration: 90f64.to_radians(),
        }
    }
}

impl MotionLimits {
    /// Every limit is a positive number.
    pub fn are_positive(&self) -> bool {
        let all =
            [self.speed, self.climb_speed, self.acceleration, self.yaw_rate, self.yaw_acceleration];
        all.iter().all(|limit| limit.is_finite() && *limit > 0.0)
    }
}

/// Timed way of one vehicle, at rest before its start and after its end.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    segments: Vec<Segment>,
    end: Waypoint,
}

impl Trajectory {
    /// A vehicle that stays where it is.
    pub fn standing(at: Waypoint) -> Self {
        Self { segments: Vec::new(), end: at }
    }

    /// The legs one after another from `start`.
    pub fn along(start: Waypoint, legs: &[Leg], limits: &MotionLimits) -> Self {
        let mut trajectory = Self::standing(start);
        for leg in legs {
            trajectory.fly(leg.kind, leg.to, limits);
        }
        trajectory
    }

    /// Pieces as they are; the vehicle stays where the last one ends.
    pub(crate) fn from_segments(segments: Vec<Segment>, end: Waypoint) -> Self {
        Self { segments, end }
    }

    /// Appends a move from rest to rest, as fast as the limits allow.
    ///
    /// One trapezoid `s(t)` from 0 to 1 moves and turns together: with the displacement `d` and
    /// the turn `θ` (the short way round), `ṡ ≤ min(v_xy/‖d_xy‖, v_z/|d_z|, ω/|θ|)` and
    /// `s̈ ≤ min(a/‖d‖, α/|θ|)`.
    pub fn fly(&mut self, kind: LegKind, to: Waypoint, limits: &MotionLimits) {
        let from = self.end;
        let displacement = to.position - from.position;
        let turn = wrapped(to.yaw - from.yaw);
        let level = displacement.xy().norm();
        let rate = (limits.speed / level)
            .min(limits.climb_speed / displacement.z.abs())
            .min(limits.yaw_rate / turn.abs());
        let acceleration =
            (limits.acceleration / displacement.norm()).min(limits.yaw_acceleration / turn.abs());
        if !rate.is_finite() {
            return; // nowhere to go
        }
        let peak = rate.min(acceleration.sqrt());
        let ramp = peak / acceleration;
        let cruise = ((1.0 - peak * ramp) / peak).max(0.0);

        // start, length, s, ṡ, s̈ of the three parts
        let start = self.seconds();
        let parts = [
            (0.0, ramp, 0.0, 0.0, acceleration),
            (ramp, cruise, 0.5 * peak * ramp, peak, 0.0),
            (ramp + cruise, ramp, 1.0 - 0.5 * peak * ramp, peak, -acceleration),
        ];
        for (offset, duration, s, s_dot, s_ddot) in parts {
            if duration > 0.0 {
                self.segments.push(Segment {
                    kind,
                    start: start + offset,
                    duration,
                    position: from.position + displacement * s,
                    velocity: displacement * s_dot,
                    acceleration: displacement * s_ddot,
                    yaw: from.yaw + turn * s,
                    yaw_rate: turn * s_dot,
                    yaw_acceleration: turn * s_ddot,
                });
            }
        }
        self.end = Waypoint { position: to.position, yaw: from.yaw + turn };
    }

    /// Appends a stay.
    pub fn stay(&mut self, kind: LegKind, duration: Duration) {
        let seconds = duration.as_secs_f64();
        if seconds > 0.0 {
            let (start, end) = (self.seconds(), self.end);
            self.segments.push(Segment::rest(kind, start, seconds, end.position, end.yaw));
        }
    }

    /// Appends another trajectory that starts where this one ends.
    pub fn append(&mut self, next: &Self) {
        let offset = self.seconds();
        let moved = next.segments.iter().map(|s| Segment { start: s.start + offset, ..*s });
        self.segments.extend(moved);
        self.end = next.end;
    }

    /// The part from `from` to `to` seconds as a trajectory of its own, whose start may move.
    pub(crate) fn window(&self, from: f64, to: f64) -> Vec<Segment> {
        let (mut pieces, mut t) = (Vec::new(), from);
        while t < to {
            let Some(piece) = self.segment_at(t) else {
                let end = self.end;
                let rest = Segment::rest(LegKind::Wait, t - from, to - t, end.position, end.yaw);
                pieces.push(rest);
                break;
            };
            let until = piece.end().min(to);
            pieces.push(piece.part(t - piece.start, until - piece.start, t - from));
            t = until;
        }
        pieces
    }

    /// What is left of it after the time `t`, moving from its start on as it does then.
    pub fn rest_after(&self, t: Duration) -> Self {
        let (t, end) = (t.as_secs_f64(), self.seconds());
        Self { segments: self.window(t, end), end: self.end }
    }

    /// Where a vehicle shall be at the time `t` since the start.
    pub fn sample(&self, t: Duration) -> Setpoint {
        let t = t.as_secs_f64();
        match self.segment_at(t) {
            Some(segment) => segment.setpoint_at(t - segment.start),
            None => Setpoint {
                position: self.end.position,
                velocity: Vector3::zeros(),
                yaw: wrapped(self.end.yaw),
            },
        }
    }

    /// Leg that is being flown at the time `t`, with its number; none after the end.
    pub fn leg_at(&self, t: Duration) -> Option<(usize, LegKind)> {
        let segment = self.segment_at(t.as_secs_f64())?;
        self.legs()
            .enumerate()
            .find(|(_, (_, start, end))| (*start..*end).contains(&segment.start))
            .map(|(index, (kind, ..))| (index, kind))
    }

    /// Kind, start and end (seconds) of each leg: runs of pieces of one kind between rests.
    pub fn legs(&self) -> impl Iterator<Item = (LegKind, f64, f64)> + '_ {
        let begins = |s: &Segment| s.velocity == Vector3::zeros() && s.yaw_rate == 0.0;
        let mut index = 0;
        std::iter::from_fn(move || {
            let first = self.segments.get(index)?;
            index += 1;
            while self.segments.get(index).is_some_and(|s| !begins(s) && s.kind == first.kind) {
                index += 1;
            }
            Some((first.kind, first.start, self.segments[index - 1].end()))
        })
    }

    /// The pieces in order of time.
    pub fn segments(&self) -> &[Segment] {
        &self.segments
    }

    /// Place at the start.
    pub fn start(&self) -> Waypoint {
        match self.segments.first() {
            Some(first) => Waypoint { position: first.position, yaw: first.yaw },
            None => self.end,
        }
    }

    /// Place at the end, where the vehicle stays.
    pub fn end(&self) -> Waypoint {
        self.end
    }

    /// Time from start to end, rounded up to a nanosecond.
    pub fn duration(&self) -> Duration {
        Duration::from_nanos((self.seconds() * 1e9).ceil() as u64)
    }

    pub(crate) fn seconds(&self) -> f64 {
        self.segments.last().map_or(0.0, Segment::end)
    }

    /// Piece at `t` seconds; none from the end on.
    pub(crate) fn segment_at(&self, t: f64) -> Option<&Segment> {
        let after = self.segments.partition_point(|s| s.end() <= t);
        self.segments.get(after)
    }
}

#[cfg(test)]
mod tests;
