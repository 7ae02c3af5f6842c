//! How a child is started, held and ended.

use std::process::Stdio;

use rustix::process::{
    Pid, Resource, Rlimit, Signal, kill_process_group, prlimit, setpriority_process,
};
use tokio::process::{Child, Command};
use volery_api::worker::PARENT_VARIABLE;

use crate::config::Config;

/// `<worker_program> <worker_args> <word>` in a process group of its own. It is killed when its
/// handle is dropped; when the whole service is killed, the child notices by itself.
pub(crate) fn command(config: &Config, word: &str) -> Command {
    let mut command = Command::new(&config.worker_program);
    command
        .args(&config.worker_args)
        .arg(word)
        .env(PARENT_VARIABLE, std::process::id().to_string())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .process_group(0)
        .kill_on_drop(true);
    command
}

/// Limits the address space of a child and lets everything else go before it.
pub(crate) fn confine(child: &Child, bytes: u64, niceness: i32) {
    let Some(pid) = pid(child) else { return };
    let limit = Rlimit { current: Some(bytes), maximum: Some(bytes) };
    let no_core = Rlimit { current: Some(0), maximum: Some(0) };
    let limited = prlimit(Some(pid), Resource::As, limit)
        .and_then(|_| prlimit(Some(pid), Resource::Core, no_core))
        .and_then(|_| setpriority_process(Some(pid), niceness));
    if let Err(error) = limited {
        tracing::warn!(%error, "cannot limit a worker");
    }
}

/// Asks a child and its descendants to stop.
pub(crate) fn stop_group(child: &Child) {
    signal(child, Signal::TERM);
}

/// Ends a child and its descendants.
pub(crate) fn kill_group(child: &Child) {
    signal(child, Signal::KILL);
}

fn signal(child: &Child, signal: Signal) {
    if let Some(pid) = pid(child) {
        // It may be gone already.
        let _ = kill_process_group(pid, signal);
    }
}

fn pid(child: &Child) -> Option<Pid> {
    child.id().and_then(|id| i32::try_from(id).ok()).and_then(Pid::from_raw)
}
