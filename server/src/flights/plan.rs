//! A request for a flight to its plan.

use std::collections::BTreeMap;

use nalgebra::{Point2, Point3};
use uuid::Uuid;
use volery_api::{CreateFlight, FenceBlock, FlightGoal, Geofence as FenceOnWire};
use volery_flight::{
    Fleet, VehicleId,
    group::{
        Air, Conductor, Coordinator, Deconfliction, FlightOptions, Geofence, Prism, Rules,
        Separation, Task, Violation, assign, deconflict, sight,
    },
    motion::{Goal, MotionLimits, Trajectory, ViewRange, Waypoint},
};

use super::target::style;
use crate::error::{ApiError, ApiResult, Code};

/// Distance of a vehicle from the start of its way. Meters.
const START_TOLERANCE: f64 = 0.3;
/// Distance to the bounds of a map without a fence. Meters.
const BOUNDS_MARGIN: f64 = 0.5;
/// Violations told in one answer.
const MAX_TOLD: usize = 5;

/// Ways of vehicles.
pub(crate) type Ways = BTreeMap<VehicleId, Trajectory>;

/// What a flight flies in.
#[derive(Debug)]
pub(crate) struct Space {
    pub(crate) map: Uuid,
    pub(crate) fence: Geofence,
    pub(crate) metric: bool,
    /// Where there is room; none if the map does not say.
    pub(crate) air: Option<Air>,
}

impl Space {
    /// The fence of a map, or its bounds; `info` is the map's description.
    pub(crate) fn of(
        map: Uuid,
        info: &serde_json::Value,
        fence: Option<&FenceOnWire>,
    ) -> ApiResult<Self> {
        let fence = match fence {
            Some(fence) => parse_fence(fence)?,
            None => {
                let bounds = serde_json::from_value::<[[f64; 3]; 2]>(info["bounds"].clone());
                let around = bounds.ok().and_then(|[low, high]| {
                    Geofence::around(&low.into(), &high.into(), BOUNDS_MARGIN).ok()
                });
                around.ok_or_else(|| {
                    ApiError::new(Code::Conflict("no_geofence"), "the map has no fence or bounds")
                        .hint("PUT /v1/geofences")
                })?
            }
        };
        let metric = info["scale"]["metric"].as_bool().unwrap_or(false);
        Ok(Self { map, fence, metric, air: None })
    }
}

/// Checks a fence.
pub(crate) fn parse_fence(fence: &FenceOnWire) -> ApiResult<Geofence> {
    let prism = |block: &FenceBlock| Prism {
        outline: block.outline.iter().map(|&[x, y]| Point2::new(x, y)).collect(),
        floor: block.floor,
        ceiling: block.ceiling,
    };
    let keep_out = fence.keep_out.iter().map(prism).collect();
    Geofence::new(prism(&fence.area), keep_out, fence.margin_m)
        .map_err(|error| ApiError::new(Code::Unprocessable("bad_geofence"), error.to_string()))
}

/// What plans in `space` must keep to; usual speeds and distances where none are given.
pub(super) fn rules(
    space: Space,
    speed: Option<f64>,
    separation_m: Option<f64>,
    others: Ways,
) -> ApiResult<Rules> {
    let mut limits = MotionLimits::default();
    limits.speed = speed.unwrap_or(limits.speed);
    let mut separation = Separation::default();
    separation.distance = separation_m.unwrap_or(separation.distance);
    if !(limits.are_positive() && separation.is_valid()) {
        return Err(refused(&[Violation::BadRules]));
    }
    Ok(Rules {
        limits,
        separation,
        geofence: space.fence,
        air: space.air,
        others,
        start_tolerance: START_TOLERANCE,
        metric_map: space.metric,
    })
}

