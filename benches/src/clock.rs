//! Seconds of CPU and of the wall clock.

use std::time::Instant;

/// CPU and wall seconds of a piece of work.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Cost {
    /// Wall clock.
    pub(crate) wall_s: f64,
    /// All threads; for a child process with its own children.
    pub(crate) cpu_s: f64,
}

/// What `work` costs this process.
pub(crate) fn measure<T>(work: impl FnOnce() -> T) -> (T, Cost) {
    let (wall, cpu) = (Instant::now(), process_cpu_s());
    let result = work();
    (result, Cost { wall_s: wall.elapsed().as_secs_f64(), cpu_s: process_cpu_s() - cpu })
}

/// What `work` costs the child processes that it starts and waits for.
pub(crate) fn measure_children<T>(work: impl FnOnce() -> T) -> (T, Cost) {
    let (wall, cpu) = (Instant::now(), children_cpu_s());
    let result = work();
    (result, Cost { wall_s: wall.elapsed().as_secs_f64(), cpu_s: children_cpu_s() - cpu })
}

fn process_cpu_s() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

fn children_cpu_s() -> f64 {
    cpu_s("/proc/self/stat")[1]
}

/// CPU seconds of a process and of its children that it has waited for, by the kernel's count in
/// hundredths of a second; 0 where there is no such count.
///
/// * `stat`: path of its `stat` file.
pub(crate) fn cpu_s(stat: &str) -> [f64; 2] {
    /// First of the four times among the fields after the process name, and their unit.
    const FIRST: usize = 11;
    const TICKS: f64 = 100.0;
    let stat = std::fs::read_to_string(stat).unwrap_or_default();
    let fields: Vec<&str> =
        stat.rsplit(')').next().unwrap_or_default().split_whitespace().collect();
    let seconds =
        |k: usize| fields.get(k).and_then(|v| v.parse::<f64>().ok()).unwrap_or(0.0) / TICKS;
    [0, 2].map(|k| seconds(FIRST + k) + seconds(FIRST + k + 1))
}
