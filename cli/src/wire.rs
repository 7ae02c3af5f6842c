//! Words of the scene in those of the API.

use std::collections::BTreeMap;

use volery_api::{Camera, CameraPose, Prior};
use volery_geometry::Isometry3;
use volery_pipeline::CameraSpec;
use volery_scene::ImagePrior;

pub(crate) fn wire_camera(camera: &CameraSpec) -> Camera {
    Camera {
        model: camera.model.name().to_owned(),
        width: camera.width,
        height: camera.height,
        params: camera.params.clone(),
    }
}

fn wire_pose(world_from_cam: &Isometry3<f64>) -> CameraPose {
    let (t, q) = (world_from_cam.translation.vector, world_from_cam.rotation);
    CameraPose { position: t.into(), orientation: [q.w, q.i, q.j, q.k] }
}

/// The priors of the scene and of the API are the same on the wire.
pub(crate) fn wire_prior(prior: &ImagePrior) -> Prior {
    Prior {
        attitude: prior.attitude.map(|a| volery_api::AttitudePrior {
            yaw: a.yaw,
            pitch: a.pitch,
            roll: a.roll,
            sigma_yaw: a.sigma_yaw,
            sigma_tilt: a.sigma_tilt,
        }),
        height: prior.height.map(|h| volery_api::HeightPrior { height: h.height, sigma: h.sigma }),
        position: prior.position.map(|p| volery_api::PositionPrior {
            position: p.position.coords.into(),
            sigma: p.sigma,
        }),
        pose: prior.pose.map(|cam_from_world| wire_pose(&cam_from_world.inverse())),
        camera: None,
        time_s: prior.time_s,
    }
}

/// Priors of many images.
pub(crate) fn wire_priors<'a>(
    priors: impl IntoIterator<Item = (&'a str, &'a ImagePrior)>,
) -> BTreeMap<String, Prior> {
    priors.into_iter().map(|(name, prior)| (name.to_owned(), wire_prior(prior))).collect()
}
