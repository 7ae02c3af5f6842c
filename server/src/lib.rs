//! The ground station: HTTP, WebSocket, store, jobs.
//!
//! [`start`] opens a data folder and serves it; [`serve`] does so until it is told to stop. The
//! process that serves never decodes an image and never computes on a map: children do, under
//! limits, by the protocol of [`volery_api::worker`].

mod accept;
mod answer;
mod app;
mod audit;
mod auth;
mod clock;
mod config;
mod description;
mod error;
mod extract;
mod fleet;
mod flights;
mod idempotency;
mod jobs;
mod metrics;
mod pace;
mod pictures;
mod poses;
mod routes;
mod run;
mod sources;
mod state;
mod store;
mod streams;
mod task;
mod workers;
mod ws;

pub use app::{openapi, openapi_yaml};
pub use config::{Config, JobSettings, MavlinkSettings, WorkerLimits};
pub use run::{RunningServer, ServeError, start};
pub use sources::{BadCameraHost, CameraHost};
