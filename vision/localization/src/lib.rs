//! An image and a map to a pose.

pub mod index;
pub mod localize;
pub mod template;

mod acceptance;
mod bytes;
mod correspondences;
mod guided;
mod map_noise;
mod map_share;
mod near;
mod refine;
mod solve;

pub use correspondences::Pair as Correspondence;
pub use index::{ImageRows, IndexError, LocalizationIndex};
pub use localize::{
    LocalizationAnswer, LocalizationPrior, LocalizeOptions, NotFoundReason, PoseEstimate,
    Reference, Status, StepTimings, localize, localize_features,
};
pub use near::{SeenPoint, SeenPose, localize_near, pose_from_points};
pub use template::{
    RenderScore, SearchSide, TemplateAnswer, TemplateOptions, TemplateProof, localize_by_template,
    render_score,
};
