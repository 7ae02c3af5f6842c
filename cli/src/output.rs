//! How a command ends: text or JSON, and the exit code.

use std::{io::Write, process::ExitCode};

use serde::Serialize;
use volery_pipeline::PipelineError;

/// How a command ended.
pub(crate) enum Ending {
    /// Everything was done.
    Done,
    /// Done, but not wholly.
    Partial,
}

/// Outcome of a command.
pub(crate) type Outcome = Result<Ending, PipelineError>;

/// Prints a failure and makes the exit code.
pub(crate) fn finish(outcome: Outcome, json: bool) -> ExitCode {
    match outcome {
        Ok(Ending::Done) => ExitCode::SUCCESS,
        Ok(Ending::Partial) => ExitCode::from(3),
        Err(error) => {
            if json {
                print_json(&serde_json::json!({ "error": error }));
            }
            eprintln!("error: {error} [{}]", error.code);
            if let Some(hint) = &error.hint {
                eprintln!("hint: {hint}");
            }
            ExitCode::from(if error.code == volery_pipeline::error::code::BAD_INPUT {
                2
            } else {
                1
            })
        }
    }
}

/// One JSON document on standard output. A closed pipe is the reader's choice.
pub(crate) fn print_json(value: &impl Serialize) {
    let mut out = std::io::stdout().lock();
    if serde_json::to_writer_pretty(&mut out, value).is_ok() {
        let _ = writeln!(out);
    }
}
