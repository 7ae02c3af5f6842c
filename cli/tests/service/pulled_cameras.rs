//! Drones fly on nothing but what the service sees through cameras that it pulls.

use std::{
    collections::BTreeMap,
    net::SocketAddr,
    sync::{Arc, Mutex},
    time::Duration,
};

use nalgebra::{Point3, Vector3};
use tokio::sync::oneshot;
use volery_api::{
    CameraMount, DroneCameraState, DroneCommand, DroneTarget, PutDrone, PutDroneCamera,
};
use volery_client::Client;
use volery_geometry::{Camera, CameraModel, triangulation::camera_center};
use volery_pipeline::wire;
use volery_server::{Config, MavlinkSettings};
use volery_simulator::{
    DroneOptions, Eye, Flavor, Mount, Scenery, Space,
    shell::{Feed, FrameSink, Line, Simulation, State, simulate},
};
use volery_synthetic::DemoHall;

use crate::{
    goal_frame::{map_of, until},
    server::api_camera,
    support::{Folder, take_photos},
};

/// Over the floor, meters.
const HEIGHT: f64 = 1.3;
/// The tolerance of a target, the estimator's noise, and the error of the map.
const AT_GOAL: f64 = 0.3;

/// What the simulation tells of the drones.
#[derive(Default, Clone)]
struct Seen {
    truth: Arc<Mutex<BTreeMap<u8, State>>>,
    urls: Arc<Mutex<BTreeMap<u8, String>>>,
}

impl Seen {
    fn add(&self, line: &Line) {
        match line {
            Line::State(state) => {
                self.truth.lock().unwrap().insert(state.system_id, (**state).clone());
            }
            Line::Camera { system_id, camera_url } => {
                self.urls.lock().unwrap().insert(*system_id, camera_url.clone());
            }
            _ => {}
        }
    }

    fn truth(&self, id: u8) -> State {
        self.truth.lock().unwrap()[&id].clone()
    }

    fn distance(&self, id: u8, goal: Point3<f64>) -> f64 {
        (Point3::from(self.truth(id).position) - goal).norm()
    }
}

async fn done(client: &Client, id: u8, command: &DroneCommand) {
    let command = client.command_drone(id, command).await.unwrap().id;
    let status = || async { client.drone_command(id, command).await.unwrap() };
    let status =
        until(status, |status| !["accepted", "sent", "executing"].contains(&&*status.state));
    let status = status.await;
    assert_eq!(status.state, "done", "{status:?}");
}

