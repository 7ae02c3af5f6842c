//! A ground station for tests: it knows the true poses and sends them with noise.
#![allow(deprecated, unreachable_pub)]

use std::time::Duration;

use mavlink::dialects::ardupilotmega::*;
use nalgebra::{Point3, Vector3};
use volery_simulator::*;

pub const MS: Duration = Duration::from_millis(1);
pub const POSITION: u16 = 0x0df8;
pub const POSITION_YAW: u16 = 0x09f8;
pub const VELOCITY: u16 = 0x0dc7;

/// One drone, a channel to it and one from it, and what the station does by itself.
pub struct Rig {
    pub world: World,
    pub link: Link,
    pub poses: PoseSource,
    pub now: Duration,
    pub inbox: Vec<MavMessage>,
    pub events: Vec<Event>,
    pub heartbeat: bool,
    /// Repeated at 10 Hz.
    pub stream: Option<Vector3<f64>>,
    pub reset_counter: u8,
    /// Turns the map about z before poses are sent, radians counter-clockwise.
    pub map_turn: f64,
    to: Channel,
    from: Channel,
}

impl Rig {
    pub fn new(options: DroneOptions) -> Self {
        Self::with(options, LinkFaults::default(), PoseOptions::default())
    }

    pub fn with(options: DroneOptions, faults: LinkFaults, poses: PoseOptions) -> Self {
        let seed = options.seed;
        Self {
            link: Link::new(255, 190, options.signing),
            world: World::new(Space::Open, vec![Drone::new(options)], 0.6),
            poses: PoseSource::new(poses, seed),
            now: Duration::ZERO,
            inbox: Vec::new(),
            events: Vec::new(),
            heartbeat: true,
            stream: None,
            reset_counter: 0,
            map_turn: 0.0,
            to: Channel::new(faults.clone(), seed),
            from: Channel::new(faults, seed + 1),
        }
    }

    /// From now on the link is as bad as `faults` say.
    pub fn with_faults(mut self, faults: LinkFaults, seed: u64) -> Self {
        self.to = Channel::new(faults.clone(), seed);
        self.from = Channel::new(faults, seed + 1);
        self
    }

    pub fn drone(&self) -> &Drone {
        &self.world.drones[0]
    }

    pub fn send(&mut self, message: &MavMessage) {
        let frame = self.link.encode(message, self.now);
        self.to.send(frame, self.now);
    }

    /// Runs until `until` holds; whether it did.
    pub fn run_until(&mut self, seconds: f64, mut until: impl FnMut(&Self) -> bool) -> bool {
        let end = self.now + Duration::from_secs_f64(seconds);
        while self.now < end {
            self.step();
            if until(self) {
                return true;
            }
        }
        false
    }

    pub fn run(&mut self, seconds: f64) {
        self.run_until(seconds, |_| false);
    }

    fn step(&mut self) {
        self.now += 10 * MS;
        let tick = self.now.as_millis() / 10;
        if self.heartbeat && tick.is_multiple_of(25) {
            self.send(&MavMessage::HEARTBEAT(HEARTBEAT_DATA {
                mavtype: MavType::MAV_TYPE_GCS,
                autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
                ..HEARTBEAT_DATA::DEFAULT
            }));
        }
        if let Some(target) = self.stream
            && tick.is_multiple_of(10)
        {
            self.go_to(target);
        }
        let truth = self.drone().world_from_body();
        for pose in self.poses.poll(&truth, self.now) {
            self.send_pose(&pose);
        }
        let drone = &mut self.world.drones[0];
        for datagram in self.to.receive(self.now) {
            drone.receive(&datagram, self.now);
        }
        self.world.step_to(self.now);
        for datagram in self.world.drones[0].poll() {
            self.from.send(datagram, self.now);
        }
        for datagram in self.from.receive(self.now) {
            let read = self.link.decode(&datagram, self.now);
            self.inbox.extend(read.into_iter().map(|r| r.unwrap().message));
        }
        self.events.extend(self.world.events().into_iter().map(|(.., event)| event));
    }

    fn send_pose(&mut self, pose: &PoseSample) {
        let map = nalgebra::UnitQuaternion::from_axis_angle(&Vector3::z_axis(), self.map_turn);
        let p = map * pose.world_from_body.translation.vector;
        let (_, _, yaw) = (map * pose.world_from_body.rotation).euler_angles();
        let mut covariance = [0.0; 21];
        covariance[0] = f32::NAN;
        self.send(&MavMessage::VISION_POSITION_ESTIMATE(VISION_POSITION_ESTIMATE_DATA {
            // A clock of its own.
            usec: pose.captured.as_micros() as u64 + 5_000_000_000,
            x: p.x as f32,
            y: -p.y as f32,
            z: -p.z as f32,
            yaw: -yaw as f32,
            covariance,
            reset_counter: self.reset_counter,
            ..VISION_POSITION_ESTIMATE_DATA::DEFAULT
        }));
    }

