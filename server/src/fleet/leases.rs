//! Who has promised to be there for which drones.

use std::{collections::BTreeMap, time::Duration};

use uuid::Uuid;
use volery_api::{CreateLease, Lease};
use volery_flight::{Fleet, VehicleId};

use crate::{auth::Caller, idempotency::Identity};

/// Shortest and longest time between renewals, milliseconds.
const TTL_MS: std::ops::RangeInclusive<u32> = 200..=60_000;
/// Most drones of one lease.
const MAX_DRONES: usize = 100;

/// Why drones do not follow, or a lease does not change.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub(crate) enum LeaseRefusal {
    /// Somebody has a lease of it.
    #[error("drone {drone} is leased by {holder} for another {left_ms} ms")]
    Leased {
        /// Which one.
        drone: u8,
        /// Name of the token.
        holder: String,
        /// Unless it is renewed.
        left_ms: u32,
    },
    /// It was not heard.
    #[error("drone {0} was not heard")]
    NotHeard(u8),
    /// The drones or the time make no sense.
    #[error("a lease has 1 to {MAX_DRONES} drones and lasts {} to {} ms", TTL_MS.start(), TTL_MS.end())]
    Bad,
    /// It is over, or never was.
    #[error("there is no lease {0}; when a lease is over its drones hold")]
    Over(Uuid),
    /// Another token has it.
    #[error("lease {0} is held by another token")]
    NotHolder(Uuid),
}

/// Leases that are not over.
#[derive(Debug, Default)]
pub(super) struct Leases(BTreeMap<Uuid, Held>);

#[derive(Debug)]
struct Held {
    token: Uuid,
    holder: String,
    drones: Vec<u8>,
    ttl_ms: u32,
    until: Duration,
}

impl Leases {
    /// Takes drones that nobody has.
    pub(super) fn take(
        &mut self,
        caller: &Caller,
        identity: Identity,
        request: &CreateLease,
        fleet: &mut Fleet,
        now: Duration,
    ) -> Result<Lease, LeaseRefusal> {
        self.forget(now);
        if self.0.get(&identity.id).is_some_and(|held| held.token == caller.id) {
            // The same request again.
            return self.renew(caller, identity.id, fleet, now);
        }
        let mut drones = request.drones.clone();
        drones.sort_unstable();
        drones.dedup();
        if !(1..=MAX_DRONES).contains(&drones.len()) || !TTL_MS.contains(&request.ttl_ms) {
            return Err(LeaseRefusal::Bad);
        }
        for &drone in &drones {
            if fleet.vehicle(VehicleId(drone)).is_none() {
                return Err(LeaseRefusal::NotHeard(drone));
            }
            if let Some(held) = self.of(drone, now) {
                return Err(held.refusal(drone, now));
            }
        }
        let (token, holder, ttl_ms) = (caller.id, caller.name.clone(), request.ttl_ms);
        self.0.insert(identity.id, Held { token, holder, drones, ttl_ms, until: now });
        self.renew(caller, identity.id, fleet, now)
    }

    /// From now on it lasts for its whole time again.
    pub(super) fn renew(
        &mut self,
        caller: &Caller,
        id: Uuid,
        fleet: &mut Fleet,
        now: Duration,
    ) -> Result<Lease, LeaseRefusal> {
        let held = self.own(caller, id)?;
        held.until = now + Duration::from_millis(held.ttl_ms.into());
        for &drone in &held.drones {
            fleet.lease(VehicleId(drone), Some(held.until));
        }
        Ok(held.lease(id, now))
    }

    /// Its time is over now.
    pub(super) fn release(
        &mut self,
        caller: &Caller,
        id: Uuid,
        fleet: &mut Fleet,
        now: Duration,
    ) -> Result<(), LeaseRefusal> {
        for &drone in &self.own(caller, id)?.drones {
            fleet.lease(VehicleId(drone), Some(now));
        }
        self.0.remove(&id);
        Ok(())
    }

    /// Whether a token may command a drone.
    pub(super) fn allow(&self, token: Uuid, drone: u8, now: Duration) -> Result<(), LeaseRefusal> {
        match self.of(drone, now) {
            Some(held) if held.token != token => Err(held.refusal(drone, now)),
            _ => Ok(()),
        }
    }

    /// All, in the order in which they began.
    pub(super) fn list(&self, now: Duration) -> Vec<Lease> {
        self.0
            .iter()
            .filter(|(_, held)| held.until > now)
            .map(|(&id, h)| h.lease(id, now))
            .collect()
    }

    /// Those that are over; the fleet has seen to their drones.
    pub(super) fn forget(&mut self, now: Duration) {
        self.0.retain(|_, held| held.until > now);
    }

    fn of(&self, drone: u8, now: Duration) -> Option<&Held> {
        self.0.values().find(|held| held.until > now && held.drones.contains(&drone))
    }

    fn own(&mut self, caller: &Caller, id: Uuid) -> Result<&mut Held, LeaseRefusal> {
        match self.0.get_mut(&id) {
            None => Err(LeaseRefusal::Over(id)),
            Some(held) if held.token != caller.id => Err(LeaseRefusal::NotHolder(id)),
            Some(held) => Ok(held),
        }
    }
}

impl Held {
    fn left_ms(&self, now: Duration) -> u32 {
        self.until.saturating_sub(now).as_millis() as u32
    }

    fn refusal(&self, drone: u8, now: Duration) -> LeaseRefusal {
        LeaseRefusal::Leased { drone, holder: self.holder.clone(), left_ms: self.left_ms(now) }
    }

    fn lease(&self, id: Uuid, now: Duration) -> Lease {
        Lease {
            id,
            holder: self.holder.clone(),
            drones: self.drones.clone(),
            ttl_ms: self.ttl_ms,
            left_ms: self.left_ms(now),
        }
    }
}
