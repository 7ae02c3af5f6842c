//! Ways of a group that do not come near each other.

use std::time::Duration;

use nalgebra::{Point3, Vector2};

use super::separation::Separation;
use super::{FlightPlan, Rules, Violation, closest_approach};
use crate::VehicleId;
use crate::motion::{
    Goal, Leg, LegKind, PathStyle, Trajectory, ViewRange, Waypoint, legs, route, with_views,
};

/// Step between the delays that are tried, and the longest.
const DELAY_STEP: f64 = 0.5;
const MAX_DELAY: f64 = 60.0;
/// Sideways bends that are tried, in units of the separation; to the right first.
const BENDS: [f64; 5] = [0.0, -1.2, 1.2, -2.4, 2.4];

/// What one vehicle has to do.
#[derive(Debug, Clone, PartialEq)]
pub struct Task {
    /// Who.
    pub vehicle: VehicleId,
    /// Where it is.
    pub start: Waypoint,
    /// Where it goes, in order. The group goes to its next goals together.
    pub goals: Vec<Goal>,
}

/// How ways are found.
#[derive(Debug, Clone, PartialEq)]
pub struct Deconfliction {
    /// How goals are approached. Heights, bends and delays vary the horizontal-vertical way;
    /// straight ways are only delayed.
    pub style: PathStyle,
    /// Views to compare frames with on the way, if any.
    pub views: Option<ViewRange>,
    /// Distance planned beyond the required one: what vehicles stray from their ways. Meters.
    pub margin: f64,
    /// Places of vehicles on the ground. Their propellers stand, so heights count fully, and they
    /// do not stray.
    pub obstacles: Vec<Point3<f64>>,
}

impl Default for Deconfliction {
    /// Horizontal-vertical ways without views; one vehicle lags by 0.5 m.
    fn default() -> Self {
        Self { style: PathStyle::default(), views: None, margin: 0.5, obstacles: Vec::new() }
    }
}

/// No ways were found.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("no way for vehicle {} keeps all rules", .vehicle.0)]
pub struct Unplannable {
    /// Who finds no way.
    pub vehicle: VehicleId,
    /// What its shortest way breaks.
    pub violations: Vec<Violation>,
}

/// Ways of all vehicles to their goals, apart from each other by the rules' distance and the
/// margin, from everybody's first goal on to the next.
///
/// Vehicles are planned one after another: each takes, of all ways that keep clear of those
/// planned before, the one that arrives first. Ways differ in the height of their level part, a
/// bend sideways and the time waited before it; the first is the plain one, so that nobody who
/// meets nobody is sent round. A vehicle that finds no way is planned first in the next round.
/// The order is that of the tasks: the same tasks give the same plan.
///
/// # Errors
///
/// [`Unplannable`] names a vehicle that found none even when planned first or whose promotion
/// went in circles, with what its plain way breaks.
pub fn deconflict(
    tasks: &[Task],
    rules: &Rules,
    how: &Deconfliction,
) -> Result<FlightPlan, Unplannable> {
    let mut plan = FlightPlan::default();
    for task in tasks {
        plan.ways.insert(task.vehicle, Trajectory::standing(task.start));
    }
    let stages = tasks.iter().map(|task| task.goals.len()).max().unwrap_or(0);
    for stage in 0..stages {
        let moves: Vec<Move> = tasks
            .iter()
            .map(|task| Move {
                vehicle: task.vehicle,
                start: plan.ways[&task.vehicle].end(),
                goal: task.goals.get(stage).copied(),
            })
            .collect();
        let ways = transfer(&moves, rules, how)?;
        let end = ways.iter().map(|(_, way)| way.duration()).max().unwrap_or_default();
        for (vehicle, mut way) in ways {
            way.stay(LegKind::Wait, end.saturating_sub(way.duration()));
            if let Some(whole) = plan.ways.get_mut(&vehicle) {
                whole.append(&way);
            }
        }
        plan.stages.push(plan.duration());
    }
    Ok(plan)
}

/// One vehicle's part of a stage; without a goal it stays.
struct Move {
    vehicle: VehicleId,
    start: Waypoint,
    goal: Option<Goal>,
}

type Way = (VehicleId, Trajectory);

/// Ways from all starts to all goals, everybody leaving at once.
fn transfer(moves: &[Move], rules: &Rules, how: &Deconfliction) -> Result<Vec<Way>, Unplannable> {
    // Those who stay cannot give way, so they come first.
    let mut order: Vec<usize> = (0..moves.len()).collect();
    order.sort_by_key(|&index| moves[index].goal.is_some());
    let candidates: Vec<Vec<Trajectory>> =
        moves.iter().map(|step| ways_of(step, rules, how)).collect();
    let apart = Separation { distance: rules.separation.distance + how.margin, ..rules.separation };
    let mut promotions = vec![0; moves.len()];
    loop {
        let mut found: Vec<Way> = Vec::with_capacity(moves.len());
        let stuck = order.iter().position(|&index| {
            let clear = |way: &&Trajectory| is_clear(way, &found, rules, how, &apart);
            let way = candidates[index].iter().find(clear).cloned();
            let none = way.is_none();
            found.extend(way.map(|way| (moves[index].vehicle, way)));
            none
        });
        let Some(place) = stuck else { return Ok(found) };
        let index = order.remove(place);
        promotions[index] += 1;
        if place == 0 || promotions[index] > moves.len() {
            return Err(refusal(moves, index, rules, how, &apart));
        }
        order.insert(0, index);
    }
}

