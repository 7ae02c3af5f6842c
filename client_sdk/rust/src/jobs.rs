//! Jobs: submit, watch, cancel.

use std::time::{Duration, Instant};

use reqwest::Method;
use uuid::Uuid;
use volery_api::{CreateJob, Job, JobEvent, JobEvents, JobOption, JobState, PresetInfo};

use crate::{Client, ClientError};

/// Between two polls where the socket cannot be had.
const POLL_INTERVAL: Duration = Duration::from_millis(500);

/// So long a server may be away while a job is watched: it may be starting again.
const MAX_ABSENCE: Duration = Duration::from_secs(60);

impl Client {
    /// What each preset means.
    pub async fn presets(&self) -> Result<Vec<PresetInfo>, ClientError> {
        self.get("/v1/presets").await
    }

    /// The numbers that a job may set, with their ranges and defaults.
    pub async fn job_options(&self) -> Result<Vec<JobOption>, ClientError> {
        self.get("/v1/options").await
    }

    /// Submits a job.
    pub async fn create_job(&self, request: &CreateJob) -> Result<Job, ClientError> {
        self.call(Method::POST, "/v1/jobs", request).await
    }

    /// A job as it stands.
    pub async fn job(&self, id: Uuid) -> Result<Job, ClientError> {
        self.get(&format!("/v1/jobs/{id}")).await
    }

    /// All jobs, or those in one state.
    pub async fn jobs(&self, state: Option<JobState>) -> Result<Vec<Job>, ClientError> {
        let filter = state.map_or(String::new(), |state| format!("?state={}", state.name()));
        self.list(&format!("/v1/jobs{filter}")).await
    }

    /// Asks a job to stop.
    pub async fn cancel_job(&self, id: Uuid) -> Result<Job, ClientError> {
        self.call(Method::POST, &format!("/v1/jobs/{id}/cancel"), &serde_json::json!({})).await
    }

    /// Runs an ended job again; `from_stage` and what comes after it is done anew, whatever is
    /// finished of it.
    pub async fn retry_job(&self, id: Uuid, from_stage: Option<&str>) -> Result<Job, ClientError> {
        let from = from_stage.map_or(String::new(), |stage| format!("?from_stage={stage}"));
        self.call(Method::POST, &format!("/v1/jobs/{id}/retry{from}"), &serde_json::json!({})).await
    }

    /// Forgets an ended job.
    pub async fn delete_job(&self, id: Uuid) -> Result<(), ClientError> {
        self.delete(&format!("/v1/jobs/{id}")).await
    }

    /// Events with numbers greater than `after`.
    pub async fn job_events(&self, id: Uuid, after: u64) -> Result<JobEvents, ClientError> {
        self.get(&format!("/v1/jobs/{id}/events?after={after}&limit=1000")).await
    }

    /// The whole log of a job.
    pub async fn job_log(&self, id: Uuid) -> Result<String, ClientError> {
        let path = format!("/v1/jobs/{id}/log");
        let log = self.send(self.request(Method::GET, &path)).await?;
        Ok(String::from_utf8_lossy(&log).into_owned())
    }

    /// Follows a job to its end and hands every event over once, in order: by the socket, and by
    /// polling where that cannot be had. A server that starts again meanwhile is waited for.
    pub async fn watch_job(
        &self,
        id: Uuid,
        mut each: impl FnMut(&JobEvent),
    ) -> Result<Job, ClientError> {
        let mut last = 0;
        let mut last_contact = Instant::now();
        loop {
            // Whatever ends the socket, polling tells what is true.
            let _ = self.follow_events(id, &mut last, &mut each).await;
            match self.poll(id, &mut last, &mut each).await {
                Ok(Some(job)) => return Ok(job),
                Ok(None) => last_contact = Instant::now(),
                Err(error) if error.is_passing() && last_contact.elapsed() < MAX_ABSENCE => {}
                Err(error) => return Err(error),
            }
            tokio::time::sleep(POLL_INTERVAL).await;
        }
    }

    /// New events, and the job if it has ended.
    async fn poll(
        &self,
        id: Uuid,
        last: &mut u64,
        each: &mut impl FnMut(&JobEvent),
    ) -> Result<Option<Job>, ClientError> {
        let job = self.job(id).await?;
        loop {
            let events = self.job_events(id, *last).await?.items;
            if events.is_empty() {
                break;
            }
            for event in events {
                *last = event.seq;
                each(&event);
            }
        }
        Ok(job.state.is_final().then_some(job))
    }
}
