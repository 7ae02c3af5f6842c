//! The plan of a flight, and its check as a whole before anything moves.

use std::collections::BTreeMap;
use std::time::Duration;

use nalgebra::Point3;

use volery_scene::Occupancy;

use super::{Air, Breach, Geofence, Obstruction, Separation, closest_approach};
use crate::VehicleId;
use crate::motion::{MotionLimits, Segment, Trajectory};

/// Relative excess over a limit that is rounding and not a fault.
const ROUNDING: f64 = 1e-6;

/// What a plan must keep to.
#[derive(Debug, Clone, PartialEq)]
pub struct Rules {
    /// Speeds and accelerations.
    pub limits: MotionLimits,
    /// Distance between vehicles.
    pub separation: Separation,
    /// Where vehicles may be.
    pub geofence: Geofence,
    /// Where there is room, as far as that is known.
    pub air: Option<Air>,
    /// Ways, from the start of the plan on, of vehicles in the air that do not belong to it.
    pub others: BTreeMap<VehicleId, Trajectory>,
    /// Largest distance of a vehicle from the start of its way. Meters.
    pub start_tolerance: f64,
    /// Whether the map is in meters: one that is not can place a camera but not fly a vehicle.
    pub metric_map: bool,
}

/// The timed ways of all vehicles on one clock.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FlightPlan {
    /// Way of each vehicle.
    pub ways: BTreeMap<VehicleId, Trajectory>,
    /// When everybody has reached the first goals, the second ones and so on.
    pub stages: Vec<Duration>,
}

/// Why a plan is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Violation {
    /// The map has no scale.
    #[error("the map has no metric scale")]
    MapNotMetric,
    /// Nobody flies.
    #[error("the plan has no vehicles")]
    NoVehicles,
    /// A limit, distance or weight of the rules is not a positive number.
    #[error("a rule of the plan is not a positive number")]
    BadRules,
    /// A way has a number that is infinite or NaN.
    #[error("the way of vehicle {} is not made of finite numbers", .vehicle.0)]
    NotFinite {
        /// Whose way.
        vehicle: VehicleId,
    },
    /// A way jumps in place, speed or time.
    #[error("the way of vehicle {} jumps after {:.2} s", .vehicle.0, .at.as_secs_f64())]
    Jump {
        /// Whose way.
        vehicle: VehicleId,
        /// When.
        at: Duration,
    },
    /// A way is faster than its limit.
    #[error("vehicle {} exceeds its {what} of {limit:.2} with {value:.2} after {:.2} s", .vehicle.0, .at.as_secs_f64())]
    TooFast {
        /// Whose way.
        vehicle: VehicleId,
        /// Which limit: `speed`, `climb_speed`, `acceleration` or `yaw_rate`.
        what: &'static str,
        /// When.
        at: Duration,
        /// How much. SI and radians.
        value: f64,
        /// How much is allowed.
        limit: f64,
    },
    /// Two vehicles come too near to each other.
    #[error("vehicles {} and {} come within {distance:.2} m after {:.2} s, {required:.2} m are required", .first.0, .second.0, .at.as_secs_f64())]
    TooClose {
        /// One vehicle.
        first: VehicleId,
        /// The other.
        second: VehicleId,
        /// When they are nearest.
        at: Duration,
        /// Distance that counts. Meters.
        distance: f64,
        /// Distance required. Meters.
        required: f64,
    },
    /// A way leaves the fence.
    #[error("vehicle {} leaves the fence ({}) after {:.2} s at ({:.2}, {:.2}, {:.2})", .vehicle.0, .breach.code(), .at.as_secs_f64(), .place.x, .place.y, .place.z)]
    OutOfFence {
        /// Whose way.
        vehicle: VehicleId,
        /// Which rule of the fence.
        breach: Breach,
        /// When first.
        at: Duration,
        /// Where first.
        place: Point3<f64>,
    },
    /// A way leads where there is no room.
    #[error("vehicle {} meets {} after {:.2} s at ({:.2}, {:.2}, {:.2})", .vehicle.0, met(.occupancy), .at.as_secs_f64(), .place.x, .place.y, .place.z)]
    NotFree {
        /// Whose way.
        vehicle: VehicleId,
        /// What is there.
        occupancy: Occupancy,
        /// When first.
        at: Duration,
        /// Where first.
        place: Point3<f64>,
    },
    /// Nobody knows where a vehicle is.
    #[error("the place of vehicle {} is unknown", .vehicle.0)]
    PlaceUnknown {
        /// Which one.
        vehicle: VehicleId,
    },
    /// A vehicle is not where its way starts.
    #[error("vehicle {} is {distance:.2} m from its start, {allowed:.2} m are allowed", .vehicle.0)]
    NotAtStart {
        /// Which one.
        vehicle: VehicleId,
        /// Distance to the start. Meters.
        distance: f64,
        /// Distance allowed. Meters.
        allowed: f64,
    },
}

