//! A drone flies to a goal in a map of photos, and a picture from there says how well (P62, P89).

use std::{
    net::SocketAddr,
    sync::{Arc, Mutex},
    time::{Duration, Instant},
};

use image::ImageEncoder;
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use tokio::{
    sync::{mpsc, oneshot},
    task::JoinHandle,
};
use uuid::Uuid;
use volery_api::{
    CreateJob, CreateTarget, DroneCommand, DronePose, FenceBlock, FlightStyle, FrameParams,
    Geofence, LocalizeStatus, PositionPrior, Prior, PutDrone, StageGroup,
};
use volery_client::Client;
use volery_server::{Config, MavlinkSettings};
use volery_simulator::{
    DroneOptions, Flavor, Mount, Space,
    shell::{Line, Simulation, State, simulate},
};
use volery_synthetic::{DemoHall, Shot};

use crate::{
    server::{Photos, mapped, upload},
    support::{Folder, hall_photos},
};

const DRONE: u8 = 1;
/// For anything to come true.
const PATIENCE: Duration = Duration::from_secs(60);

/// Where the drone was seen last, and when; it is told to the service again and again.
struct Flown {
    seen: Arc<Mutex<Option<State>>>,
    stop: oneshot::Sender<()>,
    feed: JoinHandle<()>,
}

impl Flown {
    fn switch_on(client: &Client, mavlink: SocketAddr, start: Point3<f64>) -> Self {
        let simulation = Simulation {
            server: mavlink,
            bind: mavlink.ip(),
            drones: vec![DroneOptions::new(DRONE, Flavor::ArduPilot, start)],
            space: Space::Open,
            separation: 1.0,
            faults: Vec::new(),
            feed: None,
            report_interval: Duration::from_millis(50),
        };
        let seen = Arc::new(Mutex::new(None));
        let (stop, stopped) = oneshot::channel::<()>();
        let (tell, mut told) = mpsc::unbounded_channel::<(Instant, State)>();
        tokio::spawn({
            let seen = Arc::clone(&seen);
            async move {
                let each = |line: &Line| {
                    if let Line::State(state) = line {
                        *seen.lock().unwrap() = Some((**state).clone());
                        // The one who listens ends first.
                        let _ = tell.send((Instant::now(), (**state).clone()));
                    }
                };
                simulate(simulation, async { drop(stopped.await) }, each).await.unwrap()
            }
        });
        let client = client.clone();
        let feed = tokio::spawn(async move {
            while let Some(mut newest) = told.recv().await {
                while let Ok(next) = told.try_recv() {
                    newest = next;
                }
                let (at, state) = newest;
                let (sin, cos) = (state.yaw / 2.0).sin_cos();
                let pose = DronePose {
                    position: state.position,
                    orientation: [cos, 0.0, 0.0, sin],
                    age_ms: at.elapsed().as_secs_f64() * 1e3,
                    position_sd: 0.02,
                    angle_sd: 0.02,
                    reset_counter: 0,
                };
                // It may not be heard yet.
                let _ = client.drone_pose(DRONE, &pose).await;
            }
        });
        Self { seen, stop, feed }
    }

    fn switch_off(self) {
        self.feed.abort();
        // It may have ended by itself.
        let _ = self.stop.send(());
    }

    /// Its true pose.
    fn world_from_body(&self) -> Isometry3<f64> {
        let seen = self.seen.lock().unwrap();
        let State { position, yaw, .. } = seen.as_ref().unwrap();
        let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), *yaw);
        Isometry3::from_parts((*position).into(), rotation)
    }
}

