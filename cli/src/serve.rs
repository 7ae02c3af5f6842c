//! `volery serve`.

use std::io::{self, Write};
use std::net::SocketAddr;

use tracing_subscriber::{EnvFilter, fmt};
use volery_pipeline::PipelineError;
use volery_server::{Config, MavlinkSettings, start};

use crate::{
    args::ServeArgs,
    output::{Ending, Outcome},
};

/// What whoever started it is told when it listens.
#[derive(serde::Serialize)]
struct Listening {
    url: String,
    /// Where drones are heard, by UDP.
    mavlink: Option<SocketAddr>,
    /// The secret of the first admin token; only at the first start over a data folder.
    admin_token: Option<String>,
}

pub(crate) fn run(args: &ServeArgs, json: bool) -> Outcome {
    let filter = EnvFilter::try_from_env("VOLERY_LOG").unwrap_or_else(|_| EnvFilter::new("info"));
    fmt().with_env_filter(filter).with_writer(std::io::stderr).init();
    let config = Config {
        listen: args.listen,
        loopback_without_token: args.loopback_without_token,
        mavlink: mavlink(args)?,
        camera_hosts: args.camera_host.clone(),
        ..Config::new(&args.data, own_program()?)
    };
    runtime()?.block_on(async {
        let server =
            start(config).await.map_err(|e| PipelineError::plain("serve", e.to_string()))?;
        let interrupted = signalled();
        let listening = Listening {
            url: server.url(),
            mavlink: server.mavlink_addr(),
            admin_token: server.admin_token.clone(),
        };
        if let Err(error) = listening.tell(json) {
            // Whoever started it may have stopped to listen.
            eprintln!("warning: cannot print where the service listens: {error}");
        }
        interrupted.await;
        server.stop().await;
        Ok(Ending::Done)
    })
}

impl Listening {
    /// One line of JSON, or text, on standard output.
    fn tell(&self, json: bool) -> io::Result<()> {
        let mut out = io::stdout().lock();
        if json {
            serde_json::to_writer(&mut out, self)?;
            writeln!(out)?;
            return out.flush();
        }
        writeln!(out, "volery listens on {}", self.url)?;
        if let Some(address) = self.mavlink {
            writeln!(out, "drones are heard on udp:{address}")?;
        }
        if let Some(token) = &self.admin_token {
            writeln!(out, "admin token (shown this once): {token}")?;
            writeln!(out, "the page: {}/#token={token}", self.url)?;
        }
        out.flush()
    }
}

/// The drones' link, if there is to be one.
fn mavlink(args: &ServeArgs) -> Result<Option<MavlinkSettings>, PipelineError> {
    let Some(listen) = args.mavlink else { return Ok(None) };
    let key = args.mavlink_key.as_deref().map(mavlink_key);
    Ok(Some(MavlinkSettings {
        key: key.transpose()?,
        accept_unsigned: args.insecure_mavlink,
        max_pose_age: std::time::Duration::from_millis(args.max_pose_age_ms),
        ..MavlinkSettings::new(listen)
    }))
}

/// The signing key in a file.
pub(crate) fn mavlink_key(path: &std::path::Path) -> Result<[u8; 32], PipelineError> {
    let bad = |why: String| PipelineError::plain("mavlink_key", why);
    let text = std::fs::read_to_string(path)
        .map_err(|e| bad(format!("cannot read {}: {e}", path.display())))?;
    MavlinkSettings::parse_key(text.trim())
        .ok_or_else(|| bad(format!("{} does not hold 64 hex digits", path.display())))
}

/// This program: the service runs it again for its workers.
pub(crate) fn own_program() -> Result<std::path::PathBuf, PipelineError> {
    std::env::current_exe().map_err(|e| PipelineError::plain("io", format!("own program: {e}")))
}

/// An async runtime over all cores.
pub(crate) fn runtime() -> Result<tokio::runtime::Runtime, PipelineError> {
    tokio::runtime::Runtime::new().map_err(|e| PipelineError::plain("io", e.to_string()))
}

/// Ready at the first SIGINT or SIGTERM from now on, not from when it is first polled.
pub(crate) fn signalled() -> impl Future<Output = ()> {
    use tokio::signal::unix::{SignalKind, signal};
    let (interrupt, terminate) = (signal(SignalKind::interrupt()), signal(SignalKind::terminate()));
    async {
        match (interrupt, terminate) {
            (Ok(mut interrupt), Ok(mut terminate)) => {
                tokio::select! { _ = interrupt.recv() => {}, _ = terminate.recv() => {} }
            }
            _ => std::future::pending().await,
        }
    }
}
