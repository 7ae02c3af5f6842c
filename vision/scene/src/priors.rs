//! What is known of an image before it is looked at.

use nalgebra::{Isometry3, Point3};
use serde::{Deserialize, Serialize};

/// Attitude of the camera as a drone reports it (camera along the nose).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct AttitudePrior {
    /// Heading, radians clockwise from the local frame's +y (north).
    pub yaw: f64,
    /// Nose up, radians.
    pub pitch: f64,
    /// Right side down, radians.
    pub roll: f64,
    /// Standard deviation of yaw, radians.
    pub sigma_yaw: f64,
    /// Standard deviation of pitch and of roll, radians.
    pub sigma_tilt: f64,
}

/// Height of the camera above a fixed level, meters.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct HeightPrior {
    /// Meters.
    pub height: f64,
    /// Standard deviation, meters.
    pub sigma: f64,
}

/// Position of the camera in a metric, z-up frame that all priors of a set share.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PositionPrior {
    /// Meters.
    pub position: Point3<f64>,
    /// Standard deviation per axis, meters.
    pub sigma: f64,
}

/// All priors of one image.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct ImagePrior {
    /// From the flight controller.
    pub attitude: Option<AttitudePrior>,
    /// From a barometer or range finder.
    pub height: Option<HeightPrior>,
    /// From a motion-capture system, RTK or a previous map.
    pub position: Option<PositionPrior>,
    /// The pose another program found: camera from world, camera axes x right, y down, z forward.
    /// The world is any that all priors of a set share. Believed only where a job says so.
    pub pose: Option<Isometry3<f64>>,
    /// Seconds since an arbitrary start; orders the images of a flight.
    pub time_s: Option<f64>,
}

/// The measured distance between the cameras of two images.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct KnownDistance {
    /// Image name.
    pub image_a: String,
    /// Image name.
    pub image_b: String,
    /// Meters.
    pub meters: f64,
}
