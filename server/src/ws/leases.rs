//! Leases that end with their socket.

use std::{collections::BTreeSet, sync::Arc};

use uuid::Uuid;
use volery_api::{
    CreateLease, Role,
    ws::{ClientBody, ServerBody},
};

use crate::{
    auth::Caller,
    clock,
    error::{ApiError, ApiResult, Code},
    idempotency::Identity,
    routes::leases,
    state::App,
    store::NewAuditEntry,
};

/// What a caller holds through one socket: given back when this is dropped.
pub(super) struct Leases {
    app: Arc<App>,
    caller: Caller,
    held: BTreeSet<Uuid>,
}

impl Leases {
    /// Of none yet.
    pub(super) fn new(app: &Arc<App>, caller: &Caller) -> Self {
        Self { app: Arc::clone(app), caller: caller.clone(), held: BTreeSet::new() }
    }

    /// Takes drones.
    pub(super) fn take(&mut self, request: &CreateLease) -> ApiResult<ServerBody> {
        let taken = if self.caller.role < Role::Pilot {
            Err(ApiError::new(Code::Forbidden, "only a pilot leases drones"))
        } else {
            leases::take(&self.app, &self.caller, Identity::fresh(), request)
        };
        self.note(taken.as_ref().err(), &ClientBody::Lease(request.clone()));
        let lease = taken?;
        self.held.insert(lease.id);
        Ok(ServerBody::Leased { lease })
    }

    /// Renews one, whichever way it was taken.
    pub(super) fn renew(&self, id: Uuid) -> ApiResult<ServerBody> {
        leases::renew(&self.app, &self.caller, id).map(|lease| ServerBody::Leased { lease })
    }

    /// Gives one back, whichever way it was taken.
    pub(super) fn release(&mut self, id: Uuid) -> ApiResult<ServerBody> {
        let released = leases::release(&self.app, &self.caller, id);
        self.note(released.as_ref().err(), &ClientBody::LeaseRelease { lease_id: id });
        self.held.remove(&id);
        released.map(|()| ServerBody::LeaseReleased { lease_id: id })
    }

    fn note(&self, refusal: Option<&ApiError>, said: &ClientBody) {
        self.app.audit(NewAuditEntry {
            time_ms: clock::now_ms(),
            caller: self.caller.clone(),
            method: "WS".to_owned(),
            path: "/v1/ws".to_owned(),
            status: refusal.map_or(200, |error| error.problem().status),
            detail: serde_json::to_string(said).ok(),
        });
    }
}

impl Drop for Leases {
    fn drop(&mut self) {
        for id in std::mem::take(&mut self.held) {
            // One that has run out is over already.
            let _ = self.release(id);
        }
    }
}
