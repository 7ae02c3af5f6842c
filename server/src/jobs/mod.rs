//! Jobs: claimed by lease, run in a child, finished in one transaction.

mod child;
mod heart;
mod progress;
mod run;
mod spec;

pub(crate) use progress::stages_from;
pub(crate) use run::run_jobs;