/// Two drones find their places in the map of a hall, take off and fly to their goals, where they
/// truly are then. The one whose camera is no longer pulled lands by itself; the other one stays.
#[test]
fn drones_fly_by_pulled_cameras_alone() {
    if std::env::var_os("VOLERY_LONG").is_none() {
        eprintln!("SKIPPED: VOLERY_LONG is not set");
        return;
    }
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let folder = Folder::new("pulled-cameras");
    let hall = DemoHall::new(1);
    take_photos(&hall, &folder.0);
    runtime.block_on(async {
        let mut config = Config::new(folder.join("data"), env!("CARGO_BIN_EXE_volery"));
        config.listen.set_port(0);
        config.camera_hosts = vec!["127.0.0.1".parse().unwrap()];
        config.mavlink = Some(MavlinkSettings {
            accept_unsigned: true,
            // The machine may be busy, with drawing the pictures too.
            max_pose_age: Duration::from_millis(250),
            ..MavlinkSettings::new(SocketAddr::from(([127, 0, 0, 1], 0)))
        });
        let running = volery_server::start(config).await.unwrap();
        let client = &Client::new(&running.url(), running.admin_token.as_deref()).unwrap();
        let map_id = map_of(client, &hall, &folder).await;

        // On both sides of the middle of the scan, noses inward, each with a lane of its own.
        let centers = hall.scan.iter().map(|shot| camera_center(&shot.cam_from_world).coords);
        let middle = centers.sum::<Vector3<f64>>() / hall.scan.len() as f64;
        let place = |x: f64, y: f64, z: f64| Point3::new(middle.x + x, middle.y + y, z);
        let flown = [
            (1, place(-1.5, -0.8, 0.0), 0.0, place(-0.5, -0.8, HEIGHT)),
            (2, place(1.5, 0.8, 0.0), std::f64::consts::PI, place(0.5, 0.8, HEIGHT)),
        ];
        let mount = wire::camera_pose(&Mount::default().cam_from_body().inverse());
        for (id, ..) in flown {
            let drone = PutDrone {
                name: format!("drone {id}"),
                signing_key: None,
                vision: Default::default(),
                body_from_camera: CameraMount {
                    position: mount.position,
                    orientation: mount.orientation,
                },
            };
            client.put_drone(id, &drone).await.unwrap();
        }
        let camera = Camera::from_focal(CameraModel::Pinhole, 320, 240, 228.5).unwrap();
        let scenery = Scenery::Hall(Box::new(hall.hall.clone()));
        let mavlink = running.mavlink_addr().unwrap();
        let options = |(id, start, yaw, _)| DroneOptions {
            yaw,
            ..DroneOptions::new(id, Flavor::ArduPilot, start)
        };
        let simulation = Simulation {
            server: mavlink,
            bind: mavlink.ip(),
            drones: flown.map(options).to_vec(),
            space: Space::Room(hall.hall.room.clone()),
            separation: 1.0,
            faults: Vec::new(),
            feed: Some(Feed {
                eye: Eye::new(scenery, &camera, Mount::default()),
                interval: Duration::from_millis(100),
                sink: FrameSink::Mjpeg(SocketAddr::from(([127, 0, 0, 1], 0))),
            }),
            report_interval: Duration::from_millis(50),
        };
        let seen = Seen::default();
        let (stop, stopped) = oneshot::channel::<()>();
        let simulated = tokio::spawn({
            let seen = seen.clone();
            async move {
                simulate(simulation, async { drop(stopped.await) }, |line| seen.add(line)).await
            }
        });
        until(|| async { seen.urls.lock().unwrap().len() }, |number| *number == 2).await;
        for (id, ..) in flown {
            let url = seen.urls.lock().unwrap()[&id].clone();
            let camera = Some(api_camera(&camera));
            let pulled = PutDroneCamera { url, map_id, version: None, camera, feed: true };
            client.put_drone_camera(id, &pulled).await.unwrap();
        }
        for (id, ..) in flown {
            let state = || async { client.drone_state(id).await.ok() };
            until(state, |state| state.as_ref().is_some_and(|s| s.feed == "ready")).await;
        }
        for (id, ..) in flown {
            done(client, id, &DroneCommand::Takeoff { height: HEIGHT }).await;
        }
        for (id, _, _, goal) in flown {
            let target = DroneTarget {
                position: goal.into(),
                yaw: None,
                tolerance_m: None,
                timeout_s: None,
            };
            done(client, id, &DroneCommand::Goto(target)).await;
            let camera = client.drone_camera(id).await.unwrap();
            let distance = seen.distance(id, goal);
            println!(
                "drone {id}: {distance:.3} m from its goal; {} pictures, {} dropped, {:.1} a second",
                camera.frames, camera.dropped, camera.rate_hz
            );
            assert_eq!(camera.state, DroneCameraState::Streaming);
            assert!(distance < AT_GOAL, "{camera:?}");
        }
        let [(stays, _, _, goal), (lands, ..)] = flown;
        client.delete_drone_camera(lands).await.unwrap();
        until(|| async { seen.truth(lands) }, |state| !state.armed).await;
        assert!(seen.truth(stays).flying && seen.distance(stays, goal) < AT_GOAL);
        done(client, stays, &DroneCommand::Land {}).await;
        stop.send(()).unwrap();
        let summary = simulated.await.unwrap().unwrap();
        assert_eq!(summary.contacts, 0, "{summary:?}");
        running.stop().await;
    });
}
