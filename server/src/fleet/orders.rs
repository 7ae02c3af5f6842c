//! Who may order what: commands, targets, flights, leases, all-stop.

use uuid::Uuid;
use volery_api::{AllStopped, CreateLease, DroneCommand, DroneCommandStatus, Flight, Lease};
use volery_flight::{Command, CommandRefusal, CommandState, VehicleId, group::Conductor};

use super::{leases::LeaseRefusal, service::Drones, wire};
use crate::{
    auth::Caller,
    clock,
    flights::{FlightRefusal, Wish},
    idempotency::Identity,
};

/// Why a drone is not commanded.
#[derive(Debug, thiserror::Error)]
pub(crate) enum NotCommanded {
    /// Its state forbids it.
    #[error(transparent)]
    Refused(#[from] CommandRefusal),
    /// Somebody else commands it.
    #[error(transparent)]
    Leased(#[from] LeaseRefusal),
    /// It flies in a group.
    #[error(transparent)]
    Busy(#[from] FlightRefusal),
}

impl Drones {
    /// Gives a command.
    pub(crate) fn command(
        &self,
        caller: &Caller,
        id: u8,
        command: &DroneCommand,
    ) -> Result<DroneCommandStatus, NotCommanded> {
        self.shared.with(|state, now| {
            state.leases.allow(caller.id, id, now)?;
            let vehicle = VehicleId(id);
            let here = state.fleet.vehicle(vehicle).and_then(|vehicle| vehicle.here());
            let command = wire::command(command, here);
            let down = matches!(command, Command::Land | Command::CutMotors);
            state.flights.make_way(vehicle, down, clock::now_ns())?;
            let command_id = state.fleet.command(vehicle, &command, now)?;
            Ok(wire::command_status(command_id, vehicle, &CommandState::Accepted))
        })
    }

    /// Starts, pauses, resumes or aborts a flight.
    pub(crate) fn wish(
        &self,
        caller: &Caller,
        id: Uuid,
        wish: Wish,
    ) -> Result<Flight, FlightRefusal> {
        self.shared.with(|state, now| {
            for drone in state.flights.drones(id) {
                state.leases.allow(caller.id, drone.0, now)?;
            }
            state.flights.wish(id, wish, &mut state.fleet, now)
        })
    }

    /// Starts a flight of one drone, in place of what it did before.
    pub(crate) fn fly_to(
        &self,
        caller: &Caller,
        drone: u8,
        map: Uuid,
        conductor: Conductor,
    ) -> Result<Flight, FlightRefusal> {
        self.shared.with(|state, now| {
            state.leases.allow(caller.id, drone, now)?;
            state.flights.make_way(VehicleId(drone), false, clock::now_ns())?;
            let id = Uuid::now_v7();
            state.flights.insert(id, map, conductor)?;
            state.flights.wish(id, Wish::Start, &mut state.fleet, now)
        })
    }

    /// Takes a lease.
    pub(crate) fn lease(
        &self,
        caller: &Caller,
        identity: Identity,
        request: &CreateLease,
    ) -> Result<Lease, LeaseRefusal> {
        self.shared
            .with(|state, now| state.leases.take(caller, identity, request, &mut state.fleet, now))
    }

    /// Renews a lease.
    pub(crate) fn renew_lease(&self, caller: &Caller, id: Uuid) -> Result<Lease, LeaseRefusal> {
        self.shared.with(|state, now| {
            state.leases.forget(now);
            state.leases.renew(caller, id, &mut state.fleet, now)
        })
    }

    /// Ends a lease.
    pub(crate) fn release(&self, caller: &Caller, id: Uuid) -> Result<(), LeaseRefusal> {
        self.shared.with(|state, now| {
            state.leases.forget(now);
            state.leases.release(caller, id, &mut state.fleet, now)
        })
    }

    /// Leases that are not over.
    pub(crate) fn leases(&self) -> Vec<Lease> {
        self.shared.read(|state, now| state.leases.list(now))
    }

    /// Stops all.
    pub(crate) fn all_stop(&self) -> AllStopped {
        self.shared.with(|state, now| {
            state.flights.stop_all(clock::now_ns());
            AllStopped {
                commands: state
                    .fleet
                    .all_stop(now)
                    .into_iter()
                    .map(|(id, command)| wire::command_status(command, id, &CommandState::Accepted))
                    .collect(),
            }
        })
    }
}
