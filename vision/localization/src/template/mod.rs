//! The second way to a pose (P61): the photo is compared with views of a virtual camera.
//!
//! Needs a surface and a rough place; works where features cannot be matched.

pub mod similarity;

mod align;
mod coarse;
mod key_view;
mod light;
mod locate;
mod patches;
mod planes;
mod simd;
mod surface_share;
mod working;

pub use light::Light;
pub use locate::{
    SearchSide, TemplateAnswer, TemplateOptions, TemplateProof, localize_by_template,
};
pub use patches::{RenderScore, render_score};
pub use similarity::{Similarity, best_place};
