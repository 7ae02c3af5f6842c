//! A job as the service words it, in the words of the pipeline.

use std::path::Path;

use volery_api::{KnownDistance, OriginRule, worker};

use crate::{
    error::PipelineError,
    spec::{CameraSpec, ImageInput, JobSpec},
    wire::image_prior,
};

/// The reconstruction that `job.json` asks for. Relative paths start in `work_dir`.
pub(crate) fn job_spec(wire: worker::JobSpec, work_dir: &Path) -> Result<JobSpec, PipelineError> {
    let images = wire.images.into_iter().map(|image| {
        Ok(ImageInput {
            prior: image_prior(&image.prior),
            camera_group: image.camera_group,
            camera: image.prior.camera.or(image.camera).map(CameraSpec::try_from).transpose()?,
            // An absolute path stays as it is.
            ..ImageInput::new(image.name, work_dir.join(image.path))
        })
    });
    Ok(JobSpec {
        images: images.collect::<Result<_, PipelineError>>()?,
        camera: wire.camera.map(CameraSpec::try_from).transpose()?,
        known_distances: wire.known_distances.into_iter().map(known_distance).collect(),
        preset: wire.preset,
        seed: wire.seed,
        origin: wire.origin.map(origin),
        poses: wire.poses,
        options: wire.options,
        stages: wire.stages,
    })
}

fn known_distance(wire: KnownDistance) -> volery_scene::KnownDistance {
    let KnownDistance { image_a, image_b, meters } = wire;
    volery_scene::KnownDistance { image_a, image_b, meters }
}

fn origin(wire: OriginRule) -> volery_scene::OriginRule {
    match wire {
        OriginRule::LastCamera => volery_scene::OriginRule::LastCamera,
        OriginRule::MeanCameras => volery_scene::OriginRule::MeanCameras,
        OriginRule::Given => volery_scene::OriginRule::Given,
    }
}
