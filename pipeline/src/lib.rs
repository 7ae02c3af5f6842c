//! A folder of photos to a folder with a map, stage by stage, resumable.

use std::path::Path;

mod atomic;
mod cache;
mod cameras;
mod clock;
mod dense;
mod export;
mod files;
mod foreign_model;
mod free_space;
mod heading;
mod ingest;
mod mapping;
mod matching;
mod mesh;
mod model_file;
mod moved;
mod options;
mod pair_log;
mod photo;
mod progress;
mod register;
mod report;
mod report_html;
mod report_surface;
mod run;
mod surface;
mod view;

pub mod error;
pub mod map_folder;
pub mod spec;
pub mod summary;
pub mod wire;
pub mod worker;

pub use error::PipelineError;
pub use foreign_model::{ForeignModel, read_foreign_model};
pub use heading::NorthInMap;
pub use map_folder::{MapFolder, MapInfo};
pub use moved::MovedBy;
pub use progress::StageProgress;
pub use register::{FoundBy, MapSource, PhotoReport, RegisterReport, extend_map, register_maps};
pub use spec::{CameraSpec, ImageInput, JobSpec, PoseSource, Preset, StageGroup};
pub use summary::Summary;
pub use view::Surface;
pub use volery_api::{Registration, RegistrationMethod};

/// Photos to a map folder.
///
/// * `work_dir` keeps finished units under the hash of what they were made from; a second run
///   with the same folder goes on where the first one stopped.
/// * `out_dir` gets the files of [`map_folder::file`], each written whole or not at all; `map.json`
///   is the last of the sparse map, the reports follow. A failed run leaves only reports.
/// * The dense cloud and the mesh come after the sparse map is whole. If they cannot be made, the
///   summary says why and the map is as good as it was; `map.json` is written anew with each.
/// * Equal photos, options and seed give equal bytes (all files but `report.*`).
pub fn reconstruct(
    spec: &JobSpec,
    work_dir: &Path,
    out_dir: &Path,
    progress: &dyn StageProgress,
) -> Result<Summary, PipelineError> {
    run::reconstruct(spec, work_dir, out_dir, progress)
}
