//! Wire types of openapi.yaml, shared by the service, its child processes and its clients.

pub mod beacons;
pub mod drone_cameras;
pub mod drones;
pub mod effort;
pub mod flights;
pub mod images;
pub mod jobs;
pub mod maps;
pub mod priors;
pub mod problem;
pub mod recordings;
pub mod registration;
pub mod service;
pub mod tracking;
pub mod uploads;
pub mod vision;
pub mod worker;
pub mod ws;

pub use beacons::*;
pub use drone_cameras::*;
pub use drones::*;
pub use effort::*;
pub use flights::*;
pub use images::*;
pub use jobs::*;
pub use maps::*;
pub use priors::*;
pub use problem::*;
pub use recordings::*;
pub use registration::*;
pub use service::*;
pub use tracking::*;
pub use uploads::*;
pub use vision::*;
pub use worker::{ImageEncoding, WorkerFailure};
