//! A job as the service words it, in the words of the pipeline.

use std::path::Path;

use nalgebra::{Isometry3, Quaternion, UnitQuaternion};
use volery_api::{Camera, CameraPose, KnownDistance, OriginRule, Prior, worker};
use volery_geometry::CameraModel;
use volery_scene::{AttitudePrior, HeightPrior, ImagePrior, PositionPrior};

use crate::{
    error::{PipelineError, code},
    spec::{CameraSpec, ImageInput, JobSpec},
};

/// The reconstruction that `job.json` asks for. Relative paths start in `work_dir`.
pub(crate) fn job_spec(wire: worker::JobSpec, work_dir: &Path) -> Result<JobSpec, PipelineError> {
    let images = wire.images.into_iter().map(|image| {
        Ok(ImageInput {
            prior: prior(&image.prior),
            camera: image.prior.camera.or(image.camera).map(camera).transpose()?,
            // An absolute path stays as it is.
            ..ImageInput::new(image.name, work_dir.join(image.path))
        })
    });
    Ok(JobSpec {
        images: images.collect::<Result<_, PipelineError>>()?,
        camera: wire.camera.map(camera).transpose()?,
        known_distances: wire.known_distances.into_iter().map(known_distance).collect(),
        preset: wire.preset,
        seed: wire.seed,
        origin: wire.origin.map(origin),
        poses: wire.poses,
        max_image_size: wire.max_image_size,
        stages: wire.stages,
    })
}

/// A camera whose model is known by name.
pub(crate) fn camera(wire: Camera) -> Result<CameraSpec, PipelineError> {
    let Camera { model, width, height, params } = wire;
    let model = CameraModel::from_name(&model).ok_or_else(|| {
        PipelineError::plain(code::BAD_INPUT, format!("unknown camera model {model:?}"))
    })?;
    Ok(CameraSpec { model, width, height, params })
}

/// A camera in the words of the service.
pub(crate) fn to_wire(camera: CameraSpec) -> Camera {
    let CameraSpec { model, width, height, params } = camera;
    Camera { model: model.name().to_owned(), width, height, params }
}

/// The pose of a camera, where it sits and how it is turned.
pub(crate) fn pose(world_from_camera: &Isometry3<f64>) -> CameraPose {
    let (t, q) = (world_from_camera.translation.vector, world_from_camera.rotation);
    CameraPose { position: t.into(), orientation: [q.w, q.i, q.j, q.k] }
}

/// The other way; the quaternion is made a unit one.
pub(crate) fn world_from_camera(pose: &CameraPose) -> Isometry3<f64> {
    let [w, i, j, k] = pose.orientation;
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(w, i, j, k));
    Isometry3::from_parts(pose.position.into(), rotation)
}

fn prior(wire: &Prior) -> ImagePrior {
    ImagePrior {
        attitude: wire.attitude.map(|a| AttitudePrior {
            yaw: a.yaw,
            pitch: a.pitch,
            roll: a.roll,
            sigma_yaw: a.sigma_yaw,
            sigma_tilt: a.sigma_tilt,
        }),
        height: wire.height.map(|h| HeightPrior { height: h.height, sigma: h.sigma }),
        position: wire
            .position
            .map(|p| PositionPrior { position: p.position.into(), sigma: p.sigma }),
        pose: wire.pose.as_ref().map(|pose| world_from_camera(pose).inverse()),
        time_s: wire.time_s,
    }
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
