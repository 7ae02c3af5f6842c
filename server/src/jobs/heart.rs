//! The heartbeat of a running job: keeps its lease, and hears that it should stop.

use std::sync::Arc;

use tokio::sync::watch;

use crate::{state::App, store::Lease};

/// What the heart knows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Beat {
    Go,
    Cancel,
    /// The lease is someone else's: stop without another write.
    Lost,
}

/// Beats until it is dropped.
pub(super) struct Heart {
    task: tokio::task::JoinHandle<()>,
    pub(super) beat: watch::Receiver<Beat>,
}

impl Heart {
    pub(super) fn start(app: Arc<App>, lease: Lease) -> Self {
        let (sender, beat) = watch::channel(Beat::Go);
        Self { task: tokio::spawn(run(app, lease, sender)), beat }
    }
}

impl Drop for Heart {
    fn drop(&mut self) {
        self.task.abort();
    }
}

async fn run(app: Arc<App>, lease: Lease, beat: watch::Sender<Beat>) {
    let settings = &app.config.jobs;
    let lease_ms = settings.lease.as_millis() as i64;
    let mut last = std::time::Instant::now();
    loop {
        let poked = app.job_cancelled.notified();
        let known = match app.store.heartbeat(lease, lease_ms).await {
            Ok(Ok(false)) => Beat::Go,
            Ok(Ok(true)) => Beat::Cancel,
            Ok(Err(_lost)) => Beat::Lost,
            // A disk that is full now may not be in a moment; the lease decides how long to hope.
            Err(_) if last.elapsed() < settings.lease => *beat.borrow(),
            Err(_) => Beat::Lost,
        };
        last = if known == Beat::Lost { last } else { std::time::Instant::now() };
        beat.send_if_modified(|beat| std::mem::replace(beat, known) != known);
        if known == Beat::Lost {
            return;
        }
        tokio::select! {
            () = tokio::time::sleep(settings.heartbeat) => {}
            () = poked => {}
        }
    }
}
