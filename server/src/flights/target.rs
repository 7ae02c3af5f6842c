//! A place for one drone to fly to: its legs, and what they are checked against.

use std::time::Duration;

use uuid::Uuid;
use volery_api::{CreateTarget, FlightGoal, FlightStyle, Target, TargetCheck};
use volery_flight::{
    Fleet, VehicleId,
    group::{
        Conductor, Coordinator, Deconfliction, FlightOptions, FlightPlan, Violation,
        closest_approach, sight,
    },
    motion::{Goal, PathStyle, Trajectory, ViewRange, Waypoint, legs, turn_towards, with_views},
};

use super::{
    plan::{Space, Ways, refused, rules},
    wire,
};
use crate::error::{ApiError, ApiResult, Code};

/// What is planned for a drone: what is told of it, and the flight, if it may be flown.
pub(crate) struct PlannedTarget {
    pub(crate) target: Target,
    pub(crate) flight: Result<Conductor, ApiError>,
}

/// Plans the way of a drone from where it is.
pub(crate) fn plan_target(
    drone: u8,
    request: &CreateTarget,
    space: Space,
    fleet: &Fleet,
    others: Ways,
    now: Duration,
) -> ApiResult<PlannedTarget> {
    let vehicle = VehicleId(drone);
    let seen = sight(fleet);
    let here = seen.get(&vehicle).ok_or_else(|| {
        let detail = format!("drone {drone} does not say where it is");
        ApiError::new(Code::Conflict("place_unknown"), detail)
    })?;
    let start = Waypoint { position: here.position, yaw: here.yaw };
    let goal = Goal { position: request.position.into(), yaw: request.yaw };
    let finite = |v: &f64| v.is_finite();
    if !(request.position.iter().all(finite) && request.yaw.iter().all(finite)) {
        return Err(refused(&[Violation::NotFinite { vehicle }]));
    }
    let has_air = space.air.is_some();
    let rules = rules(space, request.speed, request.separation_m, others)?;
    let (style, views) = (style(request.style), request.views.then(ViewRange::default));
    let path = legs(start, &goal, style);
    let way = match &views {
        Some(range) => with_views(start, &path, range, &rules.limits),
        None => Trajectory::along(start, &path, &rules.limits),
    };
    let plan = FlightPlan { stages: vec![way.duration()], ways: [(vehicle, way)].into() };
    let found = plan.check(&rules);
    let may_fly = fleet.may_steer(vehicle, now);
    let nearest = rules
        .others
        .values()
        .map(|other| closest_approach(&plan.ways[&vehicle], other, &rules.separation).distance);
    let nearest = nearest.reduce(f64::min);
    let check = |rule: &str, codes: &[&str], known: bool| {
        let broken = found.iter().find(|violation| codes.contains(&violation.code()));
        let state = match broken {
            Some(_) => "failed",
            None if known => "passed",
            None => "unknown",
        };
        let (rule, state) = (rule.to_owned(), state.to_owned());
        TargetCheck { rule, state, detail: broken.map(ToString::to_string) }
    };
    let mut checks = vec![
        check("map_metric", &["map_not_metric"], true),
        check("geofence", &["out_of_fence"], true),
        check("free_space", &["not_free"], has_air),
        check("separation", &["too_close"], true),
        check("limits", &["too_fast", "jump"], true),
    ];
    checks.push(TargetCheck {
        rule: "drone".to_owned(),
        state: if may_fly.is_ok() { "passed" } else { "failed" }.to_owned(),
        detail: may_fly.as_ref().err().map(ToString::to_string),
    });
    let target = Target {
        drone,
        start: FlightGoal { position: start.position.into(), yaw: Some(start.yaw) },
        turn: turn_towards(&start, &goal.position),
        legs: wire::legs(&plan.ways[&vehicle]),
        duration_s: plan.duration().as_secs_f64(),
        closest_m: nearest,
        checks,
        flight_id: None,
    };
    let how = Deconfliction { style, views, ..Deconfliction::default() };
    let flight = match may_fly {
        _ if !found.is_empty() => Err(refused(&found)),
        Err(refusal) => Err(ApiError::new(Code::Conflict(refusal.code()), refusal.to_string())),
        Ok(()) => Coordinator::new(plan, Vec::new(), FlightOptions::new(rules, how))
            .map(Conductor::new)
            .map_err(|violations| refused(&violations)),
    };
    Ok(PlannedTarget { target, flight })
}

pub(super) fn style(style: FlightStyle) -> PathStyle {
    match style {
        FlightStyle::HorizontalVertical => PathStyle::HorizontalVertical,
        FlightStyle::Straight => PathStyle::Straight,
    }
}

/// What is told of a target that is flown to.
pub(crate) fn under_way(target: Target, flight: Uuid) -> Target {
    Target { flight_id: Some(flight), ..target }
}
