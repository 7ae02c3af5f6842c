//! Events of jobs to a socket, in order and without gaps; poses of drones, as they come.

use std::{collections::HashMap, sync::Arc};

use tokio::sync::broadcast::{Receiver, error::RecvError};
use uuid::Uuid;
use volery_api::{JobEvent, ws::ServerBody};

use super::{connection::Outbox, drones, flights};
use crate::{
    error::{ApiError, ApiResult, Code},
    state::App,
    store::News,
    streams::Gone,
    task::Task,
};

const BATCH: u32 = 500;

/// Sends the events of a topic until the returned task is dropped.
pub(super) async fn subscribe(
    app: &Arc<App>,
    outbox: Outbox,
    topic: &str,
    after: Option<u64>,
) -> ApiResult<Task> {
    if let Some(drone) = topic.strip_prefix("pose:") {
        return Ok(poses(app, outbox, drone));
    }
    if let Some(task) = drones::subscribe(app, &outbox, topic)? {
        return Ok(task);
    }
    if let Some(task) = flights::subscribe(app, &outbox, topic)? {
        return Ok(task);
    }
    // Listen before looking, so that nothing falls between.
    let news = app.store.listen();
    let only = match topic {
        "jobs" => None,
        topic => {
            let id = topic.strip_prefix("job:").and_then(|id| Uuid::parse_str(id).ok());
            let id = id.ok_or_else(|| {
                let detail = "topics are `jobs`, `job:<id>`, `pose:<drone>`, `drone:<drone>`, \
                              `flights`, `flight:<id>` and `alerts`; `*` means all drones";
                ApiError::new(Code::Unprocessable("bad_topic"), detail)
            })?;
            Some((id, app.store.job(id).await?.last_event))
        }
    };
    let mut feed = Feed {
        app: Arc::clone(app),
        outbox,
        topic: topic.to_owned(),
        only: only.map(|(id, _)| id),
        sent: HashMap::new(),
    };
    if let Some((id, last)) = only {
        feed.sent.insert(id, after.unwrap_or(last).min(last));
    }
    Ok(Task(tokio::spawn(async move {
        // The connection notices that this task has ended.
        let _ = feed.run(news).await;
    })))
}

/// Poses of a drone, or of all (`*`). A client that reads slowly misses some.
fn poses(app: &Arc<App>, outbox: Outbox, drone: &str) -> Task {
    let mut fixes = app.poses.listen();
    let drone = (drone != "*").then(|| drone.to_owned());
    let mut run = async move || -> Result<(), Gone> {
        loop {
            let fix = match fixes.recv().await {
                Ok(fix) => fix,
                Err(RecvError::Lagged(_)) => continue,
                Err(RecvError::Closed) => return Err(Gone),
            };
            if drone.as_ref().is_some_and(|drone| *drone != fix.drone_id) {
                continue;
            }
            outbox.wait().await?;
            let mut result = Box::new(fix.frame.clone());
            result.age_ms = fix.captured.elapsed().as_secs_f64() * 1e3;
            outbox.send(
                None,
                ServerBody::Pose {
                    drone_id: fix.drone_id.clone(),
                    map_id: fix.map_id,
                    map_version: fix.map_version,
                    frame_seq: fix.seq,
                    result,
                },
            )?;
        }
    };
    Task(tokio::spawn(async move {
        // The connection notices that this task has ended.
        let _ = run().await;
    }))
}

struct Feed {
    app: Arc<App>,
    outbox: Outbox,
    topic: String,
    only: Option<Uuid>,
    /// Number of the last event sent, per job.
    sent: HashMap<Uuid, u64>,
}

impl Feed {
    async fn run(&mut self, mut news: Receiver<News>) -> Result<(), Gone> {
        if let Some(id) = self.only {
            self.catch_up(id).await?;
        }
        loop {
            match news.recv().await {
                Ok(News { job, event }) => {
                    if self.only.is_none_or(|only| only == job) {
                        self.take(job, event).await?;
                    }
                }
                Err(RecvError::Lagged(_)) => match self.only {
                    Some(id) => self.catch_up(id).await?,
                    None => {
                        self.sent.clear();
                        let topic = self.topic.clone();
                        self.outbox.send(None, ServerBody::Resync { topic })?;
                    }
                },
                Err(RecvError::Closed) => return Err(Gone),
            }
        }
    }

    /// Sends an event if it is the next one; reads what is missing before it otherwise.
    async fn take(&mut self, job: Uuid, event: JobEvent) -> Result<(), Gone> {
        match self.sent.get(&job) {
            Some(&sent) if event.seq <= sent => Ok(()),
            Some(&sent) if event.seq > sent + 1 => self.catch_up(job).await,
            _ => self.send(job, event),
        }
    }

    async fn catch_up(&mut self, job: Uuid) -> Result<(), Gone> {
        loop {
            let after = self.sent.get(&job).copied().unwrap_or(0);
            let events = self.app.store.events(job, after, BATCH).await.map_err(|_| Gone)?;
            let full = events.len() == BATCH as usize;
            for event in events {
                // The past may be longer than the queue: wait for the client to read.
                self.outbox.wait().await?;
                self.send(job, event)?;
            }
            if !full {
                return Ok(());
            }
        }
    }

    fn send(&mut self, job: Uuid, event: JobEvent) -> Result<(), Gone> {
        self.sent.insert(job, event.seq);
        let topic = self.topic.clone();
        self.outbox.send(None, ServerBody::Event { topic, job_id: job, event })
    }
}