    pub fn set_origin(&mut self, altitude: i32) {
        self.send(&MavMessage::SET_GPS_GLOBAL_ORIGIN(SET_GPS_GLOBAL_ORIGIN_DATA {
            latitude: 473_977_420,
            longitude: 85_455_940,
            altitude,
            target_system: self.drone().options().system_id,
            time_usec: 0,
        }));
    }

    /// Sends a command and waits for its answer.
    pub fn command(&mut self, command: MavCmd, p: &[f32]) -> Option<MavResult> {
        let at = |i: usize| p.get(i).copied().unwrap_or(0.0);
        self.inbox.clear();
        self.send(&MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            param1: at(0),
            param2: at(1),
            param3: at(2),
            param4: at(3),
            param5: at(4),
            param6: at(5),
            param7: at(6),
            command,
            target_system: self.drone().options().system_id,
            target_component: 1,
            confirmation: 0,
        }));
        let find = |rig: &Self| {
            rig.inbox.iter().find_map(|m| match m {
                MavMessage::COMMAND_ACK(ack) if ack.command == command => Some(ack.result),
                _ => None,
            })
        };
        self.run_until(1.0, |rig| find(rig).is_some());
        find(self)
    }

    pub fn arm(&mut self, on: bool) -> Option<MavResult> {
        self.command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, &[f32::from(u8::from(on))])
    }

    pub fn set_mode(&mut self, mode: Mode) -> Option<MavResult> {
        let flavor = self.drone().options().flavor;
        let number = flavor.number(mode).unwrap();
        let p = match flavor {
            Flavor::ArduPilot => [1.0, number as f32, 0.0],
            Flavor::Px4 => [1.0, (number >> 16 & 255) as f32, (number >> 24) as f32],
        };
        self.command(MavCmd::MAV_CMD_DO_SET_MODE, &p)
    }

    /// Target in the world, z up.
    pub fn go_to(&mut self, target: Vector3<f64>) {
        self.set_target(target, POSITION, MavFrame::MAV_FRAME_LOCAL_NED, 0.0);
    }

    pub fn set_target(&mut self, target: Vector3<f64>, mask: u16, frame: MavFrame, yaw: f64) {
        let [x, y, z] = [target.x as f32, -target.y as f32, -target.z as f32];
        self.send(&MavMessage::SET_POSITION_TARGET_LOCAL_NED(SET_POSITION_TARGET_LOCAL_NED_DATA {
            x,
            y,
            z,
            vx: x,
            vy: y,
            vz: z,
            yaw: -yaw as f32,
            type_mask: PositionTargetTypemask::from_bits_retain(mask),
            target_system: self.drone().options().system_id,
            target_component: 1,
            coordinate_frame: frame,
            ..SET_POSITION_TARGET_LOCAL_NED_DATA::DEFAULT
        }));
    }

    pub fn is_near(&self, target: &Vector3<f64>, tolerance: f64) -> bool {
        (self.drone().body().position.coords - target).norm() < tolerance
    }

    /// Origin, mode, arming and a climb to 1.2 m.
    pub fn take_off(mut self) -> Self {
        self.run(0.1);
        self.set_origin(100_000);
        self.run(2.0);
        let start = self.drone().body().position;
        if self.drone().options().flavor == Flavor::Px4 {
            self.stream = Some(start.coords + Vector3::new(0.0, 0.0, 1.2));
            self.run(0.6);
        }
        let accepted = Some(MavResult::MAV_RESULT_ACCEPTED);
        assert_eq!(self.set_mode(Mode::Guided), accepted);
        assert_eq!(self.arm(true), accepted, "{:?}", self.events);
        if self.drone().options().flavor == Flavor::ArduPilot {
            let climb = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.2];
            assert_eq!(self.command(MavCmd::MAV_CMD_NAV_TAKEOFF, &climb), accepted);
        }
        let up = start.coords + Vector3::z() * 1.2;
        assert!(self.run_until(10.0, |rig| rig.is_near(&up, 0.15)), "{:?}", self.drone().body());
        self
    }
}

pub fn ardupilot() -> DroneOptions {
    DroneOptions::new(7, Flavor::ArduPilot, Point3::new(1.0, 2.0, 0.0))
}

pub fn px4() -> DroneOptions {
    DroneOptions::new(8, Flavor::Px4, Point3::new(1.0, 2.0, 0.0))
}
