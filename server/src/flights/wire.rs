//! Flights on the wire.

use uuid::Uuid;
use volery_api::{Flight, FlightLeg, FlightNews, FlightWay};
use volery_flight::{VehicleId, group::FlightEvent, motion::Trajectory};

use super::Entry;

pub(super) fn flight(id: Uuid, entry: &Entry) -> Flight {
    let coordinator = entry.conductor.coordinator();
    let plan = coordinator.plan();
    let out: Vec<VehicleId> = coordinator.taken_out().collect();
    Flight {
        id,
        map_id: entry.map,
        state: coordinator.state().code().to_owned(),
        taking_off: entry.conductor.is_beginning(),
        clock_s: coordinator.clock().as_secs_f64(),
        duration_s: plan.duration().as_secs_f64(),
        closest_m: plan.closest(&coordinator.options().rules.separation),
        clock_held_by: coordinator.clock_held_by().map(|vehicle| vehicle.0),
        drones: plan
            .ways
            .iter()
            .map(|(vehicle, way)| FlightWay {
                id: vehicle.0,
                start: way.start().position.into(),
                legs: legs(way),
                taken_out: out.contains(vehicle),
            })
            .collect(),
        events: entry.news.iter().cloned().collect(),
    }
}

pub(super) fn legs(way: &Trajectory) -> Vec<FlightLeg> {
    let leg = |(kind, start_s, end_s): (volery_flight::motion::LegKind, f64, f64)| {
        let end = way.sample(std::time::Duration::from_secs_f64(end_s));
        FlightLeg {
            kind: kind.code().to_owned(),
            start_s,
            end_s,
            to: end.position.into(),
            yaw: end.yaw,
        }
    };
    way.legs().map(leg).collect()
}

pub(super) fn news(event: &FlightEvent, t_ns: u64) -> FlightNews {
    let (kind, drone, value) = match event {
        FlightEvent::State(state) => ("state", None, Some(state.code())),
        FlightEvent::Leg { vehicle, kind, .. } => ("leg", Some(vehicle), Some(kind.code())),
        FlightEvent::Held { vehicle, reason } => ("held", Some(vehicle), Some(reason.code())),
        FlightEvent::Released { vehicle } => ("released", Some(vehicle), None),
        FlightEvent::ClockHeld { vehicle } => ("clock_held", Some(vehicle), None),
        FlightEvent::ClockRuns => ("clock_runs", None, None),
        FlightEvent::TakenOut { vehicle, reason } => {
            ("taken_out", Some(vehicle), Some(reason.map_or("aborted", |reason| reason.code())))
        }
        FlightEvent::Landed { vehicle } => ("landed", Some(vehicle), None),
        FlightEvent::Replanned => ("replanned", None, None),
        FlightEvent::NoWay { vehicle } => ("no_way", Some(vehicle), None),
    };
    FlightNews {
        t_ns,
        kind: kind.to_owned(),
        drone: drone.map(|vehicle| vehicle.0),
        value: value.map(str::to_owned),
    }
}
