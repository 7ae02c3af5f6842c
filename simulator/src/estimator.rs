//! Where a drone believes to be: dead reckoning on bad inertial sensors, corrected by the poses it
//! is sent, late.

use std::collections::VecDeque;
use std::time::Duration;

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

use crate::Felt;
use crate::body::wrap;

/// Standard deviation of an accelerometer that the filter counts with, m/s².
const ACCELERATION_NOISE: f64 = 0.35;
/// Standard deviation of a gyroscope that the filter counts with, rad/s.
const GYRO_NOISE: f64 = 0.03;
/// Growth of the biases per second.
const BIAS_NOISE: [f64; 2] = [0.02, 0.001];
/// Oldest state that a late pose is compared with.
const HISTORY: Duration = Duration::from_millis(600);
/// Poses that make a place known.
const POSES_TO_START: u32 = 8;
/// Time between poses at which they count as one stream.
const MAX_GAP: Duration = Duration::from_millis(250);

/// A pose as it came: local frame, z down.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// Moment that it is of, on the drone's clock.
    pub time: Duration,
    /// Local.
    pub position: Vector3<f64>,
    /// Clockwise from the local x axis.
    pub yaw: f64,
    /// Standard deviation of the position per axis, meters.
    pub position_noise: f64,
    /// Standard deviation of the yaw, radians.
    pub yaw_noise: f64,
}

/// What happens to a pose far from where the drone believes to be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Gate {
    /// It is followed at once (ArduPilot with external navigation).
    Follow,
    /// It is refused; after so long of nothing else it is followed (PX4).
    Refuse(Duration),
}

/// What became of a pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fusion {
    /// It was weighed.
    Fused,
    /// The state was set to it.
    Reset,
    /// It was too far off.
    Gated,
}

/// State of a filter that is the same for its three axes, so that one covariance serves all.
#[derive(Debug, Clone)]
pub struct Estimator {
    /// Rows position, velocity, bias of the accelerometer; columns x, y, z of the local frame.
    state: Matrix3<f64>,
    covariance: Matrix3<f64>,
    /// Yaw and bias of the gyroscope.
    turn: Vector2<f64>,
    turn_covariance: Matrix2<f64>,
    history: VecDeque<(Duration, Vector3<f64>, f64)>,
    last: Option<Duration>,
    gated_since: Option<Duration>,
    num_in_a_row: u32,
    /// Distance of the last pose from where it was expected, meters.
    pub innovation: f64,
}

impl Default for Estimator {
    fn default() -> Self {
        Self {
            state: Matrix3::zeros(),
            covariance: start_covariance(0.1),
            turn: Vector2::zeros(),
            turn_covariance: Matrix2::from_diagonal(&Vector2::new(0.01, 1e-4)),
            history: VecDeque::new(),
            last: None,
            gated_since: None,
            num_in_a_row: 0,
            innovation: 0.0,
        }
    }
}

fn start_covariance(position_noise: f64) -> Matrix3<f64> {
    Matrix3::from_diagonal(&Vector3::new(position_noise * position_noise, 0.01, 0.01))
}

impl Estimator {
    /// Local, z down.
    pub fn position(&self) -> Vector3<f64> {
        self.state.row(0).transpose()
    }

    /// Local, z down.
    pub fn velocity(&self) -> Vector3<f64> {
        self.state.row(1).transpose()
    }

    /// Clockwise from the local x axis.
    pub fn yaw(&self) -> f64 {
        self.turn.x
    }

    /// Standard deviation of the position per axis.
    pub fn position_sigma(&self) -> f64 {
        self.covariance[(0, 0)].sqrt()
    }

    /// When a pose was last taken.
    pub fn last(&self) -> Option<Duration> {
        self.last
    }

    /// Whether poses came long enough to know the place.
    pub fn has_started(&self) -> bool {
        self.num_in_a_row >= POSES_TO_START
    }

    /// Forgets the place.
    pub fn lose(&mut self) {
        self.num_in_a_row = 0;
    }

    /// The drone stands.
    pub fn stand(&mut self) {
        self.state.set_row(1, &Vector3::zeros().transpose());
    }

