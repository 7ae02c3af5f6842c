//! Simulated drones that fly over a service, which is told where they truly are.

use std::{
    collections::BTreeMap,
    net::SocketAddr,
    sync::{Arc, Mutex},
    time::{Duration, Instant},
};

use serde_json::{Value, json};
use tokio::{
    sync::{mpsc, oneshot},
    task::JoinHandle,
};
use volery_server::{Config, MavlinkSettings};
use volery_simulator::{
    DroneOptions, Space,
    shell::{Line, Simulation, State, Summary, simulate},
};

use super::{Client, Server};

/// For anything to come true.
const PATIENCE: Duration = Duration::from_secs(60);

/// A link to drones that need not sign, on a machine that may be busy.
pub(crate) fn hear_drones(config: &mut Config) {
    let mut mavlink = MavlinkSettings::new(SocketAddr::from(([127, 0, 0, 1], 0)));
    mavlink.accept_unsigned = true;
    mavlink.max_pose_age = Duration::from_secs(1);
    config.mavlink = Some(mavlink);
}

/// A service with such a link.
pub(crate) async fn server() -> Server {
    Server::start_with(hear_drones).await
}

/// Whether a drone, as the service shows it, takes itself to be within 5 cm of a place.
pub(crate) fn believes_to_be_at(drone: &Value, place: [f64; 3]) -> bool {
    let estimate = &drone["state"]["estimate"]["position"];
    (0..3).all(|axis| estimate[axis].as_f64().is_some_and(|at| (at - place[axis]).abs() < 0.05))
}

/// Drones in an open space.
pub(crate) struct Field {
    client: Client,
    truth: Arc<Mutex<BTreeMap<u8, State>>>,
    stop: oneshot::Sender<()>,
    run: JoinHandle<Summary>,
    /// None where the drones are told their places otherwise.
    feed: Option<JoinHandle<()>>,
}

impl Field {
    /// Switches the drones on. Each is told where it is.
    pub(crate) fn open(server: &Server, drones: Vec<DroneOptions>) -> Self {
        let (mut field, told) = Self::start(server, drones);
        field.feed = Some(tokio::spawn(feed(field.client.clone(), told)));
        field
    }

    /// Switches the drones on. They are told nothing.
    pub(crate) fn open_untold(server: &Server, drones: Vec<DroneOptions>) -> Self {
        Self::start(server, drones).0
    }

    fn start(
        server: &Server,
        drones: Vec<DroneOptions>,
    ) -> (Self, mpsc::UnboundedReceiver<(Instant, State)>) {
        let simulation = Simulation {
            server: server.running.mavlink_addr().unwrap(),
            bind: [127, 0, 0, 1].into(),
            drones,
            space: Space::Open,
            separation: 0.5,
            faults: Vec::new(),
            feed: None,
            report_interval: Duration::from_millis(50),
        };
        let (stop, stopped) = oneshot::channel::<()>();
        let truth = Arc::new(Mutex::new(BTreeMap::new()));
        let (tell, told) = mpsc::unbounded_channel();
        let run = tokio::spawn({
            let truth = Arc::clone(&truth);
            async move {
                let stopped = async { drop(stopped.await) };
                let each = |line: &Line| {
                    if let Line::State(state) = line {
                        truth.lock().unwrap().insert(state.system_id, (**state).clone());
                        // Whoever listens ends first.
                        let _ = tell.send((Instant::now(), (**state).clone()));
                    }
                };
                simulate(simulation, stopped, each).await.unwrap()
            }
        });
        (Self { client: server.client.clone(), truth, stop, run, feed: None }, told)
    }

    /// How a drone truly is.
    pub(crate) fn truth(&self, id: u8) -> State {
        self.truth.lock().unwrap()[&id].clone()
    }

    /// Asks until the answer is as wanted.
    pub(crate) async fn until(&self, path: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        let start = Instant::now();
        loop {
            let answer = self.client.get(path).await;
            if answer.status == 200 && wanted(&answer.json()) {
                return answer.json();
            }
            assert!(
                start.elapsed() < PATIENCE,
                "{path}: {}",
                String::from_utf8_lossy(&answer.body)
            );
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    }

    /// Everybody up to `height` above the ground.
    pub(crate) async fn take_off(&self, ids: &[u8], height: f64) {
        for id in ids {
            let path = format!("/v1/drones/{id}");
            self.until(&path, |drone| drone["state"]["feed"] == "ready").await;
            let command = json!({"type": "takeoff", "height": height});
            let path = format!("{path}/commands");
            let made = self.client.post(&path, command).await.expect(202);
            self.until(made.header("location").unwrap(), |command| command["state"] == "done")
                .await;
        }
    }

    /// Switches the drones off.
    pub(crate) async fn close(self) -> Summary {
        if let Some(feed) = self.feed {
            feed.abort();
        }
        // It may have ended by itself.
        let _ = self.stop.send(());
        self.run.await.unwrap()
    }
}

/// Tells the service where each drone was when it was seen last.
async fn feed(client: Client, mut seen: mpsc::UnboundedReceiver<(Instant, State)>) {
    while let Some(first) = seen.recv().await {
        let mut newest = BTreeMap::from([(first.1.system_id, first)]);
        while let Ok(next) = seen.try_recv() {
            newest.insert(next.1.system_id, next);
        }
        for (at, state) in newest.into_values() {
            let (sin, cos) = (state.yaw / 2.0).sin_cos();
            let pose = json!({
                "position": state.position,
                "orientation": [cos, 0.0, 0.0, sin],
                "age_ms": at.elapsed().as_secs_f64() * 1e3,
                "position_sd": 0.02,
                "angle_sd": 0.02,
            });
            client.post(&format!("/v1/drones/{}/pose", state.system_id), pose).await;
        }
    }
}
