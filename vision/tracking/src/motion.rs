//! Where the camera is and how it moves: an error-state Kalman filter.

use nalgebra::{
    Isometry3, Matrix3, Matrix6, Point3, SMatrix, SVector, UnitQuaternion, Vector3, Vector6,
};
use volery_localization::PoseEstimate;

/// What a drone reports of itself beside its frames; camera along the nose.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Telemetry {
    /// Heading, radians clockwise from the compass's north, and its standard deviation. How north
    /// lies in the map is found out.
    pub heading: Option<(f64, f64)>,
    /// Height above any level, and its standard deviation, map units. How the level lies in the map
    /// is found out.
    pub height: Option<(f64, f64)>,
    /// Velocity east, north and up, and its standard deviation per axis, map units per second. Used
    /// once the heading is known.
    pub velocity: Option<(Vector3<f64>, f64)>,
}

/// How hard a drone moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionLimits {
    /// Standard deviation of the acceleration per axis, map units per s².
    pub acceleration: f64,
    /// Standard deviation of the angular acceleration about the vertical, radians per s².
    pub angular_acceleration: f64,
    /// Greatest speed, map units per second.
    pub max_speed: f64,
    /// Greatest turn rate, radians per second.
    pub max_turn_rate: f64,
}

impl Default for MotionLimits {
    fn default() -> Self {
        Self { acceleration: 2.0, angular_acceleration: 3.0, max_speed: 5.0, max_turn_rate: 3.0 }
    }
}

/// Position, rotation, velocity, turn rate (3 each), offset of the heading, offset of the height.
const STATES: usize = 14;
const HEADING_OFFSET: usize = 12;
const HEIGHT_OFFSET: usize = 13;

type Covariance = SMatrix<f64, STATES, STATES>;

/// Standard deviations of velocity and turn rate of a camera of which only a pose is known.
const INITIAL_SPEED: f64 = 0.7;
const INITIAL_TURN_RATE: f64 = 0.5;
/// Standard deviation of offsets that are not known, radians and map units.
const UNKNOWN_OFFSET: f64 = 1e3;
/// How offsets drift in a second, radians and map units.
const HEADING_DRIFT: f64 = 0.01;
const HEIGHT_DRIFT: f64 = 0.01;
/// Drones level themselves: turning about horizontal axes ends within this time, seconds, and
/// changes as much less than turning about the vertical one.
const LEVELING_S: f64 = 0.5;
const TILTING: f64 = 1.0 / 3.0;
/// By so much they lean from frame to frame when they brake, radians; it does not add up.
const SWING: f64 = 0.05;
/// Square of five deviations, and what exceeds χ² of six degrees of freedom as rarely.
const GATE_1: f64 = 25.0;
pub(crate) const GATE_6: f64 = 39.3;

/// Errors are those of the position, then of the rotation about the axes of the map: the order of
/// covariances of poses.
#[derive(Debug, Clone)]
pub(crate) struct Motion {
    position: Point3<f64>,
    rotation: UnitQuaternion<f64>,
    velocity: Vector3<f64>,
    turn_rate: Vector3<f64>,
    heading_offset: f64,
    height_offset: f64,
    covariance: Covariance,
    limits: MotionLimits,
}

impl Motion {
    /// At rest, as far as one knows.
    pub(crate) fn at(
        map_from_camera: &Isometry3<f64>,
        covariance: &Matrix6<f64>,
        limits: MotionLimits,
    ) -> Self {
        let mut all = Covariance::zeros();
        all.fixed_view_mut::<6, 6>(0, 0).copy_from(covariance);
        for k in 0..3 {
            all[(6 + k, 6 + k)] = INITIAL_SPEED * INITIAL_SPEED;
            all[(9 + k, 9 + k)] = INITIAL_TURN_RATE * INITIAL_TURN_RATE;
        }
        for k in [HEADING_OFFSET, HEIGHT_OFFSET] {
            all[(k, k)] = UNKNOWN_OFFSET * UNKNOWN_OFFSET;
        }
        Self {
            position: map_from_camera.translation.vector.into(),
            rotation: map_from_camera.rotation,
            velocity: Vector3::zeros(),
            turn_rate: Vector3::zeros(),
            heading_offset: 0.0,
            height_offset: 0.0,
            covariance: all,
            limits,
        }
    }

    pub(crate) fn map_from_camera(&self) -> Isometry3<f64> {
        Isometry3::from_parts(self.position.coords.into(), self.rotation)
    }

    /// Of the pose.
    pub(crate) fn covariance(&self) -> Matrix6<f64> {
        self.covariance.fixed_view::<6, 6>(0, 0).into_owned()
    }

    /// Moves on by `seconds` with the same velocities.
    pub(crate) fn predict(&mut self, seconds: f64) {
        let turn = UnitQuaternion::from_scaled_axis(self.turn_rate * seconds);
        self.position += self.velocity * seconds;
        self.rotation = UnitQuaternion::new_normalize((turn * self.rotation).into_inner());
        let mut transition = Covariance::identity();
        let ahead = Matrix3::identity() * seconds;
        transition.fixed_view_mut::<3, 3>(0, 6).copy_from(&ahead);
        transition.fixed_view_mut::<3, 3>(3, 9).copy_from(&ahead);
        let turn = turn.to_rotation_matrix().into_inner();
        transition.fixed_view_mut::<3, 3>(3, 3).copy_from(&turn);
        let left = (-seconds / LEVELING_S).exp();
        for k in 9..11 {
            transition[(k, k)] = left;
            self.turn_rate[k - 9] *= left;
        }
        self.covariance = transition * self.covariance * transition.transpose();
        let MotionLimits { acceleration: a, angular_acceleration: b, .. } = self.limits;
        for (k, sigma) in [a, a, a, b * TILTING, b * TILTING, b].into_iter().enumerate() {
            let variance = sigma * sigma;
            self.covariance[(k, k)] += variance * seconds.powi(4) / 4.0;
            self.covariance[(k + 6, k + 6)] += variance * seconds.powi(2);
            self.covariance[(k, k + 6)] += variance * seconds.powi(3) / 2.0;
            self.covariance[(k + 6, k)] += variance * seconds.powi(3) / 2.0;
        }
        self.covariance[(HEADING_OFFSET, HEADING_OFFSET)] += HEADING_DRIFT.powi(2) * seconds;
        self.covariance[(HEIGHT_OFFSET, HEIGHT_OFFSET)] += HEIGHT_DRIFT.powi(2) * seconds;
    }