    /// Dead reckoning over `dt` seconds that end at `now`.
    pub fn predict(&mut self, now: Duration, felt: &Felt, dt: f64) {
        let (sin, cos) = self.yaw().sin_cos();
        let a = &felt.acceleration;
        let local = Vector3::new(cos * a.x - sin * a.y, sin * a.x + cos * a.y, a.z);
        // x' = F x + G a with the bias taken off the acceleration.
        let f = Matrix3::new(1.0, dt, -0.5 * dt * dt, 0.0, 1.0, -dt, 0.0, 0.0, 1.0);
        let g = Vector3::new(0.5 * dt * dt, dt, 0.0);
        self.state = f * self.state + g * local.transpose();
        self.covariance = f * self.covariance * f.transpose()
            + g * g.transpose() * ACCELERATION_NOISE.powi(2)
            + Matrix3::from_diagonal(&Vector3::new(0.0, 0.0, BIAS_NOISE[0].powi(2) * dt));
        let f = Matrix2::new(1.0, -dt, 0.0, 1.0);
        self.turn = f * self.turn + Vector2::new(felt.yaw_rate * dt, 0.0);
        self.turn.x = wrap(self.turn.x);
        self.turn_covariance = f * self.turn_covariance * f.transpose()
            + Matrix2::from_diagonal(&Vector2::new(
                (GYRO_NOISE * dt).powi(2),
                BIAS_NOISE[1].powi(2) * dt,
            ));
        self.history.push_back((now, self.position(), self.yaw()));
        while self.history.front().is_some_and(|(time, ..)| *time + HISTORY < now) {
            self.history.pop_front();
        }
    }

    /// Weighs a pose against the state of its moment. `sigmas`: distance in standard deviations at
    /// which the `gate` acts.
    pub fn correct(&mut self, now: Duration, seen: &Sighting, sigmas: f64, gate: Gate) -> Fusion {
        let is_lost =
            self.last.is_none_or(|last| now.saturating_sub(last) > Duration::from_secs(1));
        let Some(&(_, position, yaw)) =
            self.history.iter().min_by_key(|(time, ..)| time.abs_diff(seen.time))
        else {
            return self.reset(now, seen);
        };
        if is_lost || !self.has_started() && self.last.is_none() {
            return self.reset(now, seen);
        }
        let innovation = seen.position - position;
        self.innovation = innovation.norm();
        let r = seen.position_noise.powi(2);
        let limit = sigmas * (self.covariance[(0, 0)] + r).sqrt();
        if innovation.amax() > limit {
            let since = *self.gated_since.get_or_insert(now);
            match gate {
                Gate::Refuse(patience) if now.saturating_sub(since) < patience => {
                    return Fusion::Gated;
                }
                _ => return self.reset(now, seen),
            }
        }
        self.gated_since = None;
        let gain: Vector3<f64> = self.covariance.column(0) / (self.covariance[(0, 0)] + r);
        let share = gain.x;
        self.state += gain * innovation.transpose();
        self.covariance -= gain * self.covariance.row(0);
        let turn = wrap(seen.yaw - yaw);
        let gain: Vector2<f64> = self.turn_covariance.column(0)
            / (self.turn_covariance[(0, 0)] + seen.yaw_noise.powi(2));
        let turn_share = gain.x;
        self.turn += gain * turn;
        self.turn.x = wrap(self.turn.x);
        self.turn_covariance -= gain * self.turn_covariance.row(0);
        self.shift_history(&(innovation * share), turn * turn_share);
        self.taken(now);
        Fusion::Fused
    }

    /// Sets place and yaw; the velocity is kept while the drone was not lost.
    pub fn reset(&mut self, now: Duration, seen: &Sighting) -> Fusion {
        let known = self.history.iter().min_by_key(|(time, ..)| time.abs_diff(seen.time)).copied();
        let (position, yaw) = known.map_or((self.position(), self.yaw()), |(_, p, y)| (p, y));
        // What has been flown since the pose was taken stays.
        let (step, turn) = (seen.position - position, wrap(seen.yaw - yaw));
        let place = self.position() + step;
        self.state.set_row(0, &place.transpose());
        self.turn.x = wrap(self.turn.x + turn);
        let is_lost =
            self.last.is_none_or(|last| now.saturating_sub(last) > Duration::from_secs(1));
        if is_lost {
            self.stand();
        }
        self.covariance = start_covariance(seen.position_noise);
        self.turn_covariance[(0, 0)] = seen.yaw_noise.powi(2);
        self.shift_history(&step, turn);
        self.gated_since = None;
        self.taken(now);
        Fusion::Reset
    }

    fn shift_history(&mut self, step: &Vector3<f64>, turn: f64) {
        for (_, position, yaw) in &mut self.history {
            *position += step;
            *yaw = wrap(*yaw + turn);
        }
    }

    fn taken(&mut self, now: Duration) {
        let is_stream = self.last.is_some_and(|last| now.saturating_sub(last) <= MAX_GAP);
        // A place once known stays known until it is lost.
        if is_stream || self.has_started() {
            self.num_in_a_row = self.num_in_a_row.saturating_add(1);
        } else {
            self.num_in_a_row = 1;
        }
        self.last = Some(now);
    }
}
