//! The second half: simulated drones with cameras find their places in the map and fly as a group
//! to crossing goals.

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::net::SocketAddr;
use std::time::{Duration, Instant};

use nalgebra::{Isometry3, Point3, Vector2, Vector3};
use tokio::sync::oneshot;
use tokio::task::JoinHandle;
use uuid::Uuid;
use volery_api::{
    CameraMount, CameraPose, CreateFlight, Drone, DroneCommand, FenceBlock, Flight, FlightDrone,
    FlightGoal, Geofence, PutDrone, VisionMessage,
};
use volery_client::Client;
use volery_geometry::{Camera, CameraModel, triangulation::camera_center};
use volery_pipeline::{CameraSpec, PipelineError, wire};
use volery_simulator::shell::{
    Feed, FrameSink, Simulation, SimulationError, StreamTarget, Summary, simulate,
};
use volery_simulator::{DroneOptions, Eye, Flavor, Mount, Scenery, Space};
use volery_synthetic::DemoHall;

use super::{mapping::Mapped, record::Recorder};
use crate::remote::failed;

/// Half axes of the ellipse around the middle of the scan on which drones start, meters.
const AROUND: [f64; 2] = [2.0, 1.6];
/// Height of the group over the floor, meters.
const HEIGHT: f64 = 1.5;
/// Free place around the middle, along the hall's axes, meters.
const FREE: [f64; 2] = [3.1, 2.6];
/// Free place over the floor, meters: nobody is sent along the floor, or between the beams.
const FREE_HEIGHTS: [f64; 2] = [0.4, 3.3];
/// Pictures per second and drone.
const FRAME_RATE: f64 = 10.0;
/// Of the true states that are kept.
const STATE_INTERVAL: Duration = Duration::from_millis(100);
const POLL: Duration = Duration::from_millis(100);
/// Until all estimators follow the camera's poses.
const READY_BY: Duration = Duration::from_secs(60);
const LANDED_BY: Duration = Duration::from_secs(30);
/// What a flight may take beyond its plan: the way up, and waits for those who lag.
const FLIGHT_SLACK: Duration = Duration::from_secs(90);

/// Small pictures: four times less to draw and to search than those of the scan.
fn drone_camera() -> Camera {
    Camera::from_focal(CameraModel::Pinhole, 320, 240, 228.5).expect("constants are valid")
}

/// Simulated drones that run beside everything else.
pub(super) struct Swarm {
    client: Client,
    map_id: Uuid,
    middle: Point3<f64>,
    world_from_map: Isometry3<f64>,
    pub(super) record: Recorder,
    /// Where each stands before it takes off, in the map.
    homes: BTreeMap<u8, Point3<f64>>,
    num_crossings: u32,
    stop: oneshot::Sender<()>,
    running: JoinHandle<Result<Summary, SimulationError>>,
}

/// Where everybody should be now: a goal of each drone, in the map.
pub(super) type Goals = BTreeMap<u8, Point3<f64>>;

impl Swarm {
    /// Switches registered drones on, numbered from 1; returns when all know their places.
    pub(super) async fn start(
        client: &Client,
        mavlink: SocketAddr,
        num_drones: u8,
        hall: &DemoHall,
        mapped: &Mapped,
        seed: u64,
    ) -> Result<Self, PipelineError> {
        let map_id = mapped.map_id;
        let camera = drone_camera();
        let target = StreamTarget {
            client: client.clone(),
            map_id,
            camera: CameraSpec::from(&camera).into(),
        };
        let simulation = Simulation {
            server: mavlink,
            bind: mavlink.ip(),
            drones: drones(hall, num_drones, seed),
            space: Space::Room(hall.hall.room.clone()),
            separation: 1.0,
            faults: Vec::new(),
            feed: Some(Feed {
                eye: Eye::new(
                    Scenery::Hall(Box::new(hall.hall.clone())),
                    &camera,
                    Mount::default(),
                ),
                interval: Duration::from_secs_f64(1.0 / FRAME_RATE),
                sink: FrameSink::Stream(target),
            }),
            report_interval: STATE_INTERVAL,
        };
        let record = Recorder::default();
        let (stop, stopped) = oneshot::channel::<()>();
        let running = tokio::spawn({
            let record = record.clone();
            async move {
                // Dropping the sender ends it too.
                let stopped = async { drop(stopped.await) };
                simulate(simulation, stopped, |line| record.add(line)).await
            }
        });
        let mut swarm = Self {
            client: client.clone(),
            map_id,
            middle: mapped.middle,
            world_from_map: mapped.world_from_map,
            record,
            homes: BTreeMap::new(),
            num_crossings: 0,
            stop,
            running,
        };
        swarm.wait_until_ready(num_drones).await?;
        Ok(swarm)
    }

