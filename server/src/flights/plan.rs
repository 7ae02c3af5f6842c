//! A request for a flight to its plan.

use nalgebra::{Point2, Point3};
use uuid::Uuid;
use volery_api::{CreateFlight, FenceBlock, FlightGoal, FlightStyle, Geofence as FenceOnWire};
use volery_flight::{
    Fleet, VehicleId,
    group::{
        Conductor, Coordinator, Deconfliction, FlightOptions, Geofence, Prism, Rules, Separation,
        Task, Violation, assign, deconflict, sight,
    },
    motion::{Goal, MotionLimits, PathStyle, ViewRange, Waypoint},
};

use crate::error::{ApiError, ApiResult, Code};

/// Distance of a vehicle from the start of its way. Meters.
const START_TOLERANCE: f64 = 0.3;
/// Distance to the bounds of a map without a fence. Meters.
const BOUNDS_MARGIN: f64 = 0.5;
/// Violations told in one answer.
const MAX_TOLD: usize = 5;

/// What a flight flies in.
#[derive(Debug)]
pub(crate) struct Space {
    pub(crate) map: Uuid,
    pub(crate) fence: Geofence,
    pub(crate) metric: bool,
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
        Ok(Self { map, fence, metric })
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

/// Plans a flight and checks the plan.
pub(crate) fn plan(request: &CreateFlight, space: Space, fleet: &Fleet) -> ApiResult<Conductor> {
    let mut limits = MotionLimits::default();
    limits.speed = request.speed.unwrap_or(limits.speed);
    let mut separation = Separation::default();
    separation.distance = request.separation_m.unwrap_or(separation.distance);
    let rules = Rules {
        limits,
        separation,
        geofence: space.fence,
        start_tolerance: START_TOLERANCE,
        metric_map: space.metric,
    };
    if !space.metric {
        return Err(refused(&[Violation::MapNotMetric]));
    }
    if !(limits.are_positive() && separation.is_valid()) {
        return Err(refused(&[Violation::BadRules]));
    }
    let mut how = Deconfliction {
        style: match request.style {
            FlightStyle::HorizontalVertical => PathStyle::HorizontalVertical,
            FlightStyle::Straight => PathStyle::Straight,
        },
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
fn refused(violations: &[Violation]) -> ApiError {
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