/// Plans a flight and checks the plan. `others` are the ways of those who fly without it.
pub(crate) fn plan(
    request: &CreateFlight,
    space: Space,
    fleet: &Fleet,
    others: Ways,
) -> ApiResult<Conductor> {
    let rules = rules(space, request.speed, request.separation_m, others)?;
    if !rules.metric_map {
        return Err(refused(&[Violation::MapNotMetric]));
    }
    let mut how = Deconfliction {
        style: style(request.style),
        views: request.views.then(ViewRange::default),
        ..Deconfliction::default()
    };
    how.margin = request.margin_m.unwrap_or(how.margin);
    if !(how.margin.is_finite() && how.margin >= 0.0) {
        return Err(refused(&[Violation::BadRules]));
    }
    let mut tasks = tasks(request, fleet)?;
    if request.exchange_goals {
        exchange_goals(&mut tasks)?;
    }
    let plan = deconflict(&tasks, &rules, &how).map_err(|none| {
        if none.violations.is_empty() {
            ApiError::new(Code::Unprocessable("no_way"), none.to_string())
        } else {
            refused(&none.violations)
        }
    })?;
    let coordinator = Coordinator::new(plan, tasks, FlightOptions::new(rules, how));
    coordinator.map(Conductor::new).map_err(|violations| refused(&violations))
}

/// What each drone has to do, from where it is or shall start.
fn tasks(request: &CreateFlight, fleet: &Fleet) -> ApiResult<Vec<Task>> {
    let seen = sight(fleet);
    let mut tasks: Vec<Task> = Vec::with_capacity(request.drones.len());
    for drone in &request.drones {
        let vehicle = VehicleId(drone.id);
        if tasks.iter().any(|task| task.vehicle == vehicle) {
            let detail = format!("drone {} is named twice", drone.id);
            return Err(ApiError::new(Code::Unprocessable("drone_twice"), detail));
        }
        let start = match drone.start {
            Some(start) => {
                let yaw = start.yaw.or(seen.get(&vehicle).map(|seen| seen.yaw));
                Waypoint { position: start.position.into(), yaw: yaw.unwrap_or(0.0) }
            }
            None => match seen.get(&vehicle).filter(|seen| seen.airborne) {
                Some(seen) => Waypoint { position: seen.position, yaw: seen.yaw },
                None => {
                    let detail = format!("drone {} does not hover and has no start", drone.id);
                    return Err(ApiError::new(Code::Conflict("place_unknown"), detail)
                        .hint("name a `start` above the place where it stands"));
                }
            },
        };
        let goal = |goal: &FlightGoal| Goal { position: goal.position.into(), yaw: goal.yaw };
        let goals: Vec<Goal> = drone.goals.iter().map(goal).collect();
        let finite = |p: &Point3<f64>| p.iter().all(|v| v.is_finite());
        let places = goals.iter().map(|goal| &goal.position).chain([&start.position]);
        if !places.into_iter().all(finite) {
            return Err(refused(&[Violation::NotFinite { vehicle }]));
        }
        tasks.push(Task { vehicle, start, goals });
    }
    Ok(tasks)
}

/// Gives the goals to the drones so that the sum of squared distances to the first ones is least.
fn exchange_goals(tasks: &mut [Task]) -> ApiResult<()> {
    let goals: Vec<Vec<Goal>> = tasks.iter().map(|task| task.goals.clone()).collect();
    let cost = |task: &Task| {
        let squared = |goals: &Vec<Goal>| {
            let first = goals.first().map_or(task.start.position, |goal| goal.position);
            (first - task.start.position).norm_squared()
        };
        goals.iter().map(squared).collect()
    };
    let costs: Vec<Vec<f64>> = tasks.iter().map(cost).collect();
    let columns = assign(&costs)
        .ok_or_else(|| ApiError::new(Code::Unprocessable("not_finite"), "goals are not finite"))?;
    for (task, column) in tasks.iter_mut().zip(columns) {
        task.goals.clone_from(&goals[column]);
    }
    Ok(())
}

/// Why a plan is not flown: the code of the first reason, all of them in words.
pub(super) fn refused(violations: &[Violation]) -> ApiError {
    let code = match violations.first() {
        Some(Violation::MapNotMetric) => Code::Conflict("map_not_metric"),
        Some(first) => Code::Unprocessable(first.code()),
        None => Code::Unprocessable("no_way"),
    };
    let mut words: Vec<String> =
        violations.iter().take(MAX_TOLD).map(ToString::to_string).collect();
    if violations.len() > MAX_TOLD {
        words.push(format!("and {} more", violations.len() - MAX_TOLD));
    }
    ApiError::new(code, words.join("; "))
}
