//! How far a job is, and what of it was found finished.

use volery_scene::{NoProgress, Progress, Stage};

/// A listener to the stages of a job.
pub trait StageProgress: Progress {
    /// `units` of a stage that was reported were found finished; none is nothing to tell.
    fn reused(&self, _stage: Stage, _units: usize) {}
}

impl StageProgress for NoProgress {}
