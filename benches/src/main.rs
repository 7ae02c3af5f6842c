//! Prints one table of figures and keeps it in `docs/benchmarks.md`.
//!
//! ```text
//! cargo run --release -p volery-benches -- [SET...]
//! cargo run --release -p volery-benches -- load [SECONDS] [nothing] [reconstruction] [flood]
//! ```
//!
//! * `SET`: only sets whose name contains one of these words; the file is then left alone.
//! * `load`: the server under load, a table by itself; the program must have been built.
//! * `VOLERY_BENCH_RUNS`: runs of each reconstruction, the median counts (1; with peers 3).
//! * `VOLERY_PEERS_PYTHON`: a Python that has pycolmap and openmvg-rs, to be run in turn with ours.

use std::process::ExitCode;

mod clock;
mod load;
mod machine;
mod sets;
mod stages;
mod table;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if let [first, set, out] = arguments.as_slice()
        && first == sets::CHILD
    {
        return match sets::reconstruct_child(set, out.as_ref()) {
            Ok(()) => ExitCode::SUCCESS,
            Err(error) => {
                println!("{error}");
                ExitCode::FAILURE
            }
        };
    }
    if let [first, rest @ ..] = arguments.as_slice()
        && first == load::COMMAND
    {
        return match load::load(rest) {
            Ok(table) => {
                println!("{}", table.to_markdown());
                ExitCode::SUCCESS
            }
            Err(error) => {
                eprintln!("{error}");
                ExitCode::FAILURE
            }
        };
    }
    let default_runs = if std::env::var_os("VOLERY_PEERS_PYTHON").is_some() { 3 } else { 1 };
    let runs = std::env::var("VOLERY_BENCH_RUNS").ok().and_then(|runs| runs.parse().ok());
    let num_runs = runs.unwrap_or(default_runs).max(1);

    let mut text = "# Benchmarks\n\nWritten by `./run bench`. CPU time is of all threads; errors \
                    are after a similarity fit; runs are whole processes, the median of "
        .to_owned();
    text += &format!("{num_runs}.\n\nMachine: {}.\n\n", machine::description());
    text += &stages::stages().to_markdown();
    text += &sets::sets(&arguments, num_runs).to_markdown();
    println!("{text}");
    if arguments.is_empty() {
        let path = volery_tests::repository_root().join("docs/benchmarks.md");
        if let Err(error) = std::fs::write(&path, text.trim_end().to_owned() + "\n") {
            eprintln!("{}: {error}", path.display());
            return ExitCode::FAILURE;
        }
    }
    ExitCode::SUCCESS
}