impl Violation {
    /// Stable name for programs.
    pub fn code(&self) -> &'static str {
        match self {
            Self::MapNotMetric => "map_not_metric",
            Self::NoVehicles => "no_vehicles",
            Self::BadRules => "bad_rules",
            Self::NotFinite { .. } => "not_finite",
            Self::Jump { .. } => "jump",
            Self::TooFast { .. } => "too_fast",
            Self::TooClose { .. } => "too_close",
            Self::OutOfFence { .. } => "out_of_fence",
            Self::NotFree { .. } => "not_free",
            Self::PlaceUnknown { .. } => "place_unknown",
            Self::NotAtStart { .. } => "not_at_start",
        }
    }
}

impl FlightPlan {
    /// Time until the last vehicle has arrived.
    pub fn duration(&self) -> Duration {
        self.ways.values().map(Trajectory::duration).max().unwrap_or_default()
    }

    /// Everything that is wrong with the plan itself: empty if it may be flown.
    pub fn check(&self, rules: &Rules) -> Vec<Violation> {
        let mut found = Vec::new();
        if !rules.metric_map {
            found.push(Violation::MapNotMetric);
        }
        if self.ways.is_empty() {
            found.push(Violation::NoVehicles);
        }
        if !(rules.limits.are_positive() && rules.separation.is_valid()) {
            found.push(Violation::BadRules);
            return found;
        }
        for (&vehicle, way) in &self.ways {
            found.extend(check_way(vehicle, way, rules));
        }
        if !found.iter().any(|v| matches!(v, Violation::NotFinite { .. })) {
            found.extend(self.close_pairs(&rules.others, &rules.separation));
        }
        found
    }

    /// Pairs that come nearer than allowed, each at its nearest; those of the plan among each
    /// other and with `others`.
    pub fn close_pairs(
        &self,
        others: &BTreeMap<VehicleId, Trajectory>,
        separation: &Separation,
    ) -> Vec<Violation> {
        let mut found = Vec::new();
        for (index, (&first, a)) in self.ways.iter().enumerate() {
            for (&second, b) in self.ways.iter().skip(index + 1).chain(others) {
                let nearest = closest_approach(a, b, separation);
                if nearest.distance < separation.distance * (1.0 - ROUNDING) {
                    found.push(Violation::TooClose {
                        first,
                        second,
                        at: nearest.at,
                        distance: nearest.distance,
                        required: separation.distance,
                    });
                }
            }
        }
        found
    }

    /// Vehicles that are not where their ways start; `places` are those known.
    pub fn check_starts(
        &self,
        places: &BTreeMap<VehicleId, Point3<f64>>,
        rules: &Rules,
    ) -> Vec<Violation> {
        let allowed = rules.start_tolerance;
        let check = |(&vehicle, way): (&VehicleId, &Trajectory)| {
            let Some(place) = places.get(&vehicle) else {
                return Some(Violation::PlaceUnknown { vehicle });
            };
            let distance = (place - way.start().position).norm();
            let near = distance <= allowed; // false for NaN
            (!near).then_some(Violation::NotAtStart { vehicle, distance, allowed })
        };
        self.ways.iter().filter_map(check).collect()
    }

