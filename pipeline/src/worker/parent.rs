//! A worker does not outlive the service that started it.

use std::{
    io::{self, Read},
    thread,
};

use volery_api::worker::PARENT_VARIABLE;

/// Whether the process that should be the parent is. True when none is named: somebody runs the
/// worker by hand.
pub(crate) fn is_alive() -> bool {
    let Ok(expected) = std::env::var(PARENT_VARIABLE) else { return true };
    let parent = rustix::process::getppid().map_or(0, |pid| pid.as_raw_nonzero().get());
    expected.parse() == Ok(parent)
}

/// Ends this process as soon as standard input does, if a service started it. What is finished
/// lies in the work folder; nothing is lost by leaving at any instant.
pub(crate) fn leave_with_it() {
    if std::env::var_os(PARENT_VARIABLE).is_none() {
        return;
    }
    if !is_alive() {
        std::process::exit(1);
    }
    thread::spawn(|| {
        let mut stdin = io::stdin().lock();
        let mut buffer = [0; 64];
        loop {
            match stdin.read(&mut buffer) {
                Ok(0) => std::process::exit(1),
                Err(error) if error.kind() != io::ErrorKind::Interrupted => std::process::exit(1),
                _ => {}
            }
        }
    });
}
