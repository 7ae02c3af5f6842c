//! Wire types of openapi.yaml, shared by the service, its child processes and its clients.

pub mod vision;
pub mod worker;

pub use vision::*;