    /// Whether a pose lies where the camera can be, by all that was seen before.
    pub(crate) fn admits(&self, estimate: &PoseEstimate) -> bool {
        let y = self.innovation(&estimate.map_from_camera);
        let mut spread = self.covariance() + estimate.covariance;
        for k in 3..5 {
            spread[(k, k)] += SWING * SWING;
        }
        // False for NaN.
        spread.cholesky().is_some_and(|c| y.dot(&c.solve(&y)) < GATE_6)
    }

    /// Whether position and rotation have at most these deviations along any axis.
    pub(crate) fn is_certain(&self, max_sigma: f64, max_turn: f64) -> bool {
        let is_below = |first: usize, sigma: f64| {
            let block = self.covariance.fixed_view::<3, 3>(first, first).into_owned();
            block.symmetric_eigenvalues().max() < sigma * sigma
        };
        is_below(0, max_sigma) && is_below(3, max_turn)
    }

    /// Takes in a measured pose.
    pub(crate) fn measure(&mut self, map_from_camera: &Isometry3<f64>, noise: &Matrix6<f64>) {
        let y = self.innovation(map_from_camera);
        let by_state = SMatrix::<f64, 6, STATES>::identity();
        self.update(&y, &by_state, noise);
    }

    /// Takes in what the drone reports.
    pub(crate) fn report(&mut self, telemetry: &Telemetry) {
        if let Some((heading, sigma)) = telemetry.heading {
            let forward = self.rotation * Vector3::z();
            // Looking up or down, a camera has no heading.
            if forward.xy().norm() > 0.3 {
                let own = forward.x.atan2(forward.y);
                let mut by_state = SMatrix::<f64, 1, STATES>::zeros();
                by_state[5] = -1.0;
                by_state[HEADING_OFFSET] = 1.0;
                let error = heading - own - self.heading_offset;
                self.update_one(error.sin().atan2(error.cos()), &by_state, sigma);
            }
        }
        if let Some((height, sigma)) = telemetry.height {
            let mut by_state = SMatrix::<f64, 1, STATES>::zeros();
            by_state[2] = 1.0;
            by_state[HEIGHT_OFFSET] = 1.0;
            let error = height - self.position.z - self.height_offset;
            self.update_one(error, &by_state, sigma);
        }
        let offset_variance = self.covariance[(HEADING_OFFSET, HEADING_OFFSET)];
        if let Some((velocity, sigma)) = telemetry.velocity.filter(|_| offset_variance < 0.1) {
            let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), self.heading_offset);
            let variance = sigma * sigma + offset_variance * velocity.norm_squared();
            let error = turn * velocity - self.velocity;
            for k in 0..3 {
                let mut by_state = SMatrix::<f64, 1, STATES>::zeros();
                by_state[6 + k] = 1.0;
                self.update_one(error[k], &by_state, variance.sqrt());
            }
        }
    }

    fn innovation(&self, map_from_camera: &Isometry3<f64>) -> Vector6<f64> {
        let shift = map_from_camera.translation.vector - self.position.coords;
        let turn = (map_from_camera.rotation * self.rotation.inverse()).scaled_axis();
        Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z)
    }

    /// A number, unless it is beyond five deviations.
    fn update_one(&mut self, y: f64, by_state: &SMatrix<f64, 1, STATES>, sigma: f64) {
        let noise = SMatrix::<f64, 1, 1>::new(sigma * sigma);
        let spread = (by_state * self.covariance * by_state.transpose())[0] + noise[0];
        // False for NaN.
        if y * y < GATE_1 * spread {
            self.update(&SVector::<f64, 1>::new(y), by_state, &noise);
        }
    }

    fn update<const N: usize>(
        &mut self,
        y: &SVector<f64, N>,
        by_state: &SMatrix<f64, N, STATES>,
        noise: &SMatrix<f64, N, N>,
    ) {
        let spread = by_state * self.covariance * by_state.transpose() + noise;
        let Some(inverse) = spread.try_inverse() else { return };
        let gain = self.covariance * by_state.transpose() * inverse;
        let error = gain * y;
        // Joseph's form stays symmetric and positive.
        let keep = Covariance::identity() - gain * by_state;
        self.covariance =
            keep * self.covariance * keep.transpose() + gain * noise * gain.transpose();
        let part = |first: usize| Vector3::new(error[first], error[first + 1], error[first + 2]);
        self.position += part(0);
        let turn = UnitQuaternion::from_scaled_axis(part(3));
        self.rotation = UnitQuaternion::new_normalize((turn * self.rotation).into_inner());
        self.velocity += part(6);
        self.turn_rate += part(9);
        self.heading_offset += error[HEADING_OFFSET];
        self.height_offset += error[HEIGHT_OFFSET];
    }
}

#[cfg(test)]
mod tests;