pub(crate) async fn until<T, F: Future<Output = T>>(
    ask: impl Fn() -> F,
    wanted: impl Fn(&T) -> bool,
) -> T {
    let deadline = Instant::now() + PATIENCE;
    loop {
        let answer = ask().await;
        if wanted(&answer) {
            return answer;
        }
        assert!(Instant::now() < deadline, "it does not come true");
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
}

/// A map of the scan in the frame of the hall.
pub(crate) async fn map_of(client: &Client, hall: &DemoHall, folder: &Folder) -> Uuid {
    let photos = Photos::in_folder(&folder.join("scan"), Some(*hall.camera()));
    let set = upload(client, &photos).await;
    let priors = hall.scan.iter().map(|shot| {
        let position = shot.cam_from_world.inverse().translation.vector.into();
        let position = Some(PositionPrior { position, sigma: 0.02 });
        (shot.name.clone(), Prior { position, ..Prior::default() })
    });
    client.put_priors(set, priors.collect()).await.unwrap();
    let stages = vec![StageGroup::Sfm];
    let request = CreateJob { imageset_ids: vec![set], stages, ..CreateJob::default() };
    let job = client.create_job(&request).await.unwrap();
    mapped(client, job.id).await.outputs.unwrap().map_id
}

/// What the drone's camera, in its middle and level, sees of the hall.
fn picture(hall: &DemoHall, world_from_body: &Isometry3<f64>) -> Vec<u8> {
    let mount = Mount { place: Vector3::zeros(), down: 0.0 };
    let cam_from_world = mount.cam_from_body() * world_from_body.inverse();
    let photo = hall.photo(&Shot { cam_from_world, ..hall.queries[0].clone() });
    let pixels: Vec<u8> = photo.rgb.iter().flatten().copied().collect();
    let mut bytes = Vec::new();
    image::codecs::png::PngEncoder::new(&mut bytes)
        .write_image(&pixels, photo.width, photo.height, image::ExtendedColorType::Rgb8)
        .unwrap();
    bytes
}

/// The pose by the picture is that of the drone to centimeters, the way left to the goal follows
/// from it, and the picture joins the map, in which it is a photo more.
#[test]
fn a_picture_at_the_goal_says_where_the_drone_is_and_joins_the_map() {
    if std::env::var_os("VOLERY_LONG").is_none() {
        eprintln!("SKIPPED: VOLERY_LONG is not set");
        return;
    }
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let folder = Folder::new("goal-frame");
    let hall = hall_photos(&folder.0);
    runtime.block_on(async {
        let mut config = Config::new(folder.join("data"), env!("CARGO_BIN_EXE_volery"));
        config.listen.set_port(0);
        config.mavlink = Some(MavlinkSettings {
            accept_unsigned: true,
            // The machine may be busy.
            max_pose_age: Duration::from_secs(1),
            ..MavlinkSettings::new(SocketAddr::from(([127, 0, 0, 1], 0)))
        });
        let running = volery_server::start(config).await.unwrap();
        let url = format!("http://{}", running.addr);
        let client = &Client::new(&url, running.admin_token.as_deref()).unwrap();
        let map_id = map_of(client, &hall, &folder).await;
        let num_photos = client.map_cameras(map_id).await.unwrap().images.len();
        let fence = Geofence {
            map_id,
            area: FenceBlock {
                outline: vec![[-50.0, -50.0], [50.0, -50.0], [50.0, 50.0], [-50.0, 50.0]],
                floor: -1.0,
                ceiling: 10.0,
            },
            keep_out: Vec::new(),
            margin_m: 0.1,
        };
        client.put_geofence(&fence).await.unwrap();
        let drone = PutDrone {
            name: "Wren".to_owned(),
            signing_key: None,
            vision: Default::default(),
            body_from_camera: Default::default(),
        };
        client.put_drone(DRONE, &drone).await.unwrap();

        // From a meter beside to where a photo was taken that is not in the map.
        let world_from_cam = hall.queries[0].cam_from_world.inverse();
        let ahead = world_from_cam * Vector3::z();
        let goal = Point3::from(world_from_cam.translation.vector);
        let beside = goal - ahead.xy().normalize().push(0.0);
        let start = Point3::new(beside.x, beside.y, 0.0);
        let flown = Flown::switch_on(client, running.mavlink_addr().unwrap(), start);
        let state = || async { client.drone_state(DRONE).await.ok() };
        until(state, |state| state.as_ref().is_some_and(|state| state.feed == "ready")).await;
        let up = DroneCommand::Takeoff { height: goal.z };
        let command = client.command_drone(DRONE, &up).await.unwrap().id;
        let status = || async { client.drone_command(DRONE, command).await.unwrap().state };
        until(status, |state| state == "done").await;
        let target = CreateTarget {
            map_id,
            position: goal.into(),
            yaw: Some(ahead.y.atan2(ahead.x)),
            style: FlightStyle::Straight,
            views: false,
            speed: None,
            separation_m: None,
            allow_unseen: true,
            dry_run: false,
        };
        let flight = client.fly_to(DRONE, &target).await.unwrap().flight_id.unwrap();
        let flight = || async { client.flight(flight).await.unwrap().state };
        until(flight, |state| state == "finished").await;

        let truth = flown.world_from_body();
        let picture = picture(&hall, &truth);
        let params = FrameParams { map_id, age_ms: Some(1.0), extend: true };
        let answer = client.drone_frame(DRONE, &params, picture.clone()).await.unwrap();
        let found = &answer.answer.localization;
        assert_eq!(found.status, LocalizeStatus::Ok, "{found:?}");
        assert!(found.num_inliers <= found.num_correspondences, "{found:?}");
        let place = answer.place.unwrap();
        let error = (Vector3::from(place.position) - truth.translation.vector).norm();
        let way_left = (goal.coords - truth.translation.vector).norm();
        let told = place.goal_distance_m.unwrap();
        println!("{error:.3} m off, {told:.3} m from the goal, truly {way_left:.3} m");
        assert!(error < 0.05 && (told - way_left).abs() < 0.05, "{place:?}");
        assert!(way_left < 0.3 && place.correction_m.unwrap() < 0.3, "{place:?}");
        assert_eq!(client.newest_frame(DRONE).await.unwrap(), picture);

        let job = mapped(client, answer.job_id.unwrap()).await;
        assert_eq!(job.outputs.unwrap().map_id, map_id);
        assert_eq!(client.map_cameras(map_id).await.unwrap().images.len(), num_photos + 1);
        flown.switch_off();
        running.stop().await;
    });
}
