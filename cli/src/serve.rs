//! `volery serve`.

use tracing_subscriber::{EnvFilter, fmt};
use volery_pipeline::PipelineError;
use volery_server::{Config, serve};

use crate::{
    args::ServeArgs,
    output::{Ending, Outcome},
};

pub(crate) fn run(args: &ServeArgs) -> Outcome {
    let filter = EnvFilter::try_from_env("VOLERY_LOG").unwrap_or_else(|_| EnvFilter::new("info"));
    fmt().with_env_filter(filter).with_writer(std::io::stderr).init();
    let config = Config {
        listen: args.listen,
        loopback_without_token: args.loopback_without_token,
        ..Config::new(&args.data, own_program()?)
    };
    runtime()?
        .block_on(serve(config, signalled()))
        .map_err(|e| PipelineError::plain("serve", e.to_string()))?;
    Ok(Ending::Done)
}

/// This program: the service runs it again for its workers.
pub(crate) fn own_program() -> Result<std::path::PathBuf, PipelineError> {
    std::env::current_exe().map_err(|e| PipelineError::plain("io", format!("own program: {e}")))
}

/// An async runtime over all cores.
pub(crate) fn runtime() -> Result<tokio::runtime::Runtime, PipelineError> {
    tokio::runtime::Runtime::new().map_err(|e| PipelineError::plain("io", e.to_string()))
}

/// Ready at the first SIGINT or SIGTERM.
pub(crate) async fn signalled() {
    use tokio::signal::unix::{SignalKind, signal};
    let (interrupt, terminate) = (signal(SignalKind::interrupt()), signal(SignalKind::terminate()));
    match (interrupt, terminate) {
        (Ok(mut interrupt), Ok(mut terminate)) => {
            tokio::select! { _ = interrupt.recv() => {}, _ = terminate.recv() => {} }
        }
        _ => std::future::pending().await,
    }
}