    async fn wait_until_ready(&mut self, num_drones: u8) -> Result<(), PipelineError> {
        let by = Instant::now() + READY_BY;
        loop {
            let heard = self.client.drones().await.map_err(failed)?;
            let ready: Vec<_> = heard.iter().filter_map(ready_at).collect();
            if ready.len() == usize::from(num_drones) {
                self.homes = ready.into_iter().collect();
                return Ok(());
            }
            if Instant::now() > by {
                return Err(not_ready(&heard));
            }
            tokio::time::sleep(POLL).await;
        }
    }

    /// Drones stay in the free middle of the hall.
    pub(super) async fn fence(&self) -> Result<(), PipelineError> {
        let floor = self.homes.values().map(|p| p.z).fold(f64::INFINITY, f64::min);
        let middle = self.world_from_map * self.middle;
        let [x, y] = FREE;
        let corners = [[-x, -y], [x, -y], [x, y], [-x, y]];
        let corner = |[x, y]: [f64; 2]| {
            let in_hall = Point3::new(middle.x + x, middle.y + y, middle.z);
            self.world_from_map.inverse_transform_point(&in_hall).xy().coords.into()
        };
        let fence = Geofence {
            map_id: self.map_id,
            area: FenceBlock {
                outline: corners.map(corner).to_vec(),
                floor: floor + FREE_HEIGHTS[0],
                ceiling: floor + FREE_HEIGHTS[1],
            },
            keep_out: Vec::new(),
            margin_m: 0.2,
        };
        self.client.put_geofence(&fence).await.map_err(failed)?;
        Ok(())
    }

    /// Everybody to the other side of the middle at once, from the floor the first time. Returns
    /// the flight as it ended, and where everybody should be.
    pub(super) async fn cross(&mut self) -> Result<(Flight, Goals), PipelineError> {
        let (is_first, is_outward) =
            (self.num_crossings == 0, self.num_crossings.is_multiple_of(2));
        self.num_crossings += 1;
        let up = Vector3::z() * HEIGHT;
        let goals: Goals = self
            .homes
            .iter()
            .map(|(&id, home)| {
                let across = self.middle + (self.middle - home);
                let there = Point3::new(across.x, across.y, home.z);
                (id, if is_outward { there } else { *home } + up)
            })
            .collect();
        let goal =
            |position: &Point3<f64>| FlightGoal { position: position.coords.into(), yaw: None };
        let request = CreateFlight {
            map_id: self.map_id,
            drones: self
                .homes
                .iter()
                .map(|(&id, home)| FlightDrone {
                    id,
                    start: is_first.then(|| goal(&(home + up))),
                    goals: vec![goal(&goals[&id])],
                })
                .collect(),
            style: Default::default(),
            exchange_goals: false,
            separation_m: None,
            margin_m: None,
            speed: None,
            views: false,
            // Cameras that look outwards do not see the middle of their own hall.
            allow_unseen: true,
        };
        let flight = self.client.create_flight(&request).await.map_err(failed)?;
        self.client.start_flight(flight.id).await.map_err(failed)?;
        let by = Instant::now() + Duration::from_secs_f64(2.0 * flight.duration_s) + FLIGHT_SLACK;
        loop {
            let flight = self.client.flight(flight.id).await.map_err(failed)?;
            if matches!(flight.state.as_str(), "finished" | "aborted") || Instant::now() > by {
                return Ok((flight, goals));
            }
            tokio::time::sleep(POLL).await;
        }
    }

