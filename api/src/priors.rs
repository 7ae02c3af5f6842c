//! What is known of photos before they are looked at.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::{Camera, CameraPose};

/// Attitude of the camera as a drone reports it (camera along the nose).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct AttitudePrior {
    /// Heading, radians clockwise from the local frame's +y (north).
    pub yaw: f64,
    /// Nose up, radians.
    #[serde(default)]
    pub pitch: f64,
    /// Right side down, radians.
    #[serde(default)]
    pub roll: f64,
    /// Standard deviation of yaw, radians.
    #[serde(default = "default_sigma_yaw")]
    pub sigma_yaw: f64,
    /// Standard deviation of pitch and of roll, radians.
    #[serde(default = "default_sigma_tilt")]
    pub sigma_tilt: f64,
}

fn default_sigma_yaw() -> f64 {
    0.05
}

fn default_sigma_tilt() -> f64 {
    0.02
}

/// Height of the camera above a fixed level.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct HeightPrior {
    /// Meters.
    pub height: f64,
    /// Standard deviation, meters.
    pub sigma: f64,
}

/// Position of the camera in a metric, z-up frame that all priors of a set share.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PositionPrior {
    /// x, y, z in meters.
    #[schema(min_items = 3, max_items = 3)]
    pub position: [f64; 3],
    /// Standard deviation per axis, meters.
    pub sigma: f64,
}

/// What is known of an image before it is looked at.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Prior {
    /// From the flight controller.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub attitude: Option<AttitudePrior>,
    /// From a barometer or range finder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height: Option<HeightPrior>,
    /// From motion capture, RTK or a previous map.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub position: Option<PositionPrior>,
    /// The pose that another program found, in a frame that the priors of a set share. Only jobs
    /// with `poses: given` or `given_metric` look at it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pose: Option<CameraPose>,
    /// Intrinsics of this image, where they differ from those of its set; kept fixed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<Camera>,
    /// Seconds since an arbitrary start; orders the images of a flight.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time_s: Option<f64>,
}

impl Prior {
    /// What is wrong with it, if anything: a number that is not finite, a sigma that is not
    /// positive, a quaternion that is none, a camera that makes no sense.
    pub fn problem(&self) -> Option<String> {
        let mut numbers = Vec::new();
        let mut sigmas = Vec::new();
        if let Some(attitude) = &self.attitude {
            numbers.extend([attitude.yaw, attitude.pitch, attitude.roll]);
            sigmas.extend([attitude.sigma_yaw, attitude.sigma_tilt]);
        }
        if let Some(height) = &self.height {
            numbers.push(height.height);
            sigmas.push(height.sigma);
        }
        if let Some(position) = &self.position {
            numbers.extend(position.position);
            sigmas.push(position.sigma);
        }
        numbers.extend(self.time_s);
        if numbers.iter().chain(&sigmas).any(|value| !value.is_finite()) {
            Some("numbers must be finite".to_owned())
        } else if sigmas.iter().any(|sigma| *sigma <= 0.0) {
            Some("sigmas must be positive".to_owned())
        } else {
            let pose = self.pose.as_ref().and_then(CameraPose::problem);
            pose.or_else(|| self.camera.as_ref().and_then(Camera::problem))
        }
    }
}

/// The measured distance between the cameras of two images.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct KnownDistance {
    /// Image name.
    pub image_a: String,
    /// Image name.
    pub image_b: String,
    /// Meters.
    pub meters: f64,
}

/// Where the poses of photos come from.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum PoseSource {
    /// From the photos.
    #[default]
    Estimated,
    /// From the priors, in a frame of any scale and attitude: only points are computed, and gravity,
    /// scale and origin found as for any map. Photos without a pose stay out.
    Given,
    /// The same, in meters with z up: the map keeps their frame.
    GivenMetric,
}

impl PoseSource {
    /// Whether the poses of priors are taken.
    pub fn is_given(self) -> bool {
        self != Self::Estimated
    }
}
