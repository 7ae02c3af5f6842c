//! A stand-in for localization: true poses with noise, delay and faults, for runs in simulated
//! time.

use std::collections::VecDeque;
use std::ops::Range;
use std::time::Duration;

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use volery_geometry::Rng;

/// How good the poses are.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseOptions {
    /// Time between two frames.
    pub interval: Duration,
    /// From the frame to the pose.
    pub delay: Duration,
    /// Standard deviation per axis, meters.
    pub position_noise: f64,
    /// Standard deviation, radians.
    pub yaw_noise: f64,
}

impl Default for PoseOptions {
    fn default() -> Self {
        Self {
            interval: Duration::from_millis(50),
            delay: Duration::from_millis(50),
            position_noise: 0.02,
            yaw_noise: 0.005,
        }
    }
}

/// What can be wrong with poses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PoseFault {
    /// None come: a dark picture, a dead camera, a part of the room that is not in the map.
    Stop,
    /// The camera shows the same picture again and again.
    Freeze,
    /// All are off by so much.
    Jump(Vector3<f64>),
    /// All are turned by so much, radians counter-clockwise: the place is mistaken for its mirror.
    Turn(f64),
    /// They creep away, meters per second.
    Drift(Vector3<f64>),
}

/// A pose as localization gives it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseSample {
    /// When the frame was taken.
    pub captured: Duration,
    /// Body x forward, y left, z up.
    pub world_from_body: Isometry3<f64>,
}

/// Localizes one drone.
#[derive(Debug, Clone)]
pub struct PoseSource {
    options: PoseOptions,
    faults: Vec<(Range<Duration>, PoseFault)>,
    rng: Rng,
    next_frame: Duration,
    last: Option<Isometry3<f64>>,
    waiting: VecDeque<(Duration, PoseSample)>,
}

impl PoseSource {
    /// Without faults yet.
    pub fn new(options: PoseOptions, seed: u64) -> Self {
        let rng = Rng::fork(seed, 0x706f);
        let (faults, waiting) = (Vec::new(), VecDeque::new());
        Self { options, faults, rng, next_frame: Duration::ZERO, last: None, waiting }
    }

    /// Adds a fault.
    pub fn fail(&mut self, when: Range<Duration>, fault: PoseFault) {
        self.faults.push((when, fault));
    }

    /// Looks at the drone, whose true pose is given, and hands over what is known by now.
    pub fn poll(&mut self, world_from_body: &Isometry3<f64>, now: Duration) -> Vec<PoseSample> {
        if now >= self.next_frame {
            self.next_frame = (self.next_frame + self.options.interval).max(now);
            if let Some(world_from_body) = self.localize(world_from_body, now) {
                let sample = PoseSample { captured: now, world_from_body };
                self.waiting.push_back((now + self.options.delay, sample));
            }
        }
        let num = self.waiting.iter().take_while(|(due, _)| *due <= now).count();
        self.waiting.drain(..num).map(|(_, sample)| sample).collect()
    }

    fn localize(&mut self, truth: &Isometry3<f64>, now: Duration) -> Option<Isometry3<f64>> {
        let noise = self.rng.normal3() * self.options.position_noise;
        let turn = self.rng.normal() * self.options.yaw_noise;
        let mut pose = *truth;
        pose.translation.vector += noise;
        pose.rotation = about_z(turn) * pose.rotation;
        for (when, fault) in &self.faults {
            if !when.contains(&now) {
                continue;
            }
            match fault {
                PoseFault::Stop => return None,
                PoseFault::Freeze => return self.last,
                PoseFault::Jump(step) => pose.translation.vector += step,
                PoseFault::Turn(angle) => pose.rotation = about_z(*angle) * pose.rotation,
                PoseFault::Drift(speed) => {
                    pose.translation.vector += speed * (now - when.start).as_secs_f64();
                }
            }
        }
        self.last = Some(pose);
        Some(pose)
    }
}

fn about_z(angle: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle)
}
