//! Counters, in the text format of Prometheus.

use std::{
    fmt::Write,
    sync::atomic::{AtomicU64, Ordering},
};

use crate::workers::PoolError;

/// Counters of this process.
#[derive(Debug, Default)]
pub(crate) struct Metrics {
    classes: [AtomicU64; 5],
    pub(crate) connections: AtomicU64,
    pub(crate) connections_refused: AtomicU64,
    pub(crate) sockets: AtomicU64,
    pub(crate) images_stored: AtomicU64,
    pub(crate) images_rejected: AtomicU64,
    pub(crate) localized_ok: AtomicU64,
    pub(crate) localized_ambiguous: AtomicU64,
    pub(crate) localized_not_found: AtomicU64,
    pub(crate) frames_dropped: AtomicU64,
    /// Pictures of cameras that are pulled.
    pub(crate) camera_frames: AtomicU64,
    /// Connections to such cameras that failed or broke.
    pub(crate) camera_failures: AtomicU64,
    pub(crate) worker_deaths: AtomicU64,
    pub(crate) audit_lost: AtomicU64,
    localize_us: AtomicU64,
}

impl Metrics {
    /// Counts an answer.
    pub(crate) fn answered(&self, status: u16) {
        if let Some(class) = self.classes.get(usize::from(status / 100).wrapping_sub(1)) {
            add(class, 1);
        }
    }

    /// Counts the time of a localization.
    pub(crate) fn localized(&self, time: std::time::Duration) {
        add(&self.localize_us, time.as_micros() as u64);
    }

    /// Counts a child that died or had to be killed.
    pub(crate) fn asked(&self, error: &PoolError) {
        if matches!(error, PoolError::Died | PoolError::TimedOut(_)) {
            add(&self.worker_deaths, 1);
        }
    }

    /// As text, with the number of jobs per state.
    pub(crate) fn render(&self, jobs: &[(String, i64)]) -> String {
        let mut text = String::new();
        for (index, class) in self.classes.iter().enumerate() {
            let (class, number) = (index + 1, get(class));
            let _ = writeln!(text, "volery_http_responses_total{{class=\"{class}xx\"}} {number}");
        }
        for (state, number) in jobs {
            let _ = writeln!(text, "volery_jobs{{state=\"{state}\"}} {number}");
        }
        for (status, counter) in [
            ("ok", &self.localized_ok),
            ("ambiguous", &self.localized_ambiguous),
            ("not_found", &self.localized_not_found),
        ] {
            let number = get(counter);
            let _ = writeln!(text, "volery_localizations_total{{status=\"{status}\"}} {number}");
        }
        for (name, counter) in [
            ("volery_connections", &self.connections),
            ("volery_connections_refused_total", &self.connections_refused),
            ("volery_websockets", &self.sockets),
            ("volery_images_stored_total", &self.images_stored),
            ("volery_images_rejected_total", &self.images_rejected),
            ("volery_frames_dropped_total", &self.frames_dropped),
            ("volery_camera_frames_total", &self.camera_frames),
            ("volery_camera_failures_total", &self.camera_failures),
            ("volery_worker_deaths_total", &self.worker_deaths),
            ("volery_audit_lost_total", &self.audit_lost),
        ] {
            let _ = writeln!(text, "{name} {}", get(counter));
        }
        let seconds = get(&self.localize_us) as f64 / 1e6;
        let _ = writeln!(text, "volery_localize_seconds_total {seconds}");
        text
    }
}

/// Raises a counter.
pub(crate) fn add(counter: &AtomicU64, number: u64) {
    counter.fetch_add(number, Ordering::Relaxed);
}

/// Lowers a gauge.
pub(crate) fn sub(gauge: &AtomicU64, number: u64) {
    gauge.fetch_sub(number, Ordering::Relaxed);
}

fn get(counter: &AtomicU64) -> u64 {
    counter.load(Ordering::Relaxed)
}
