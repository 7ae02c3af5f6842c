//! How far a job is, and when it will be done.

use std::time::{Duration, Instant};

use serde_json::{Value, json};
use volery_api::{JobProgress, JobStage, StageGroup};

/// Time that each stage takes in a usual job, relative to the sparse map.
const WEIGHTS: [(StageGroup, &str, f64); 10] = [
    (StageGroup::Sfm, "features", 0.35),
    (StageGroup::Sfm, "pairs", 0.03),
    (StageGroup::Sfm, "matching", 0.35),
    (StageGroup::Sfm, "mapping", 0.22),
    (StageGroup::Sfm, "align", 0.02),
    (StageGroup::Sfm, "export", 0.03),
    (StageGroup::Dense, "depth_maps", 6.0),
    (StageGroup::Dense, "fusion", 1.0),
    (StageGroup::Mesh, "meshing", 1.5),
    (StageGroup::Mesh, "texturing", 0.5),
];

/// A stage and all after it, by name.
pub(crate) fn stages_from(name: &str) -> Option<impl Iterator<Item = &'static str>> {
    let first = WEIGHTS.iter().position(|(_, stage, _)| *stage == name)?;
    Some(WEIGHTS[first..].iter().map(|(_, stage, _)| *stage))
}

/// Time between two events of progress.
const INTERVAL: Duration = Duration::from_millis(250);

/// What a child reported.
#[derive(Debug)]
pub(super) struct Tracker {
    /// Where the job ends.
    last: StageGroup,
    pub(super) stages: Vec<JobStage>,
    pub(super) progress: JobProgress,
    /// When the running stage began, and how many units it had finished then.
    began: Option<(Instant, u64)>,
    told: Option<Instant>,
    untold: bool,
}

/// One line of a child's progress.
#[derive(Debug, Clone)]
pub(super) struct Step {
    pub(super) stage: String,
    pub(super) done: u64,
    pub(super) total: u64,
    pub(super) unit: String,
}

impl Tracker {
    /// Of a job that ends with `last`.
    pub(super) fn new(last: StageGroup) -> Self {
        Self {
            last,
            stages: Vec::new(),
            progress: JobProgress::default(),
            began: None,
            told: None,
            untold: false,
        }
    }

    /// Takes a step in; answers the events that tell it now.
    pub(super) fn step(
        &mut self,
        step: Step,
        now: Instant,
        stamp: &str,
    ) -> Vec<(&'static str, Value)> {
        let mut told = Vec::new();
        let new_stage = self.stages.last().is_none_or(|stage| stage.name != step.stage);
        if new_stage {
            if let Some(last) = self.stages.last_mut() {
                last.state = "done".to_owned();
                last.ended = Some(stamp.to_owned());
            }
            self.stages.push(JobStage {
                name: step.stage.clone(),
                state: "running".to_owned(),
                started: stamp.to_owned(),
                ended: None,
                done: step.done,
                total: step.total,
                unit: step.unit.clone(),
                cached: 0,
            });
            self.began = Some((now, step.done));
        }
        let finished = step.total > 0 && step.done >= step.total;
        if let Some(stage) = self.stages.last_mut() {
            stage.done = step.done;
            stage.total = step.total;
        }
        self.progress = JobProgress {
            // Never back: a stage may learn that it has more to do.
            fraction: self.fraction(&step).unwrap_or(0.0).max(self.progress.fraction),
            eta_s: self.eta_s(&step, now),
            done: step.done,
            total: step.total,
            unit: step.unit,
        };
        self.untold = true;
        if new_stage {
            told.push(("job.stage", self.data()));
        }
        let due = self.told.is_none_or(|told| now >= told + INTERVAL);
        if due || finished {
            self.told = Some(now);
            self.untold = false;
            told.push(("job.progress", self.data()));
        }
        told
    }

    /// Takes in how much of a stage was found finished.
    pub(super) fn reused(&mut self, stage: &str, units: u64) {
        if let Some(stage) = self.stages.iter_mut().rev().find(|known| known.name == stage) {
            stage.cached = units;
            self.untold = true;
        }
    }

