//! Keeps vehicles apart by what is seen of them, whatever the plan says.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};

use super::Separation;
use super::separation::closest_between;
use crate::VehicleId;
use crate::motion::{LegKind, Segment, Trajectory, Waypoint};
use crate::watchdog::{Reason, Verdict};

/// What a vehicle is about to do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Intent<'a> {
    /// Go on along its way, which it has followed up to this time (seconds).
    Follow(&'a Trajectory, f64),
    /// Come to rest.
    Stop,
    /// Nobody knows: as it moves now.
    Unknown,
    /// As it moves now, and it cannot give way: it lands, or nobody here commands it.
    Forced,
}

/// What is seen of a vehicle in the air.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Neighbor<'a> {
    /// Where it is in the map.
    pub position: Point3<f64>,
    /// How it moves in the map.
    pub velocity: Vector3<f64>,
    /// What it is about to do.
    pub intent: Intent<'a>,
}

/// When the guard acts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Guard {
    /// Distance that predicted places keep.
    pub separation: Separation,
    /// How far ahead places are predicted. Seconds.
    pub horizon: f64,
    /// How fast vehicles come to rest. Meters per second squared.
    pub braking: f64,
    /// Vehicles that are nearer than this do not wait: one of them lands. Meters.
    pub land_distance: f64,
}

impl Default for Guard {
    /// 1 m over the next 2 s, in which a vehicle comes to rest from 1 m/s, braking by 0.5 m/s², landing below 0.5 m.
    fn default() -> Self {
        Self { separation: Separation::default(), horizon: 2.0, braking: 0.5, land_distance: 0.5 }
    }
}

impl Neighbor<'_> {
    /// Where the vehicle will be during the horizon.
    ///
    /// One that follows its way goes on along it with the offset and the excess of speed that it
    /// has now: for a vehicle on its way the prediction is the way, for one that strays it shows
    /// where that leads.
    fn prediction(&self, guard: &Guard) -> Trajectory {
        let rest = |from: f64, to: f64, position| {
            Segment::rest(LegKind::Wait, from, to - from, position, 0.0)
        };
        let moving = |duration: f64, acceleration| Segment {
            velocity: self.velocity,
            acceleration,
            ..rest(0.0, duration, self.position)
        };
        let pieces = match self.intent {
            Intent::Unknown | Intent::Forced => vec![moving(guard.horizon, Vector3::zeros())],
            Intent::Stop => {
                let duration = (self.velocity.norm() / guard.braking).min(guard.horizon);
                let braking = self.velocity.try_normalize(0.0).unwrap_or_default() * -guard.braking;
                let brake = moving(duration, braking);
                let stopped = rest(duration, guard.horizon, brake.position_at(duration));
                vec![brake, stopped]
            }
            Intent::Follow(way, clock) => {
                let mut pieces = way.window(clock, clock + guard.horizon);
                if let Some(first) = pieces.first().copied() {
                    let offset = self.position - first.position;
                    let excess = self.velocity - first.velocity;
                    for piece in &mut pieces {
                        piece.position += offset + excess * piece.start;
                        piece.velocity += excess;
                    }
                }
                pieces
            }
        };
        let end = pieces.last().map_or(self.position, |last| last.position_at(last.duration));
        Trajectory::from_segments(pieces, Waypoint { position: end, yaw: 0.0 })
    }
}

/// What the nearness of others asks of each vehicle; only those that shall not simply go on.
///
/// Of two that are predicted to come nearer than the separation, the one with the higher number
/// holds, unless it cannot; if that one is stopping already, both hold. Of two that are nearer than the landing
/// distance one lands: the lower one if they are above each other, otherwise that with the higher
/// number.
pub fn guard(
    vehicles: &BTreeMap<VehicleId, Neighbor<'_>>,
    guard: &Guard,
) -> BTreeMap<VehicleId, Verdict> {
    let mut verdicts: BTreeMap<VehicleId, Verdict> = BTreeMap::new();
    let mut ask = |vehicle: VehicleId, verdict: Verdict| {
        let held = verdicts.entry(vehicle).or_insert(verdict);
        *held = (*held).max(verdict);
    };
    let predicted: Vec<_> =
        vehicles.iter().map(|(&id, seen)| (id, seen, seen.prediction(guard))).collect();
    for (index, (low, first, way)) in predicted.iter().enumerate() {
        for (high, second, other) in &predicted[index + 1..] {
            let apart = second.position - first.position;
            let now = guard.separation.measure(&apart);
            let nearest =
                closest_between(way, other, 0.0, guard.horizon, &guard.separation).distance;
            // Not `<`: a place that is no number is too close.
            let enough = |distance: f64, required: f64| distance >= required;
            if !enough(now, guard.land_distance) {
                let above = apart.xy().norm() < apart.z.abs();
                let lower = if above && apart.z > 0.0 { low } else { high };
                ask(*lower, Verdict::Land(Reason::TooClose));
            }
            // Those who part are not stopped.
            if !enough(nearest.min(now), guard.separation.distance) && nearest < now - 1e-9 {
                let (yields, other) = match second.intent {
                    Intent::Forced => (low, high),
                    _ => (high, low),
                };
                ask(*yields, Verdict::Hold(Reason::TooClose));
                if vehicles[yields].intent == Intent::Stop {
                    ask(*other, Verdict::Hold(Reason::TooClose));
                }
            }
        }
    }
    verdicts
}

#[cfg(test)]
mod tests;