    /// Everybody down. Those who do not get there are told of by the record.
    pub(super) async fn land(&self) -> Result<(), PipelineError> {
        for &id in self.homes.keys() {
            // One that lands already, or has, refuses; the wait below tells.
            let _ = self.client.command_drone(id, &DroneCommand::Land {}).await;
        }
        let by = Instant::now() + LANDED_BY;
        while Instant::now() < by {
            let drones = self.client.drones().await.map_err(failed)?;
            if drones.iter().all(|drone| drone.state.as_ref().is_none_or(|state| !state.armed)) {
                break;
            }
            tokio::time::sleep(POLL).await;
        }
        Ok(())
    }

    /// Switches the drones off.
    pub(super) async fn stop(self) -> Result<(), PipelineError> {
        let broken = |e: &dyn std::fmt::Display| PipelineError::plain("simulation", e.to_string());
        // It may have ended.
        let _ = self.stop.send(());
        self.running.await.map_err(|e| broken(&e))?.map_err(|e| broken(&e))?;
        Ok(())
    }
}

/// Makes the drones known, and where their cameras sit; an admin's task.
pub(super) async fn register(admin: &Client, num_drones: u8) -> Result<(), PipelineError> {
    for id in 1..=num_drones {
        let drone = PutDrone {
            name: format!("demo {id}"),
            signing_key: None,
            vision: VisionMessage::default(),
            body_from_camera: wire_mount(&Mount::default()),
        };
        admin.put_drone(id, &drone).await.map_err(failed)?;
    }
    Ok(())
}

/// Places on an ellipse around the middle of the scan, noses inward.
fn drones(hall: &DemoHall, num_drones: u8, seed: u64) -> Vec<DroneOptions> {
    let centers = hall.scan.iter().map(|shot| camera_center(&shot.cam_from_world).coords);
    let middle = centers.sum::<Vector3<f64>>().xy() / hall.scan.len() as f64;
    (0..num_drones)
        .map(|index| {
            let (sin, cos) = (TAU * f64::from(index) / f64::from(num_drones)).sin_cos();
            let out = Vector2::new(AROUND[0] * cos, AROUND[1] * sin);
            let place = middle + out;
            let start = Point3::new(place.x, place.y, 0.0);
            DroneOptions {
                yaw: (-out.y).atan2(-out.x),
                // A spectator may watch for hours.
                endurance: Duration::from_secs(24 * 3600),
                seed: seed.wrapping_add(u64::from(index)),
                ..DroneOptions::new(index + 1, Flavor::ArduPilot, start)
            }
        })
        .collect()
}

fn wire_mount(mount: &Mount) -> CameraMount {
    let CameraPose { position, orientation } = wire::camera_pose(&mount.cam_from_body().inverse());
    CameraMount { position, orientation }
}

/// Where a drone stands that can be flown.
fn ready_at(drone: &Drone) -> Option<(u8, Point3<f64>)> {
    let state = drone.state.as_ref().filter(|state| state.feed == "ready")?;
    Some((drone.id, Point3::from(state.estimate?.position)))
}

fn not_ready(heard: &[Drone]) -> PipelineError {
    let of = |drone: &Drone| {
        let feed = drone.state.as_ref().map_or("not heard", |state| state.feed.as_str());
        format!("drone {}: {feed}", drone.id)
    };
    let states: Vec<_> = heard.iter().map(of).collect();
    PipelineError::new(
        "drones_not_ready",
        format!(
            "the drones did not find their places within {} s ({})",
            READY_BY.as_secs(),
            states.join(", ")
        ),
        "their cameras need two processors that are not busy with something else",
    )
}
