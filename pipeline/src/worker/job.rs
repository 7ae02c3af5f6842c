//! `run-job`: one reconstruction in a work folder.

use std::{
    fs::{self, File},
    io::Write,
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError},
    time::{Duration, Instant},
};

use volery_api::{
    JobKind, Warning,
    worker::{CACHE_FOLDER, JOB_FILE, JobLine, JobResult, JobSpec, OUT_FOLDER},
};
use volery_scene::{Progress, Stage};

use super::{job_spec::job_spec, parent};
use crate::{
    MapSource, PipelineError, RegisterReport, StageProgress, Summary, error::code, extend_map,
    reconstruct, register_maps,
};

/// Map of the photos that join another one.
const NEW_FOLDER: &str = "new";

/// Held while a worker is at the job.
const LOCK_FILE: &str = "lock";

/// A stage reports at most so often, beside its first and last unit.
const MIN_REPORT_INTERVAL: Duration = Duration::from_millis(100);

/// Does the job in `work_dir` and tells of it on standard output. `Err` only where not even that
/// is possible; a job that fails says so in its last line.
pub fn run_job(work_dir: &Path, is_cancelled: &(dyn Fn() -> bool + Sync)) -> std::io::Result<()> {
    parent::leave_with_it();
    let lines = Lines { is_cancelled, state: Mutex::new(State::default()) };
    let result = match job(work_dir, &lines) {
        Ok(result) => {
            for warning in &result.warnings {
                lines.write(&JobLine::Log {
                    level: "warn".to_owned(),
                    message: format!("{}: {}", warning.code, warning.detail),
                })?;
            }
            result
        }
        Err(error) => JobResult {
            ok: false,
            code: Some(error.code),
            detail: Some(error.detail),
            hint: error.hint,
            ..JobResult::default()
        },
    };
    lines.write(&JobLine::Result(result))
}

fn job(work_dir: &Path, lines: &Lines<'_>) -> Result<JobResult, PipelineError> {
    let _lock = lock(&work_dir.join(LOCK_FILE))?;
    let path = work_dir.join(JOB_FILE);
    let bytes = fs::read(&path).map_err(|e| PipelineError::io(&path, &e))?;
    let spec: JobSpec = serde_json::from_slice(&bytes)
        .map_err(|e| PipelineError::plain(code::BAD_INPUT, format!("{JOB_FILE}: {e}")))?;
    let (kind, how) = (spec.kind, spec.registration);
    let maps: Vec<MapSource> = spec
        .maps
        .iter()
        .map(|map| MapSource {
            name: map.name.clone(),
            folder: work_dir.join(&map.path),
            photos: map.photos.iter().map(|photo| work_dir.join(photo)).collect(),
        })
        .collect();
    let spec = job_spec(spec, work_dir)?;
    let (cache, out) = (work_dir.join(CACHE_FOLDER), work_dir.join(OUT_FOLDER));
    match kind {
        JobKind::Reconstruct => {
            let summary = reconstruct(&spec, &cache, &out, lines)?;
            Ok(success(summary))
        }
        JobKind::RegisterMaps => {
            Ok(registered(&register_maps(&maps, &how, &spec, &cache, &out, lines)?))
        }
        JobKind::ExtendMap => {
            let [map] = &maps[..] else {
                let detail = format!("photos join one map, not {}", maps.len());
                return Err(PipelineError::plain(code::BAD_INPUT, detail));
            };
            let new = work_dir.join(NEW_FOLDER);
            Ok(registered(&extend_map(map, &spec, &cache, &new, &out, lines)?))
        }
    }
}

/// Waits for a worker that is about to leave; the lock goes with the file handle.
fn lock(path: &Path) -> Result<File, PipelineError> {
    let file = File::create(path).map_err(|e| PipelineError::io(path, &e))?;
    file.lock().map_err(|e| PipelineError::io(path, &e))?;
    Ok(file)
}

fn success(summary: Summary) -> JobResult {
    let complete = summary.is_complete();
    let lack = (!complete).then(|| {
        let lack = lack(&summary);
        PipelineError { hint: lack.hint.or_else(|| summary.advice.first().cloned()), ..lack }
    });
    result(lack, summary.warnings)
}

fn registered(report: &RegisterReport) -> JobResult {
    result(report.lack(), Vec::new())
}

/// A map is there; it may lack something.
fn result(lack: Option<PipelineError>, warnings: Vec<Warning>) -> JobResult {
    JobResult {
        ok: true,
        state: Some(if lack.is_none() { "succeeded" } else { "partial" }.to_owned()),
        map: Some(PathBuf::from(OUT_FOLDER).to_string_lossy().into_owned()),
        code: lack.as_ref().map(|lack| lack.code.clone()),
        detail: lack.as_ref().map(|lack| lack.detail.clone()),
        hint: lack.and_then(|lack| lack.hint),
        warnings,
    }
}

/// What an incomplete map lacks first.
fn lack(summary: &Summary) -> PipelineError {
    if let Some(reason) = summary.quality.reasons.first() {
        return PipelineError::plain(&reason.code, reason.detail.clone());
    }
    if let Some(error) = summary.surface_error() {
        return error.clone();
    }
    let (registered, images) = (summary.num_registered, summary.num_images);
    PipelineError::plain("images_unplaced", format!("{registered} of {images} images registered"))
}

/// Standard output as lines of JSON.
struct Lines<'a> {
    is_cancelled: &'a (dyn Fn() -> bool + Sync),
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    stage: Option<Stage>,
    done: usize,
    written: Option<Instant>,
}

impl Lines<'_> {
    fn write(&self, line: &JobLine) -> std::io::Result<()> {
        let mut text = serde_json::to_vec(line)?;
        text.push(b'\n');
        let mut out = std::io::stdout().lock();
        out.write_all(&text)?;
        out.flush()
    }
}

impl Progress for Lines<'_> {
    fn report(&self, stage: Stage, done: usize, total: usize) {
        {
            let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
            let is_new = state.stage != Some(stage);
            if !is_new && done <= state.done {
                return; // Threads report out of order.
            }
            (state.stage, state.done) = (Some(stage), done);
            let is_soon = state.written.is_some_and(|at| at.elapsed() < MIN_REPORT_INTERVAL);
            if !is_new && is_soon && done < total {
                return;
            }
            state.written = Some(Instant::now());
        }
        // If nobody reads, standard input has ended too, and that ends the process.
        let _ = self.write(&JobLine::Progress {
            stage: stage.name().to_owned(),
            done: done as u64,
            total: total as u64,
            unit: stage.unit().to_owned(),
        });
    }

    fn is_cancelled(&self) -> bool {
        (self.is_cancelled)()
    }
}

impl StageProgress for Lines<'_> {
    fn reused(&self, stage: Stage, units: usize) {
        if units > 0 {
            let line = JobLine::Reused { stage: stage.name().to_owned(), units: units as u64 };
            // As above.
            let _ = self.write(&line);
        }
    }
}
