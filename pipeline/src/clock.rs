//! What a stage costs.

use std::time::Instant;

use crate::summary::StageReport;

/// Wall clock and CPU clock of the process, started together.
pub(crate) struct Stopwatch {
    wall: Instant,
    cpu_s: f64,
}

impl Stopwatch {
    /// Now.
    pub(crate) fn start() -> Self {
        Self { wall: Instant::now(), cpu_s: process_cpu_s() }
    }

    /// Wall-clock seconds since the start.
    pub(crate) fn wall_s(&self) -> f64 {
        self.wall.elapsed().as_secs_f64()
    }

    /// CPU seconds of the process since the start.
    pub(crate) fn cpu_s(&self) -> f64 {
        process_cpu_s() - self.cpu_s
    }

    /// The line of the report.
    pub(crate) fn stage(&self, name: &str, units: usize, cached: usize) -> StageReport {
        let (wall_s, cpu_s) = (self.wall_s(), self.cpu_s());
        StageReport {
            name: name.to_owned(),
            wall_s,
            cpu_s,
            units,
            cached,
            peak_rss_mib: peak_rss_mib(),
        }
    }
}

/// CPU seconds of the process, all threads.
fn process_cpu_s() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

/// Largest resident set of the process so far, MiB; `None` where the system does not say.
pub(crate) fn peak_rss_mib() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kib: f64 = line.split_whitespace().next()?.parse().ok()?;
    Some(kib / 1024.0)
}
