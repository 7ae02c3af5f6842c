//! Progress on standard error: bars on a terminal, plain lines elsewhere.

use std::{
    io::IsTerminal,
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    time::Instant,
};

use indicatif::{ProgressBar, ProgressStyle};
use volery_pipeline::StageProgress;
use volery_scene::{Progress, Stage};

/// Shows stages as they run; SIGINT and SIGTERM ask the work to stop.
pub(crate) struct Terminal {
    stop: Arc<AtomicBool>,
    state: Mutex<State>,
    is_terminal: bool,
}

struct State {
    stage: Option<Stage>,
    started: Instant,
    bar: ProgressBar,
    /// Tenths of the stage already written as plain lines.
    tenths: usize,
    done: usize,
}

impl Terminal {
    /// Listens for signals. A second one ends the process at once.
    pub(crate) fn new() -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
            // Registered first: with the flag up, the next signal ends the process.
            let _ = signal_hook::flag::register_conditional_shutdown(signal, 130, stop.clone());
            let _ = signal_hook::flag::register(signal, stop.clone());
        }
        let state = State {
            stage: None,
            started: Instant::now(),
            bar: ProgressBar::hidden(),
            tenths: 0,
            done: 0,
        };
        Self { stop, state: Mutex::new(state), is_terminal: std::io::stderr().is_terminal() }
    }

    /// Ends the last stage.
    pub(crate) fn finish(&self) {
        self.state.lock().unwrap_or_else(PoisonError::into_inner).end_stage();
    }
}

impl State {
    fn start_stage(&mut self, stage: Stage, total: usize, is_terminal: bool) {
        self.end_stage();
        (self.stage, self.tenths, self.done) = (Some(stage), 0, 0);
        self.started = Instant::now();
        self.bar = if is_terminal {
            let style = ProgressStyle::with_template(
                "{prefix:10} {wide_bar} {pos}/{len} {msg} {elapsed} ETA {eta}",
            );
            let bar = ProgressBar::new(total as u64).with_prefix(stage.name());
            bar.with_message(stage.unit())
                .with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
        } else {
            ProgressBar::hidden()
        };
    }

    fn end_stage(&mut self) {
        self.bar.finish();
        self.stage = None;
    }

    fn plain_line(&mut self, stage: Stage, done: usize, total: usize) {
        let tenths = done * 10 / total.max(1);
        if done == 0 || tenths > self.tenths {
            self.tenths = tenths;
            let elapsed = self.started.elapsed().as_secs_f64();
            let eta = elapsed / done.max(1) as f64 * total.saturating_sub(done) as f64;
            let (name, unit) = (stage.name(), stage.unit());
            if done == 0 || done == total {
                eprintln!("{name}: {done}/{total} {unit}, {elapsed:.1} s");
            } else {
                eprintln!("{name}: {done}/{total} {unit}, {elapsed:.1} s, ETA {eta:.0} s");
            }
        }
    }
}

impl Progress for Terminal {
    fn report(&self, stage: Stage, done: usize, total: usize) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let is_new = state.stage != Some(stage);
        if is_new {
            state.start_stage(stage, total, self.is_terminal);
        } else if done <= state.done {
            return; // Threads report out of order.
        }
        state.done = done;
        state.bar.set_length(total as u64);
        state.bar.set_position(done as u64);
        if !self.is_terminal {
            state.plain_line(stage, done, total);
        }
    }

    fn is_cancelled(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

impl StageProgress for Terminal {}
