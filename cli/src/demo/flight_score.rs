//! The flight in figures: the simulation's truth against what the map said.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Point3, Quaternion, UnitQuaternion};
use serde::Serialize;
use volery_api::{CameraPose, Flight, FlightNews};
use volery_simulator::shell::State;

use super::{
    flight::Goals,
    record::Record,
    score::{at_quantile, median},
};

/// Distance from a goal that counts as there, meters: what the drones are told.
const THERE: f64 = 0.15;

/// One crossing: where everybody should have been at its end, and was.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Crossing {
    /// As the server planned it and saw its end.
    #[serde(skip)]
    pub(super) plan: Flight,
    /// `finished` or `aborted`.
    pub(super) state: String,
    /// Seconds on the plan.
    pub(super) duration_s: f64,
    /// Nearest approach of two drones on the plan, heights counted half, meters.
    pub(super) planned_separation_m: Option<f64>,
    /// True distance of each drone from its goal, meters.
    pub(super) errors_m: BTreeMap<u8, f64>,
    /// What happened beside the legs.
    pub(super) events: Vec<FlightNews>,
}

/// The flight in figures. Truth is the simulation's; the map is laid on the hall once, rigidly.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct FlightScore {
    pub(crate) drones: usize,
    /// Drones that were at all their goals.
    pub(crate) arrived: usize,
    pub(crate) crossings: Vec<Crossing>,
    /// Absent when no crossing ended.
    pub(crate) arrival_error_max_m: Option<f64>,
    /// Of two drones in the air.
    pub(crate) min_separation_m: Option<f64>,
    pub(crate) pose_error_median_m: f64,
    pub(crate) pose_error_p95_m: f64,
    pub(crate) pose_error_max_m: f64,
    pub(crate) pose_error_median_deg: f64,
    /// Pictures by what came of them.
    pub(crate) frames: BTreeMap<String, usize>,
    /// From the arrival of a picture at the server to its pose.
    pub(crate) server_ms_median: f64,
    pub(crate) server_ms_p95: f64,
    /// What should not have happened.
    pub(crate) mishaps: Vec<String>,
    /// From the first drone in the air to the last one down.
    pub(crate) flight_s: f64,
    /// For the plots.
    #[serde(skip)]
    pub(crate) paths: Vec<DronePaths>,
    /// Distance of the nearest two in the air, by time.
    #[serde(skip)]
    pub(crate) separations: Vec<(f64, f64)>,
}

/// One drone in the hall.
#[derive(Debug, Clone)]
pub(crate) struct DronePaths {
    pub(crate) id: u8,
    /// True places of the feet in the air, by time.
    pub(crate) truth: Vec<(f64, Point3<f64>)>,
    /// Places of the camera by the map.
    pub(crate) believed: Vec<(f64, Point3<f64>)>,
    /// Errors of those, meters.
    pub(crate) errors: Vec<(f64, f64)>,
    /// Goals, where the map has them.
    pub(crate) goals: Vec<Point3<f64>>,
}

/// The end of a crossing against the truth.
pub(super) fn crossing(
    plan: Flight,
    goals: &Goals,
    truth: &BTreeMap<u8, State>,
    world_from_map: &Isometry3<f64>,
) -> Crossing {
    let error = |(&id, goal): (&u8, &Point3<f64>)| {
        let state = truth.get(&id)?;
        Some((id, (Point3::from(state.position) - world_from_map * goal).norm()))
    };
    Crossing {
        state: plan.state.clone(),
        duration_s: plan.duration_s,
        planned_separation_m: plan.closest_m,
        errors_m: goals.iter().filter_map(error).collect(),
        events: plan.events.iter().filter(|event| event.kind != "leg").cloned().collect(),
        plan,
    }
}

