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

/// How far work is that comes in stages.
#[derive(Default)]
pub(crate) struct Counter {
    stage: Option<Counted>,
}

/// How far a stage is.
struct Counted {
    name: String,
    unit: String,
    done: u64,
    started: Instant,
    /// `None` off a terminal.
    bar: Option<ProgressBar>,
    /// Tenths of it that were written as plain lines.
    tenths: Option<u64>,
}

impl Counter {
    /// `done` of `total` of a stage; another name starts another stage. What is less than was told
    /// before is not told: threads report out of order.
    pub(crate) fn show(&mut self, name: &str, done: u64, total: u64, unit: &str) {
        if self.stage.as_ref().is_none_or(|stage| stage.name != name) {
            self.end();
            self.stage = Some(Counted::new(name, unit, total));
        } else if self.stage.as_ref().is_some_and(|stage| done <= stage.done) {
            return;
        }
        if let Some(stage) = &mut self.stage {
            stage.show(done, total);
        }
    }

    /// Writes a line beside it.
    pub(crate) fn say(&self, line: &str) {
        match self.stage.as_ref().and_then(|stage| stage.bar.as_ref()) {
            Some(bar) => bar.suspend(|| eprintln!("{line}")),
            None => eprintln!("{line}"),
        }
    }

    /// Ends the last stage.
    pub(crate) fn end(&mut self) {
        if let Some(Counted { bar: Some(bar), .. }) = self.stage.take() {
            bar.finish();
        }
    }
}

impl Counted {
    fn new(name: &str, unit: &str, total: u64) -> Self {
        let bar = || {
            let style = ProgressStyle::with_template(
                "{prefix:10} {wide_bar} {pos}/{len} {msg} {elapsed} ETA {eta}",
            );
            let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
            let bar = ProgressBar::new(total).with_prefix(name.to_owned());
            bar.with_message(unit.to_owned()).with_style(style)
        };
        Self {
            name: name.to_owned(),
            unit: unit.to_owned(),
            done: 0,
            started: Instant::now(),
            bar: std::io::stderr().is_terminal().then(bar),
            tenths: None,
        }
    }

    /// Off a terminal a line at the start, and at each tenth.
    fn show(&mut self, done: u64, total: u64) {
        self.done = done;
        let tenths = Some(done * 10 / total.max(1));
        if let Some(bar) = &self.bar {
            bar.set_length(total);
            bar.set_position(done);
        } else if tenths > self.tenths {
            self.tenths = tenths;
            let Self { name, unit, .. } = self;
            let elapsed = self.started.elapsed().as_secs_f64();
            let eta = elapsed / done.max(1) as f64 * total.saturating_sub(done) as f64;
            let eta = if done == 0 || done == total { "" } else { &format!(", ETA {eta:.0} s") };
            eprintln!("{name}: {done}/{total} {unit}, {elapsed:.1} s{eta}");
        }
    }
}

/// Shows stages as they run; SIGINT and SIGTERM ask the work to stop.
pub(crate) struct Terminal {
    stop: Arc<AtomicBool>,
    counter: Mutex<Counter>,
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
        Self { stop, counter: Mutex::default() }
    }

    /// Ends the last stage.
    pub(crate) fn finish(&self) {
        self.counter.lock().unwrap_or_else(PoisonError::into_inner).end();
    }
}

impl Progress for Terminal {
    fn report(&self, stage: Stage, done: usize, total: usize) {
        let mut counter = self.counter.lock().unwrap_or_else(PoisonError::into_inner);
        counter.show(stage.name(), done as u64, total as u64, stage.unit());
    }

    fn is_cancelled(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

impl StageProgress for Terminal {}