/// Whether a way keeps clear of obstacles and of all ways found so far.
fn is_clear(
    way: &Trajectory,
    found: &[Way],
    rules: &Rules,
    how: &Deconfliction,
    apart: &Separation,
) -> bool {
    // A whisker less than required is rounding.
    let clear = |other: &Trajectory, apart: &Separation| {
        closest_approach(way, other, apart).distance >= apart.distance - 1e-6
    };
    let ground = Separation { distance: apart.distance - 0.5 * how.margin, vertical_weight: 1.0 };
    let standing = |position| Trajectory::standing(Waypoint { position, yaw: 0.0 });
    found.iter().all(|(_, other)| clear(other, apart))
        && rules.others.values().all(|other| clear(other, apart))
        && how.obstacles.iter().all(|&place| clear(&standing(place), &ground))
}

/// All ways of one vehicle that keep to limits and fence, the earliest arrival first.
fn ways_of(step: &Move, rules: &Rules, how: &Deconfliction) -> Vec<Trajectory> {
    let Some(goal) = step.goal else { return vec![Trajectory::standing(step.start)] };
    let mut ways = Vec::new();
    for way in routes(step.start, &goal, rules, how) {
        for delay in 0..=(MAX_DELAY / DELAY_STEP) as usize {
            let delay = Duration::from_secs_f64(delay as f64 * DELAY_STEP);
            ways.push(timed(step.start, &way, delay, rules, how));
            if delay.is_zero() && !has_room(&ways[ways.len() - 1], rules) {
                ways.pop(); // nor will it later
                break;
            }
        }
    }
    ways.sort_by_key(Trajectory::duration); // stable: plain ways before others of equal length
    ways
}

/// Legs of the ways that differ in space.
fn routes(start: Waypoint, goal: &Goal, rules: &Rules, how: &Deconfliction) -> Vec<Vec<Leg>> {
    if how.style == PathStyle::Straight {
        return vec![legs(start, goal, how.style)];
    }
    let apart = rules.separation.distance + how.margin;
    let (lowest, highest) = rules.geofence.heights();
    let layer = apart / rules.separation.vertical_weight;
    let mut heights = vec![start.position.z, goal.position.z];
    let mut height = lowest;
    while height <= highest {
        heights.push(height);
        height += 0.5 * layer;
    }
    heights.push(highest);
    let across = (goal.position - start.position).xy();
    let middle = start.position.xy().coords + across * 0.5;
    let left = Vector2::new(-across.y, across.x).try_normalize(1e-3);
    let mut routes = Vec::new();
    for (index, &height) in heights.iter().enumerate() {
        if heights[..index].iter().any(|other| (other - height).abs() < 0.05) {
            continue;
        }
        routes.push(route(start, goal, height, &[]));
        if let Some(left) = left {
            let bent = |bend: &f64| route(start, goal, height, &[middle + left * (bend * apart)]);
            routes.extend(BENDS[1..].iter().map(bent));
        }
    }
    routes
}

/// The legs flown after a wait, which comes when the height of the level part is reached.
fn timed(
    start: Waypoint,
    legs: &[Leg],
    delay: Duration,
    rules: &Rules,
    how: &Deconfliction,
) -> Trajectory {
    let climbs = legs.first().is_some_and(|leg| leg.kind == LegKind::Vertical) && legs.len() > 1;
    let (before, after) = legs.split_at(usize::from(climbs));
    let mut way = Trajectory::along(start, before, &rules.limits);
    way.stay(LegKind::Wait, delay);
    let rest = match &how.views {
        Some(views) => with_views(way.end(), after, views, &rules.limits),
        None => Trajectory::along(way.end(), after, &rules.limits),
    };
    way.append(&rest);
    way
}

/// Whether a way keeps to the fence and to the air.
fn has_room(way: &Trajectory, rules: &Rules) -> bool {
    let inside = |s: &crate::motion::Segment| {
        rules.geofence.breach_between(&s.position, &s.position_at(s.duration)).is_none()
    };
    way.segments().iter().all(inside)
        && rules.geofence.breach(&way.end().position).is_none()
        && rules.air.as_ref().is_none_or(|air| air.obstruction(way.segments()).is_none())
}

/// What the plain way of a vehicle breaks while the others fly theirs.
fn refusal(
    moves: &[Move],
    index: usize,
    rules: &Rules,
    how: &Deconfliction,
    apart: &Separation,
) -> Unplannable {
    let plain = |step: &Move| {
        let legs = step.goal.map(|goal| legs(step.start, &goal, how.style)).unwrap_or_default();
        timed(step.start, &legs, Duration::ZERO, rules, how)
    };
    let ways = moves.iter().map(|step| (step.vehicle, plain(step))).collect();
    let vehicle = moves[index].vehicle;
    let concerns = |violation: &Violation| match violation {
        Violation::TooClose { first, second, .. } => [*first, *second].contains(&vehicle),
        Violation::OutOfFence { vehicle: other, .. }
        | Violation::NotFree { vehicle: other, .. } => *other == vehicle,
        _ => true,
    };
    let rules = Rules { separation: *apart, ..rules.clone() };
    let mut violations = FlightPlan { ways, stages: Vec::new() }.check(&rules);
    violations.retain(concerns);
    Unplannable { vehicle, violations }
}

#[cfg(test)]
mod tests;
