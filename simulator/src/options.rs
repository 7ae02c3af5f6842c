//! What a drone is like.

use std::time::Duration;

use nalgebra::{Point3, Vector3};

use crate::{Flavor, Signing};

/// A drone before it is switched on.
#[derive(Debug, Clone, PartialEq)]
pub struct DroneOptions {
    /// Its MAVLink system id.
    pub system_id: u8,
    /// Its autopilot.
    pub flavor: Flavor,
    /// Where its feet stand, world, z up.
    pub start: Point3<f64>,
    /// Where its nose looks, counter-clockwise from the world's x axis.
    pub yaw: f64,
    /// How long it has been on when the simulation begins.
    pub warm_up: Duration,
    /// Parameters that differ from those set up for flight by camera.
    pub parameters: Vec<(String, f64)>,
    /// Key of its link; then unsigned messages are refused.
    pub signing: Option<Signing>,
    /// What its inertial sensors do wrong.
    pub inertial: InertialFaults,
    /// Strength of gusts, m/s².
    pub gust: f64,
    /// Charge at the start, percent.
    pub battery: f64,
    /// Flight time of a full battery.
    pub endurance: Duration,
    /// Of all its noise.
    pub seed: u64,
}

/// Errors of the inertial sensors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InertialFaults {
    /// Standard deviation of the constant error of the accelerometer per axis, m/s².
    pub bias: f64,
    /// Standard deviation of the noise of the accelerometer per axis, m/s².
    pub noise: f64,
    /// Standard deviation of the constant error of the gyroscope, rad/s.
    pub gyro_bias: f64,
    /// A further constant error of the accelerometer: the fault "drift", m/s².
    pub drift: Vector3<f64>,
    /// A further constant error of the gyroscope: the fault "bad yaw", rad/s.
    pub yaw_drift: f64,
}

impl Default for InertialFaults {
    fn default() -> Self {
        Self { bias: 0.03, noise: 0.05, gyro_bias: 0.003, drift: Vector3::zeros(), yaw_drift: 0.0 }
    }
}

impl DroneOptions {
    /// A sound drone that has been on for a while.
    pub fn new(system_id: u8, flavor: Flavor, start: Point3<f64>) -> Self {
        Self {
            system_id,
            flavor,
            start,
            yaw: 0.0,
            warm_up: Duration::from_secs(30),
            parameters: Vec::new(),
            signing: None,
            inertial: InertialFaults::default(),
            gust: 0.1,
            battery: 100.0,
            endurance: Duration::from_secs(600),
            seed: u64::from(system_id),
        }
    }
}
