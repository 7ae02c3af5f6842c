//! The child processes of the service.

use std::{
    path::Path,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
};

use volery_pipeline::{PipelineError, error::code, worker};

use crate::output::{Ending, Outcome};

/// SIGTERM asks the job to stop at the next unit of work.
pub(crate) fn run_job(folder: &Path) -> Outcome {
    let stop = Arc::new(AtomicBool::new(false));
    signal_hook::flag::register(signal_hook::consts::SIGTERM, Arc::clone(&stop)).map_err(failed)?;
    worker::run_job(folder, &|| stop.load(Ordering::Relaxed)).map_err(failed)?;
    Ok(Ending::Done)
}

pub(crate) fn run_decoder() -> Outcome {
    worker::run_decoder().map_err(failed)?;
    Ok(Ending::Done)
}

pub(crate) fn run_localizer() -> Outcome {
    worker::run_localizer().map_err(failed)?;
    Ok(Ending::Done)
}

fn failed(error: std::io::Error) -> PipelineError {
    PipelineError::plain(code::IO, error.to_string())
}
