//! The words of the scene in those of the API, and back.

use nalgebra::{Isometry3, Quaternion, UnitQuaternion};
use volery_api::{Camera, CameraPose, Prior};
use volery_geometry::CameraModel;
use volery_scene::{AttitudePrior, HeightPrior, ImagePrior, PositionPrior};

use crate::{
    error::{PipelineError, code},
    spec::CameraSpec,
};

impl From<CameraSpec> for Camera {
    fn from(camera: CameraSpec) -> Self {
        let CameraSpec { model, width, height, params } = camera;
        Self { model: model.name().to_owned(), width, height, params }
    }
}

/// A camera whose model is known by name.
impl TryFrom<Camera> for CameraSpec {
    type Error = PipelineError;

    fn try_from(camera: Camera) -> Result<Self, PipelineError> {
        let Camera { model, width, height, params } = camera;
        let model = CameraModel::from_name(&model).ok_or_else(|| {
            PipelineError::plain(code::BAD_INPUT, format!("unknown camera model {model:?}"))
        })?;
        Ok(Self { model, width, height, params })
    }
}

/// Where a camera sits and how it is turned.
pub fn camera_pose(world_from_camera: &Isometry3<f64>) -> CameraPose {
    let (t, q) = (world_from_camera.translation.vector, world_from_camera.rotation);
    CameraPose { position: t.into(), orientation: [q.w, q.i, q.j, q.k] }
}

/// The other way, from a position and a quaternion w, x, y, z, which is made a unit one.
pub fn isometry(position: &[f64; 3], orientation: &[f64; 4]) -> Isometry3<f64> {
    let [w, i, j, k] = *orientation;
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(w, i, j, k));
    Isometry3::from_parts((*position).into(), rotation)
}

/// What is known of an image, for the service.
pub fn prior(prior: &ImagePrior) -> Prior {
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
        pose: prior.pose.map(|cam_from_world| camera_pose(&cam_from_world.inverse())),
        camera: None,
        time_s: prior.time_s,
    }
}

/// The other way. The intrinsics of a [`Prior`] are no part of it.
pub fn image_prior(wire: &Prior) -> ImagePrior {
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
        pose: wire.pose.as_ref().map(|pose| isometry(&pose.position, &pose.orientation).inverse()),
        time_s: wire.time_s,
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    #[test]
    fn a_prior_comes_back_from_the_wire() {
        let turn = UnitQuaternion::new(Vector3::new(0.3, -0.2, 1.1));
        let given = ImagePrior {
            attitude: Some(AttitudePrior {
                yaw: 1.0,
                pitch: 0.2,
                roll: -0.1,
                sigma_yaw: 0.05,
                sigma_tilt: 0.02,
            }),
            height: Some(HeightPrior { height: 1.5, sigma: 0.1 }),
            position: Some(PositionPrior { position: [1.0, 2.0, 3.0].into(), sigma: 0.3 }),
            pose: Some(Isometry3::from_parts([4.0, 5.0, 6.0].into(), turn)),
            time_s: Some(7.0),
        };
        let back = image_prior(&prior(&given));
        let (given_pose, pose) = (given.pose.unwrap(), back.pose.unwrap());
        assert!((given_pose.to_homogeneous() - pose.to_homogeneous()).norm() < 1e-12);
        assert_eq!(ImagePrior { pose: None, ..back }, ImagePrior { pose: None, ..given });
        assert_eq!(image_prior(&prior(&ImagePrior::default())), ImagePrior::default());
    }

    #[test]
    fn a_camera_comes_back_and_an_unknown_model_does_not() {
        let camera = CameraSpec {
            model: CameraModel::Pinhole,
            width: 640,
            height: 480,
            params: vec![500.0, 501.0, 320.0, 240.0],
        };
        let wire = Camera::from(camera.clone());
        assert_eq!(CameraSpec::try_from(wire.clone()).unwrap(), camera);
        let odd = Camera { model: "LENSBALL".to_owned(), ..wire };
        assert_eq!(CameraSpec::try_from(odd).unwrap_err().code, code::BAD_INPUT);
    }
}
