//! A few children of one kind that answer one question at a time.

use std::{
    sync::{Mutex, PoisonError},
    time::Duration,
};

use serde::{Serialize, de::DeserializeOwned};
use tokio::sync::Semaphore;
use volery_api::{
    WorkerFailure,
    worker::{WorkerReply, WorkerRequest},
};

use super::child::Child;
use crate::{
    config::Config,
    error::{ApiError, Code},
};

/// Why there is no answer.
#[derive(Debug, thiserror::Error)]
pub(crate) enum PoolError {
    /// The child said so.
    #[error("{}", .0.detail)]
    Refused(WorkerFailure),
    /// The child died or talked nonsense.
    #[error("the worker died")]
    Died,
    /// Too many wait already.
    #[error("too many questions wait for a worker")]
    Busy,
    /// The child took too long and was killed.
    #[error("the worker took longer than {0:?}")]
    TimedOut(Duration),
    /// The child could not be started.
    #[error("the worker cannot be started: {0}")]
    NoStart(std::io::Error),
}

impl From<PoolError> for ApiError {
    fn from(error: PoolError) -> Self {
        let code = match error {
            // What the service handed over is at fault, not what the client sent.
            PoolError::Refused(failure) if matches!(&*failure.code, "io" | "bad_map") => {
                return Self::internal(failure.detail);
            }
            PoolError::Refused(failure) => return failure.into(),
            PoolError::Died => "worker_died",
            PoolError::Busy => "worker_busy",
            PoolError::TimedOut(_) => "worker_timeout",
            PoolError::NoStart(_) => "worker_missing",
        };
        Self::new(Code::Worker(code), error.to_string())
    }
}

/// Children that answer, started when needed and kept for the next question.
#[derive(Debug)]
pub(crate) struct Pool {
    config: Config,
    word: &'static str,
    bytes: u64,
    places: Semaphore,
    waiting: Semaphore,
    idle: Mutex<Vec<Child>>,
}

impl Pool {
    /// At most `size` children of `<program> <word>`, each with `bytes` of address space.
    pub(crate) fn new(config: &Config, word: &'static str, size: usize, bytes: u64) -> Self {
        Self {
            config: config.clone(),
            word,
            bytes,
            places: Semaphore::new(size.max(1)),
            waiting: Semaphore::new(size.max(1) + config.workers.waiting),
            idle: Mutex::new(Vec::new()),
        }
    }

    /// Asks a child. One that dies, talks nonsense or takes too long is replaced at the next
    /// question; so is one whose asker went away.
    pub(crate) async fn call<T: Serialize + DeserializeOwned>(
        &self,
        request: &WorkerRequest,
        payload: &[u8],
        timeout: Duration,
    ) -> Result<T, PoolError> {
        self.call_for_bytes(request, payload, timeout).await.map(|(answer, _)| answer)
    }

    /// As [`Self::call`], with the payload of the answer.
    pub(crate) async fn call_for_bytes<T: Serialize + DeserializeOwned>(
        &self,
        request: &WorkerRequest,
        payload: &[u8],
        timeout: Duration,
    ) -> Result<(T, Vec<u8>), PoolError> {
        let _waiting = self.waiting.try_acquire().map_err(|_| PoolError::Busy)?;
        let _place = self.places.acquire().await.map_err(|_| PoolError::Died)?;
        let idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let mut worker = match idle {
            Some(worker) => worker,
            None => {
                Child::start(&self.config, self.word, self.bytes).map_err(PoolError::NoStart)?
            }
        };
        let header = serde_json::to_vec(request).map_err(|_| PoolError::Died)?;
        let (answer, payload) = tokio::time::timeout(timeout, worker.ask(&header, payload))
            .await
            .map_err(|_| PoolError::TimedOut(timeout))?
            .map_err(|_| PoolError::Died)?;
        let reply = WorkerReply::parse(&answer).map_err(|_| PoolError::Died)?;
        self.idle.lock().unwrap_or_else(PoisonError::into_inner).push(worker);
        reply.0.map(|answer| (answer, payload)).map_err(PoolError::Refused)
    }
}