    /// Smallest distance of any pair; none for a single vehicle.
    pub fn closest(&self, separation: &Separation) -> Option<f64> {
        let ways: Vec<&Trajectory> = self.ways.values().collect();
        let pairs = (0..ways.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
        pairs.map(|(i, j)| closest_approach(ways[i], ways[j], separation).distance).reduce(f64::min)
    }
}

/// What is wrong with one way: the first excess of each kind.
fn check_way(vehicle: VehicleId, way: &Trajectory, rules: &Rules) -> Vec<Violation> {
    let end = Segment::rest(
        crate::motion::LegKind::Wait,
        way.seconds(),
        0.0,
        way.end().position,
        way.end().yaw,
    );
    let segments = || way.segments().iter().chain([&end]);
    if !segments().all(Segment::is_finite) {
        return vec![Violation::NotFinite { vehicle }];
    }
    let mut found = Vec::new();
    found.extend(jump(segments()).map(|at| Violation::Jump { vehicle, at }));
    let limits = &rules.limits;
    type Quantity = fn(&Segment, f64) -> f64;
    let quantities: [(&'static str, f64, Quantity); 4] = [
        ("speed", limits.speed, |s, t| s.velocity_at(t).xy().norm()),
        ("climb_speed", limits.climb_speed, |s, t| s.velocity_at(t).z.abs()),
        ("acceleration", limits.acceleration, |s, _| s.acceleration.norm()),
        ("yaw_rate", limits.yaw_rate, |s, t| (s.yaw_rate + s.yaw_acceleration * t).abs()),
    ];
    for (what, limit, quantity) in quantities {
        // Each is convex in time on a piece and so largest at one of its ends.
        let ends = segments().flat_map(|s| [(s, 0.0), (s, s.duration)]);
        let excess = ends
            .map(|(s, t)| (s.start + t, quantity(s, t)))
            .find(|(_, value)| *value > limit * (1.0 + ROUNDING));
        found.extend(excess.map(|(t, value)| {
            let at = Duration::from_secs_f64(t);
            Violation::TooFast { vehicle, what, at, value, limit }
        }));
    }
    found.extend(leaves_fence(segments(), &rules.geofence).map(|(breach, at, place)| {
        Violation::OutOfFence { vehicle, breach, at: Duration::from_secs_f64(at), place }
    }));
    let obstruction = rules.air.as_ref().and_then(|air| air.obstruction(segments()));
    found.extend(obstruction.map(|Obstruction { occupancy, at, place }| {
        let at = Duration::from_secs_f64(at);
        Violation::NotFree { vehicle, occupancy, at, place }
    }));
    found
}

fn met(occupancy: &Occupancy) -> &'static str {
    match occupancy {
        Occupancy::Occupied => "an obstacle",
        _ => "space that nobody has seen",
    }
}

/// First time at which a piece does not go on where the one before it ended.
fn jump<'a>(segments: impl Iterator<Item = &'a Segment> + Clone) -> Option<Duration> {
    let first = segments.clone().next()?;
    if first.start != 0.0 || first.velocity.norm() > ROUNDING {
        return Some(Duration::ZERO);
    }
    let broken = segments.clone().zip(segments.skip(1)).find(|(a, b)| {
        (a.end() - b.start).abs() > ROUNDING
            || (a.position_at(a.duration) - b.position).norm() > ROUNDING
            || (a.velocity_at(a.duration) - b.velocity).norm() > ROUNDING
            || (a.yaw_at(a.duration) - b.yaw).abs() > ROUNDING
    })?;
    Some(Duration::from_secs_f64(broken.0.end()))
}

/// The first breach of the fence: rule, time and place.
fn leaves_fence<'a>(
    mut segments: impl Iterator<Item = &'a Segment>,
    fence: &Geofence,
) -> Option<(Breach, f64, Point3<f64>)> {
    segments.find_map(|s| {
        // Pieces from rest to rest are straight and do not turn back.
        let until = |t: f64| fence.breach_between(&s.position, &s.position_at(t));
        let mut breach = until(s.duration)?;
        let (mut low, mut high) = (0.0, s.duration);
        if let Some(at_once) = until(0.0) {
            (breach, high) = (at_once, 0.0);
        }
        while high - low > 1e-6 {
            let middle = 0.5 * (low + high);
            match until(middle) {
                Some(earlier) => (breach, high) = (earlier, middle),
                None => low = middle,
            }
        }
        Some((breach, s.start + high, s.position_at(high)))
    })
}

#[cfg(test)]
mod tests;
