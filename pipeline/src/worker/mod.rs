//! The child-process side of the service: see `volery_api::worker` for what is said.

mod align;
mod answer;
mod image_work;
mod job;
mod job_spec;
mod parent;
mod requests;
mod tracking;

pub use answer::{localization, not_found};
pub use image_work::{Query, QueryError, query_image};
pub use job::run_job;
pub use requests::{run_decoder, run_localizer};
