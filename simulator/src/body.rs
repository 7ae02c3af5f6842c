//! A rigid multicopter: what thrust, weight, air and floor do to it.

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};

/// m/s².
pub(crate) const GRAVITY: f64 = 9.81;
/// Seconds in which the attitude, and so the acceleration, follows the command.
const TILT_LAG: f64 = 0.12;
/// Part of the speed that the air takes per second.
const DRAG: f64 = 0.12;
/// Seconds over which a gust lasts.
const GUST_TIME: f64 = 0.8;

/// True state. World: z up. The position is that of the feet, so that the floor is at z = 0.
#[derive(Debug, Clone, PartialEq)]
pub struct Body {
    /// World.
    pub position: Point3<f64>,
    /// World.
    pub velocity: Vector3<f64>,
    /// Counter-clockwise from the world's x axis.
    pub yaw: f64,
    /// Clockwise, as a gyroscope with z down has it.
    pub yaw_rate: f64,
    /// Forward, right, down of the level body: what thrust gives beyond the weight.
    thrust: Vector3<f64>,
    gust: Vector3<f64>,
}

/// What the autopilot asks of the motors: level acceleration forward, right, down, and yaw rate
/// clockwise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Thrust {
    /// m/s².
    pub acceleration: Vector3<f64>,
    /// rad/s.
    pub yaw_rate: f64,
}

/// What inertial sensors would feel without their faults.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Felt {
    /// Forward, right, down of the level body, gravity taken off.
    pub acceleration: Vector3<f64>,
    /// Clockwise.
    pub yaw_rate: f64,
}

impl Body {
    /// At rest on the feet.
    pub fn standing(position: Point3<f64>, yaw: f64) -> Self {
        let zero = Vector3::zeros();
        Self { position, velocity: zero, yaw, yaw_rate: 0.0, thrust: zero, gust: zero }
    }

    /// `dt` seconds; without thrust it falls. `push` is white noise of the air with standard
    /// deviation 1 per axis, `gust` its strength, m/s².
    pub fn step(
        &mut self,
        thrust: Option<Thrust>,
        push: &Vector3<f64>,
        gust: f64,
        is_on_floor: bool,
        dt: f64,
    ) -> Felt {
        let before = self.velocity;
        match thrust {
            Some(Thrust { acceleration, yaw_rate }) => {
                let keep = (-dt / TILT_LAG).exp();
                self.thrust = acceleration + (self.thrust - acceleration) * keep;
                self.yaw_rate = yaw_rate + (self.yaw_rate - yaw_rate) * keep;
                let keep = (-dt / GUST_TIME).exp();
                self.gust = self.gust * keep + push * (gust * (1.0 - keep * keep).sqrt());
                let force = self.turned(&self.thrust) + self.gust - self.velocity * DRAG;
                self.velocity += force * dt;
            }
            None => {
                (self.thrust, self.gust, self.yaw_rate) = (Vector3::zeros(), Vector3::zeros(), 0.0);
                self.velocity.z -= GRAVITY * dt;
            }
        }
        if is_on_floor && self.velocity.z <= 0.0 {
            self.velocity = Vector3::zeros();
            self.yaw_rate = 0.0;
        }
        self.position += (before + self.velocity) * (dt / 2.0);
        self.yaw = wrap(self.yaw - self.yaw_rate * dt);
        let acceleration = (self.velocity - before) / dt;
        Felt { acceleration: self.turned(&acceleration), yaw_rate: self.yaw_rate }
    }

    /// Stops at an obstacle.
    pub fn stop(&mut self) {
        self.velocity = Vector3::zeros();
        self.thrust = Vector3::zeros();
    }

    /// Pitch (nose up) and roll (right side down) that the thrust takes.
    pub fn tilt(&self) -> [f64; 2] {
        [-(self.thrust.x / GRAVITY).atan(), (self.thrust.y / GRAVITY).atan()]
    }

    /// Pose of the body (x forward, y left, z up).
    pub fn world_from_body(&self) -> Isometry3<f64> {
        let [pitch, roll] = self.tilt();
        let rotation = UnitQuaternion::from_euler_angles(roll, -pitch, self.yaw);
        Isometry3::from_parts(self.position.coords.into(), rotation)
    }

    /// Between forward, right, down of the level body and the world; the turn is its own inverse.
    fn turned(&self, v: &Vector3<f64>) -> Vector3<f64> {
        let (sin, cos) = self.yaw.sin_cos();
        Vector3::new(cos * v.x + sin * v.y, sin * v.x - cos * v.y, -v.z)
    }
}

/// The same angle in (−π, π].
pub(crate) fn wrap(angle: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    let turned = (angle + PI).rem_euclid(TAU) - PI;
    if turned == -PI { PI } else { turned }
}

/// A vector of at most `limit`.
pub(crate) fn limited(v: &Vector3<f64>, limit: f64) -> Vector3<f64> {
    let norm = v.norm();
    if norm > limit { v * (limit / norm) } else { *v }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT: f64 = 0.02;

    /// Forward thrust with the nose to +y moves the drone along +y, nose down; thrust to the right
    /// along +x, right side down.
    #[test]
    fn thrust_moves_along_the_bodys_axes() {
        for (thrust, direction, tilt) in
            [(Vector3::x(), Vector3::y(), [-1.0, 0.0]), (Vector3::y(), Vector3::x(), [0.0, 1.0])]
        {
            let mut body = Body::standing(Point3::new(0.0, 0.0, 2.0), std::f64::consts::FRAC_PI_2);
            let command = Thrust { acceleration: thrust, yaw_rate: 0.0 };
            for _ in 0..50 {
                body.step(Some(command), &Vector3::zeros(), 0.0, false, DT);
            }
            assert!((body.velocity.normalize() - direction).norm() < 1e-9);
            // v = a (t - lag), less the drag.
            assert!((body.velocity.norm() - 0.83).abs() < 0.03, "{}", body.velocity.norm());
            for (angle, sign) in body.tilt().into_iter().zip(tilt) {
                assert!((angle - sign * 0.1016).abs() < 1e-3, "{angle}");
            }
            let nose = body.world_from_body().rotation * Vector3::x();
            assert!(nose.y > 0.99, "{nose}");
            assert_eq!(nose.z < -0.05, tilt[0] < 0.0, "the nose goes down to go forward");
        }
    }

    #[test]
    fn without_thrust_it_falls_and_a_floor_holds_it() {
        let mut body = Body::standing(Point3::new(0.0, 0.0, 2.0), 0.0);
        for _ in 0..25 {
            body.step(None, &Vector3::zeros(), 0.0, false, DT);
        }
        assert!((2.0 - body.position.z - 0.5 * GRAVITY * 0.25).abs() < 1e-9);
        let mut body = Body::standing(Point3::origin(), 0.0);
        let felt = body.step(None, &Vector3::zeros(), 0.0, true, DT);
        assert_eq!((body.position, felt.acceleration), (Point3::origin(), Vector3::zeros()));
    }
}
