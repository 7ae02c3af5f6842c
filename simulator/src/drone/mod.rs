//! A drone: body, sensors, estimator and autopilot. Datagrams and time come in, datagrams go out.

// Autopilots in the field speak the messages that are superseded.
#![allow(deprecated)]

mod commands;
mod failsafe;
mod guidance;
mod setpoints;
mod telemetry;
mod vision;

use std::collections::BTreeMap;
use std::time::Duration;

use mavlink::Message;
use mavlink::dialects::ardupilotmega::{
    MavAutopilot, MavMessage, MavSeverity, MavType, STATUSTEXT_DATA, TIMESYNC_DATA,
};
use nalgebra::{Isometry3, Point3, Vector3};
use volery_geometry::Rng;

use crate::body::Body;
use crate::link::AUTOPILOT;
use crate::{
    DroneOptions, Estimator, Event, Felt, Flavor, Link, Mode, Parameters, Received, Refusal,
};
use failsafe::Failsafe;
use guidance::Goal;
use telemetry::Streams;
use vision::Vision;

/// Time of a step of the physics.
pub const TICK: Duration = Duration::from_millis(20);
/// Speed downwards at which the floor breaks a drone, m/s.
const CRASH_SPEED: f64 = 1.5;
/// Height of the feet from which a drone counts as in the air, meters.
const IN_AIR: f64 = 0.1;
/// Charge at which it lands by itself, percent.
const CRITICAL_BATTERY: f64 = 10.0;

/// A simulated drone.
#[derive(Debug, Clone)]
pub struct Drone {
    options: DroneOptions,
    parameters: Parameters,
    link: Link,
    rng: Rng,
    now: Duration,
    // the world's
    body: Body,
    battery: f64,
    // the sensors'
    acceleration_bias: Vector3<f64>,
    gyro_bias: f64,
    // the autopilot's
    estimator: Estimator,
    vision: Vision,
    mode: Mode,
    armed_at: Option<Duration>,
    is_flying: bool,
    is_halted: bool,
    has_crashed: bool,
    failsafe: Option<Failsafe>,
    goal: Goal,
    speed: Option<f64>,
    ground_since: Option<Duration>,
    gcs_heard: Option<Duration>,
    setpoint_heard: Option<Duration>,
    /// Latitude, longitude (1e-7 degrees), altitude (mm).
    origin: Option<[i32; 3]>,
    streams: Streams,
    outbox: Vec<Vec<u8>>,
    events: Vec<(Duration, Event)>,
    refusals: BTreeMap<&'static str, u64>,
}

impl Drone {
    /// Switched on.
    pub fn new(options: DroneOptions) -> Self {
        let mut rng = Rng::fork(options.seed, u64::from(options.system_id));
        let mut parameters = Parameters::new(options.flavor, options.system_id);
        for (name, value) in &options.parameters {
            parameters.set(name, *value);
        }
        let inertial = options.inertial;
        Self {
            parameters,
            link: Link::new(options.system_id, AUTOPILOT, options.signing),
            now: Duration::ZERO,
            body: Body::standing(options.start, options.yaw),
            battery: options.battery,
            acceleration_bias: rng.normal3() * inertial.bias + inertial.drift,
            gyro_bias: rng.normal() * inertial.gyro_bias + inertial.yaw_drift,
            estimator: Estimator::default(),
            vision: Vision::default(),
            mode: Mode::Manual,
            armed_at: None,
            is_flying: false,
            is_halted: false,
            has_crashed: false,
            failsafe: None,
            goal: Goal::default(),
            speed: None,
            ground_since: Some(Duration::ZERO),
            gcs_heard: None,
            setpoint_heard: None,
            origin: None,
            streams: Streams::default(),
            outbox: Vec::new(),
            events: Vec::new(),
            refusals: BTreeMap::new(),
            rng,
            options,
        }
    }

    /// A datagram arrived.
    pub fn receive(&mut self, datagram: &[u8], now: Duration) {
        self.now = self.now.max(now);
        if self.is_halted {
            return;
        }
        for result in self.link.decode(datagram, now) {
            match result {
                Ok(received) => self.hear(&received),
                Err(refusal) => self.refuse(name_of(refusal)),
            }
        }
    }