pub(super) fn score(
    record: Record,
    crossings: Vec<(Crossing, Goals)>,
    world_from_map: &Isometry3<f64>,
) -> FlightScore {
    let mut paths = Vec::new();
    let (mut errors, mut turns, mut delays) = (Vec::new(), Vec::new(), Vec::new());
    for (&id, states) in &record.states {
        let placed = record.placed.get(&id).map_or(&[][..], Vec::as_slice);
        let found = |pose: &CameraPose| world_from_map * isometry(pose);
        let mut own = Vec::new();
        for frame in placed {
            let (pose, truth) = (found(&frame.pose), isometry(&frame.truth));
            let error = (pose.translation.vector - truth.translation.vector).norm();
            own.push((frame.taken, error));
            errors.push(error);
            turns.push(pose.rotation.angle_to(&truth.rotation).to_degrees());
            delays.push(frame.server_ms);
        }
        let believed =
            placed.iter().map(|f| (f.taken, found(&f.pose).translation.vector.into())).collect();
        let in_air = states.iter().filter(|state| state.flying);
        paths.push(DronePaths {
            id,
            truth: in_air.map(|state| (state.t, state.position.into())).collect(),
            believed,
            errors: own,
            goals: crossings
                .iter()
                .filter_map(|(_, g)| Some(world_from_map * g.get(&id)?))
                .collect(),
        });
    }
    let arrived = |id: &&u8| {
        crossings.iter().all(|(crossing, _)| {
            crossing.state == "finished" && crossing.errors_m.get(id).is_some_and(|e| *e <= THERE)
        })
    };
    let all_arrivals = crossings.iter().flat_map(|(crossing, _)| crossing.errors_m.values());
    let separations = separations(&record);
    let times = || paths.iter().flat_map(|path| path.truth.iter().map(|(t, _)| *t));
    let flight_s = times().fold(0.0, f64::max) - times().fold(f64::INFINITY, f64::min);
    FlightScore {
        drones: record.states.len(),
        arrived: record.states.keys().filter(arrived).count(),
        arrival_error_max_m: all_arrivals.copied().reduce(f64::max),
        min_separation_m: separations.iter().map(|(_, d)| *d).reduce(f64::min),
        pose_error_median_m: median(errors.iter().copied()),
        pose_error_p95_m: at_quantile(errors.iter().copied(), 0.95),
        pose_error_max_m: errors.iter().copied().fold(0.0, f64::max),
        pose_error_median_deg: median(turns.into_iter()),
        server_ms_median: median(delays.iter().copied()),
        server_ms_p95: at_quantile(delays.into_iter(), 0.95),
        separations,
        frames: record.frames,
        mishaps: record.mishaps,
        flight_s: flight_s.max(0.0),
        crossings: crossings.into_iter().map(|(crossing, _)| crossing).collect(),
        paths,
    }
}

impl FlightScore {
    /// All arrive, a meter apart, on poses of centimeters.
    pub(crate) fn is_as_promised(&self) -> bool {
        self.arrived == self.drones
            && self.min_separation_m.is_none_or(|distance| distance >= 1.0)
            && self.pose_error_median_m <= 0.03
    }
}

/// The distance of the nearest two in the air at each time that states were told.
fn separations(record: &Record) -> Vec<(f64, f64)> {
    let mut by_time: BTreeMap<u64, Vec<Point3<f64>>> = BTreeMap::new();
    for state in record.states.values().flatten().filter(|state| state.flying) {
        let tick = (state.t * 1e3).round() as u64;
        by_time.entry(tick).or_default().push(state.position.into());
    }
    let nearest = |places: &[Point3<f64>]| {
        let pairs = (0..places.len()).flat_map(|a| (0..a).map(move |b| (a, b)));
        pairs.map(|(a, b)| (places[a] - places[b]).norm()).reduce(f64::min)
    };
    by_time
        .into_iter()
        .filter_map(|(tick, places)| Some((tick as f64 / 1e3, nearest(&places)?)))
        .collect()
}

fn isometry(pose: &CameraPose) -> Isometry3<f64> {
    let [w, i, j, k] = pose.orientation;
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(w, i, j, k));
    Isometry3::from_parts(pose.position.into(), rotation)
}
