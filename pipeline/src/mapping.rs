//! Third stage: verified pairs to a reconstruction.

use volery_scene::{CameraId, ImagePrior, Progress, Stage, TwoViewGeometry};
use volery_sfm::{ReconstructError, Reconstruction, SfmCamera, SfmImage, reconstruct};

use crate::{
    cache::{Cache, KeyMaker},
    error::{PipelineError, code},
    ingest::Usable,
    model_file::{read_reconstruction, write_reconstruction},
    options::StageOptions,
    spec::JobSpec,
};

/// Runs the mapper, or takes its result from the cache; tells which.
#[allow(clippy::too_many_arguments)]
pub(crate) fn map_pairs(
    spec: &JobSpec,
    photos: &[Usable],
    cameras: &[SfmCamera],
    camera_of: &[CameraId],
    priors: &[ImagePrior],
    pairs: &[TwoViewGeometry],
    options: &StageOptions,
    cache: &Cache,
    progress: &dyn Progress,
) -> Result<(Reconstruction, bool), PipelineError> {
    let mut key = KeyMaker::new("mapping")
        .with_debug(&cameras)
        .with_debug(&camera_of)
        .with_debug(&priors)
        .with_debug(&options.mapper)
        .with(&volery_formats::write_two_view_geometries(pairs));
    for usable in photos {
        key = key.with(usable.key.as_bytes()).with(spec.images[usable.input].name.as_bytes());
    }
    let key = key.key();
    if let Some(done) = cache.get(&key).and_then(|bytes| read_reconstruction(&bytes)) {
        progress.report(Stage::Mapping, photos.len(), photos.len());
        return Ok((done, true));
    }
    let images: Vec<SfmImage> = photos
        .iter()
        .enumerate()
        .map(|(i, usable)| SfmImage {
            name: spec.images[usable.input].name.clone(),
            camera: camera_of[i],
            colors: usable.photo.colors.clone(),
            prior: priors[i],
            ..SfmImage::from_features(i, usable.photo.features.clone())
        })
        .collect();
    let reconstruction = reconstruct(&images, cameras, pairs, &options.mapper, progress).map_err(
        |error| match error {
            ReconstructError::Cancelled(cancelled) => cancelled.into(),
            ReconstructError::TooFewImages { .. } => {
                PipelineError::plain(code::TOO_FEW_IMAGES, error.to_string())
            }
            ReconstructError::UnknownCamera { .. } => {
                PipelineError::plain(code::BAD_INPUT, error.to_string())
            }
        },
    )?;
    let bytes = write_reconstruction(&reconstruction)
        .map_err(|e| PipelineError::plain(code::IO, e.to_string()))?;
    cache.put(&key, &bytes)?;
    Ok((reconstruction, false))
}
