//! An image and a map to a pose.

pub mod index;
pub mod localize;

pub use index::LocalizationIndex;
pub use localize::{
    LocalizationAnswer, LocalizationPrior, LocalizeOptions, NotFoundReason, PoseEstimate, Status,
    StepTimings, localize,
};
