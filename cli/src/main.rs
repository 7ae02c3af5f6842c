//! The `volery` command. It only wires: every subcommand is a file of its own.
//!
//! Exit codes: 0 done; 1 failed or interrupted; 2 wrong usage; 3 done, but not wholly (a map that is
//! suspect or misses many photos, files that could not be read).

mod args;
mod compare;
mod demo;
mod doctor;
mod input;
mod localize;
mod options;
mod output;
mod plot;
mod progress;
mod reconstruct;
mod remote;
mod replay;
mod serve;
mod simulate;
mod upload;
mod worker;

use std::process::ExitCode;

use clap::Parser;

use args::{Cli, Command};

fn main() -> ExitCode {
    let cli = Cli::parse();
    let json = cli.json;
    let outcome = match cli.command {
        Command::Reconstruct(args) => reconstruct::run(&args, json),
        Command::Options => options::run(json),
        Command::Localize(args) => localize::run(&args, json),
        Command::Serve(args) => serve::run(&args, json),
        Command::Upload(args) => upload::run(&args, json),
        Command::Jobs { server, command } => remote::jobs(&server, command.as_ref(), json),
        Command::Maps { server, command } => remote::maps(&server, command.as_ref(), json),
        Command::Export { server, map, name, version, out } => {
            remote::export(&server, map, &name, version, out.as_deref(), json)
        }
        Command::Simulate(args) => simulate::run(&args),
        Command::Replay(args) => replay::run(&args, json),
        Command::Doctor(args) => doctor::run(&args, json),
        Command::Demo(args) => demo::run(&args, json),
        Command::ComparePositioning(args) => compare::run(&args, json),
        Command::RunJob { folder } => worker::run_job(&folder),
        Command::RunDecoder => worker::run_decoder(),
        Command::RunLocalizer => worker::run_localizer(),
    };
    output::finish(outcome, json)
}
