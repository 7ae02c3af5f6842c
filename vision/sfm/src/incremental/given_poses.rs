//! Points for images that stand where another program, or a rig, says they stand.

use volery_geometry::Camera;
use volery_scene::{Cancelled, Progress, SparseModel, Stage};

use super::{FINAL, GLOBAL, Input, MIN_EXTENSION_ANGLE, NUM_SEARCHES, WorkingModel};
use crate::{MapperOptions, tracks::build_tracks};

/// The model of the images with a given pose (`prior.pose`): their matches triangulated, the points
/// adjusted. Poses come out as they went in; images without one are in no model.
///
/// The poses are trusted, so that rays need less of an angle than where poses hang on the points.
pub(crate) fn triangulate_at_given_poses(
    input: Input<'_>,
    start: &[Camera],
    progress: &dyn Progress,
) -> Result<SparseModel, Cancelled> {
    let min_angle = input.options.min_angle.min(MIN_EXTENSION_ANGLE);
    let options = MapperOptions { min_angle, ..*input.options };
    let input = Input { options: &options, ..input };
    let tracks = build_tracks(input.images, input.pairs);
    let usable = vec![true; input.images.len()];
    let mut working = WorkingModel::new(input, start.to_vec(), &tracks, usable);
    for (pose, image) in working.poses.iter_mut().zip(input.images) {
        *pose = image.prior.pose;
    }
    let total = working.num_registered();
    progress.report(Stage::Mapping, 0, total);
    working.update_tracks();
    working.adjust_points(&GLOBAL, progress)?;
    working.update_tracks();
    for _ in 0..NUM_SEARCHES {
        working.search_by_projection();
        working.adjust_points(&working.narrowed(&GLOBAL), progress)?;
        working.update_tracks();
    }
    working.adjust_points(&working.narrowed(&FINAL), progress)?;
    working.filter_points();
    progress.report(Stage::Mapping, total, total);
    Ok(working.to_sparse())
}