    /// One tick that ends at `now`.
    pub fn step(&mut self, now: Duration) {
        self.now = now;
        let dt = TICK.as_secs_f64();
        let thrust = if self.is_halted {
            None
        } else {
            self.watch();
            self.thrust()
        };
        let is_on_floor = self.body.position.z <= 0.0;
        let push = self.rng.normal3();
        let felt = self.body.step(thrust, &push, self.options.gust, is_on_floor, dt);
        if thrust.is_some() {
            let spent = 100.0 * dt / self.options.endurance.as_secs_f64();
            self.battery = (self.battery - spent).max(0.0);
        }
        self.touch_floor();
        if self.is_halted {
            return;
        }
        let noise = self.rng.normal3() * self.options.inertial.noise;
        let measured = Felt {
            acceleration: felt.acceleration + self.acceleration_bias + noise,
            yaw_rate: felt.yaw_rate + self.gyro_bias + 0.002 * self.rng.normal(),
        };
        if self.armed_at.is_some() || self.is_flying {
            self.estimator.predict(now, &measured, dt);
        } else {
            // An autopilot that knows it stands does not dead-reckon.
            let still = Felt { acceleration: Vector3::zeros(), yaw_rate: measured.yaw_rate };
            self.estimator.predict(now, &still, dt);
            self.estimator.stand();
        }
        self.send_streams();
    }

    /// Datagrams to be sent.
    pub fn poll(&mut self) -> Vec<Vec<u8>> {
        std::mem::take(&mut self.outbox)
    }

    /// What happened since the last call.
    pub fn events(&mut self) -> Vec<(Duration, Event)> {
        std::mem::take(&mut self.events)
    }

    /// How it was built.
    pub fn options(&self) -> &DroneOptions {
        &self.options
    }

    /// Its true state.
    pub fn body(&self) -> &Body {
        &self.body
    }

    /// True pose of the body (x forward, y left, z up).
    pub fn world_from_body(&self) -> Isometry3<f64> {
        self.body.world_from_body()
    }

    /// What it believes.
    pub fn estimator(&self) -> &Estimator {
        &self.estimator
    }

    /// Who steers.
    pub fn mode(&self) -> Mode {
        self.mode
    }

    /// Whether the motors run.
    pub fn is_armed(&self) -> bool {
        self.armed_at.is_some()
    }

    /// Whether it has left the floor.
    pub fn is_flying(&self) -> bool {
        self.is_flying
    }

    /// Whether the floor ever broke it.
    pub fn has_crashed(&self) -> bool {
        self.has_crashed
    }