    /// What was held back to not tell too often, once it may be told.
    pub(super) fn overdue(&mut self, now: Instant) -> Option<(&'static str, Value)> {
        let due = self.untold && self.told.is_none_or(|told| now >= told + INTERVAL);
        due.then(|| {
            self.told = Some(now);
            self.untold = false;
            ("job.progress", self.data())
        })
    }

    /// Name of the running stage.
    pub(super) fn stage(&self) -> &str {
        self.stages.last().map_or("", |stage| &stage.name)
    }

    /// Ends the last stage.
    pub(super) fn finish(&mut self, stamp: &str) {
        if let Some(stage) = self.stages.last_mut() {
            stage.state = "done".to_owned();
            stage.ended = Some(stamp.to_owned());
        }
        self.progress.fraction = 1.0;
        self.progress.eta_s = Some(0.0);
    }

    fn eta_s(&self, step: &Step, now: Instant) -> Option<f64> {
        let (began, done_then) = self.began?;
        let done = step.done.checked_sub(done_then).filter(|done| *done > 0)?;
        let left = step.total.saturating_sub(step.done);
        Some((now - began).as_secs_f64() / done as f64 * left as f64)
    }

    fn fraction(&self, step: &Step) -> Option<f64> {
        let weights = || WEIGHTS.iter().filter(|(group, ..)| *group <= self.last);
        let whole: f64 = weights().map(|(.., weight)| weight).sum();
        let at = weights().position(|(_, name, _)| *name == step.stage)?;
        let before: f64 = weights().take(at).map(|(.., weight)| weight).sum();
        let inside = if step.total == 0 { 0.0 } else { step.done as f64 / step.total as f64 };
        let own = weights().nth(at).map_or(0.0, |(.., weight)| *weight);
        Some((before + own * inside.min(1.0)) / whole)
    }

    fn data(&self) -> Value {
        json!({
            "stage": self.stage(),
            "fraction": self.progress.fraction,
            "done": self.progress.done,
            "total": self.progress.total,
            "unit": self.progress.unit,
            "eta_s": self.progress.eta_s,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn step(stage: &str, done: u64, total: u64) -> Step {
        Step { stage: stage.to_owned(), done, total, unit: "images".to_owned() }
    }

    #[test]
    fn the_fraction_rises_to_one_and_the_eta_falls() {
        for group in [StageGroup::Sfm, StageGroup::Dense, StageGroup::Mesh] {
            let mut tracker = Tracker::new(group);
            let mut now = Instant::now();
            let mut last = -1.0;
            let stages = || WEIGHTS.iter().filter(|(of, ..)| *of <= group);
            for (_, stage, _) in stages() {
                for done in 0..=10 {
                    now += Duration::from_secs(1);
                    tracker.step(step(stage, done, 10), now, "t");
                    assert!(tracker.progress.fraction >= last);
                    last = tracker.progress.fraction;
                    if done > 0 {
                        let eta_s = tracker.progress.eta_s.unwrap();
                        let expected = (10 - done) as f64;
                        assert!((eta_s - expected).abs() < 1e-9, "{stage} {done}: {eta_s}");
                    }
                }
            }
            assert!((last - 1.0).abs() < 1e-9, "{group:?}");
            assert_eq!(tracker.stages.len(), stages().count());
        }
    }

    #[test]
    fn a_flood_of_steps_is_told_a_few_times_and_to_its_end() {
        let mut tracker = Tracker::new(StageGroup::Mesh);
        let now = Instant::now();
        let mut told = 0;
        for done in 0..10_000 {
            told += tracker.step(step("matching", done, 10_001), now, "t").len();
        }
        assert_eq!(told, 2, "the stage and its first step");
        assert!(tracker.overdue(now).is_none());
        assert!(tracker.overdue(now + INTERVAL).is_some());
        assert!(tracker.overdue(now + INTERVAL * 2).is_none());
        assert_eq!(tracker.progress.done, 9_999);
    }
}
