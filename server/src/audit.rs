//! Who did what when: requests that change something, by whom, and how they were answered.
//!
//! Nothing waits for it: entries go through a bounded channel to the database, and what does not
//! fit is counted as lost.

use std::sync::{Arc, OnceLock};

use axum::{
    extract::{Request, State},
    http::{Extensions, Method},
    middleware::Next,
    response::Response,
};
use tokio::sync::mpsc::{Receiver, Sender, channel};

use crate::{auth::Caller, clock, metrics::add, state::App, store::NewAuditEntry};

/// Entries that wait for the database at most.
const MAX_WAITING: usize = 1024;

/// Entries of one transaction at most.
const BATCH: usize = 64;

/// What only asks, or comes many times a second.
const UNRECORDED: [&str; 6] = ["/localize", "/render", "/estimate", "/pose", "/frames", "/renew"];

/// The caller of a request, once that is known.
#[derive(Debug, Clone, Default)]
struct Who(Arc<OnceLock<Caller>>);

/// What a caller asked for in words, for the entry of the request.
#[derive(Debug, Clone)]
pub(crate) struct Detail(pub(crate) String);

/// Remembers who asks.
pub(crate) fn identified(extensions: &Extensions, caller: &Caller) {
    if let Some(who) = extensions.get::<Who>() {
        // The first one is the one.
        let _ = who.0.set(caller.clone());
    }
}

/// The way to the database.
#[derive(Debug)]
pub(crate) struct Audit(Sender<NewAuditEntry>);

impl Audit {
    /// With its other end.
    pub(crate) fn new() -> (Self, Receiver<NewAuditEntry>) {
        let (sender, receiver) = channel(MAX_WAITING);
        (Self(sender), receiver)
    }
}

/// Notes requests that change something, once they are answered; those of nobody are not.
pub(crate) async fn note(
    State(app): State<Arc<App>>,
    mut request: Request,
    next: Next,
) -> Response {
    let path = request.uri().path();
    let only_asks = matches!(*request.method(), Method::GET | Method::HEAD | Method::OPTIONS);
    if only_asks || UNRECORDED.iter().any(|end| path.ends_with(end)) {
        return next.run(request).await;
    }
    let (method, path) = (request.method().to_string(), path.to_owned());
    let who = Who::default();
    request.extensions_mut().insert(who.clone());
    let mut response = next.run(request).await;
    let detail = response.extensions_mut().remove::<Detail>().map(|detail| detail.0);
    if let Some(caller) = who.0.get() {
        app.audit(NewAuditEntry {
            time_ms: clock::now_ms(),
            caller: caller.clone(),
            method,
            path,
            status: response.status().as_u16(),
            detail,
        });
    }
    response
}

impl App {
    /// Hands over an entry.
    pub(crate) fn audit(&self, entry: NewAuditEntry) {
        if self.audit.0.try_send(entry).is_err() {
            add(&self.metrics.audit_lost, 1);
        }
    }
}

/// Writes entries until the service closes down, those that wait then, too.
pub(crate) async fn write_down(app: Arc<App>, mut entries: Receiver<NewAuditEntry>) {
    let mut batch = Vec::with_capacity(BATCH);
    loop {
        tokio::select! {
            biased;
            count = entries.recv_many(&mut batch, BATCH) => if count == 0 { return },
            () = app.closing.cancelled(), if !entries.is_closed() => {
                // What comes from now on counts as lost.
                entries.close();
                continue;
            }
        }
        if let Err(error) = app.store.insert_audit(&batch).await {
            add(&app.metrics.audit_lost, batch.len() as u64);
            tracing::error!(error = %error.detail, "cannot write down who did what");
        }
        batch.clear();
    }
}