    /// What it acts against by itself.
    pub fn failsafe(&self) -> Option<&'static str> {
        self.failsafe.map(Failsafe::name)
    }

    /// Charge, percent.
    pub fn battery(&self) -> f64 {
        self.battery
    }

    /// Sets the charge: the fault "battery".
    pub fn set_battery(&mut self, percent: f64) {
        self.battery = percent;
    }

    /// How often something that came was not taken, by reason.
    pub fn refusals(&self) -> &BTreeMap<&'static str, u64> {
        &self.refusals
    }

    /// Poses that its estimator has taken.
    pub fn num_poses(&self) -> u64 {
        self.vision.num_taken
    }

    /// It ran into something and is back at `place`.
    pub(crate) fn bump(&mut self, place: Point3<f64>) {
        self.body.stop();
        self.body.position = place;
    }

    /// Its motors stop in the air.
    pub(crate) fn wreck(&mut self) {
        self.disarm("collision");
    }

    pub(crate) fn note(&mut self, event: Event) {
        self.events.push((self.now, event));
    }

    fn hear(&mut self, received: &Received) {
        let system_id = self.options.system_id;
        if received.system_id == system_id {
            return self.refuse("own system id");
        }
        let target = received.message.target_system_id().unwrap_or(0);
        if target != 0 && target != system_id {
            return;
        }
        match &received.message {
            MavMessage::HEARTBEAT(m) => {
                let is_station = m.mavtype == MavType::MAV_TYPE_GCS
                    && m.autopilot == MavAutopilot::MAV_AUTOPILOT_INVALID;
                // ArduPilot counts one ground station alone, PX4 any.
                let is_ours = self.is_px4()
                    || f64::from(received.system_id) == self.parameter("MAV_GCS_SYSID");
                if is_station && is_ours {
                    self.gcs_heard = Some(self.now);
                }
            }
            MavMessage::TIMESYNC(m) if m.tc1 == 0 => {
                let tc1 = self.uptime().as_nanos() as i64;
                self.send(&MavMessage::TIMESYNC(TIMESYNC_DATA {
                    tc1,
                    ts1: m.ts1,
                    ..Default::default()
                }));
            }
            MavMessage::SET_GPS_GLOBAL_ORIGIN(m) => {
                self.set_origin([m.latitude, m.longitude, m.altitude]);
            }
            MavMessage::VISION_POSITION_ESTIMATE(m) => self.see_pose(m),
            MavMessage::ODOMETRY(m) => self.see_odometry(m),
            MavMessage::SET_POSITION_TARGET_LOCAL_NED(m) => self.take_setpoint(m),
            MavMessage::SET_MODE(m) => {
                self.set_mode_number(m.custom_mode);
            }
            MavMessage::COMMAND_LONG(m) => self.take_command_long(received, m),
            MavMessage::COMMAND_INT(m) => self.take_command_int(received, m),
            MavMessage::PARAM_REQUEST_LIST(_) => self.streams.list_parameters(),
            MavMessage::PARAM_REQUEST_READ(m) => self.send_parameter(m),
            MavMessage::PARAM_SET(m) => self.set_parameter(m),
            _ => {}
        }
    }

    /// The floor is where z is 0.
    fn touch_floor(&mut self) {
        if self.body.position.z > IN_AIR && !self.is_flying {
            self.is_flying = true;
        }
        if self.body.position.z > 0.0 {
            self.ground_since = None;
            return;
        }
        let speed = -self.body.velocity.z;
        self.body.position.z = 0.0;
        if speed > 0.0 {
            self.body.stop();
            // The jolt is felt.
            self.estimator.stand();
        }
        if self.is_flying && speed > CRASH_SPEED {
            self.has_crashed = true;
            self.note(Event::Crash { speed });
            self.disarm("crash");
        }
        let since = *self.ground_since.get_or_insert(self.now);
        let patience = if self.is_px4() {
            Duration::from_secs_f64(self.parameter("COM_DISARM_LAND").max(0.0))
        } else {
            Duration::from_secs(1)
        };
        if self.is_flying && (!self.is_armed() || self.now.saturating_sub(since) > patience) {
            self.is_flying = false;
            self.note(Event::Landed);
            self.disarm("landed");
        }
    }

    fn is_px4(&self) -> bool {
        self.options.flavor == Flavor::Px4
    }

    fn parameter(&self, name: &str) -> f64 {
        self.parameters.get(name)
    }

    /// Since it was switched on.
    fn uptime(&self) -> Duration {
        self.options.warm_up + self.now
    }

    fn refuse(&mut self, why: &'static str) {
        *self.refusals.entry(why).or_default() += 1;
    }

    fn send(&mut self, message: &MavMessage) {
        let frame = self.link.encode(message, self.now);
        self.outbox.push(frame);
    }

    fn say(&mut self, severity: MavSeverity, text: &str) {
        let short: String = text.chars().take(50).collect();
        self.send(&MavMessage::STATUSTEXT(STATUSTEXT_DATA {
            severity,
            text: short.as_str().into(),
            ..Default::default()
        }));
        self.note(Event::Text { severity: severity as u8, text: text.to_owned() });
    }
}

fn name_of(refusal: Refusal) -> &'static str {
    match refusal {
        Refusal::Garbage => "garbage",
        Refusal::Version1 => "version 1",
        Refusal::Checksum => "checksum",
        Refusal::Unsigned => "unsigned",
        Refusal::Signature => "signature",
        Refusal::Replay => "replay",
        Refusal::Contents => "contents",
    }
}
