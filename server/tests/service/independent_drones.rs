//! Drones that others wrote fly over this service: a simulator on pymavlink that flies on nothing
//! but the poses it is sent. Its true positions are the measure.
//!
//! It needs `../shared/tools/drone_sim` and a Python with pymavlink; `./run test` installs the
//! latter. `VOLERY_LONG=1` flies every combination.

use std::{
    collections::BTreeMap,
    io::{BufRead, BufReader},
    net::SocketAddr,
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    sync::{Arc, Mutex},
    time::{Duration, Instant},
};

use crate::support::{self, Client, Server};
use serde_json::{Value, json};
use volery_geometry::Rng;
use volery_server::MavlinkSettings;

const COUNT: u8 = 3;
const KEY: &str = "8899aabbccddeeff00112233445566778899aabbccddeeff0011223344556677";
/// Noise of the poses, meters and radians.
const NOISE: (f64, f64) = (0.02, 0.005);

/// The simulator and a Python that can run it, or `None`, said aloud.
fn simulator() -> Option<(PathBuf, PathBuf)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent()?;
    let script = root.parent()?.join("shared/tools/drone_sim/drone_sim.py");
    if !script.is_file() {
        eprintln!("SKIPPED: ../shared/tools/drone_sim is absent");
        return None;
    }
    Some((support::python()?, script))
}

#[derive(Debug, Clone, Copy)]
struct Trial {
    flavor: &'static str,
    signed: bool,
    bad_link: bool,
}

impl Trial {
    /// Largest true distance from a target, meters.
    fn limit(&self) -> f64 {
        if self.bad_link { 0.30 } else { 0.15 }
    }
}

/// The process of the simulator; it ends with the test.
struct Simulated(Child);

impl Drop for Simulated {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// What the simulator says: the true state of every drone, and what went wrong.
#[derive(Debug, Default)]
struct Truth {
    /// In the map, by system id.
    positions: BTreeMap<u8, [f64; 3]>,
    mishaps: Vec<Value>,
    /// Longest time without a word of the simulator, which says something every 50 ms.
    longest_silence: Duration,
}

/// A true state, local with z down, as a pose in the map with noise.
fn pose_with_noise(state: &Value, rng: &mut Rng) -> Value {
    let numbers = |key: &str| -> Vec<f64> {
        state[key].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
    };
    let (pos, rpy) = (numbers("pos"), numbers("rpy"));
    let (roll, pitch) = (rpy[0], rpy[1]);
    let yaw = rpy[2] + rng.normal() * NOISE.1;
    let [(sr, cr), (sp, cp), (sy, cy)] = [roll, pitch, yaw].map(|angle| (angle / 2.0).sin_cos());
    let w = cr * cp * cy + sr * sp * sy;
    let x = sr * cp * cy - cr * sp * sy;
    let y = cr * sp * cy + sr * cp * sy;
    let z = cr * cp * sy - sr * sp * cy;
    let noise = rng.normal3() * NOISE.0;
    json!({
        "position": [pos[0] + noise.x, -pos[1] + noise.y, -pos[2] + noise.z],
        "orientation": [w, x, -y, -z],
        "position_sd": NOISE.0,
        "angle_sd": 0.01,
    })
}

/// Reads what the simulator says, and tells the service where its drones are: the newest state of
/// each, with its true age.
async fn localize(
    mut lines: tokio::sync::mpsc::UnboundedReceiver<(Instant, Value)>,
    client: Client,
    truth: Arc<Mutex<Truth>>,
) {
    let mut rng = Rng::new(7);
    let mut heard: Option<Instant> = None;
    while let Some(first) = lines.recv().await {
        let silence = heard.map_or(Duration::ZERO, |heard| heard.elapsed());
        heard = Some(Instant::now());
        {
            let mut truth = truth.lock().unwrap();
            truth.longest_silence = truth.longest_silence.max(silence);
        }
        let mut newest = BTreeMap::new();
        let mut next = Some(first);
        while let Some((read, line)) = next {
            let event = line["event"].as_str();
            match (event, line["sysid"].as_u64()) {
                (Some("crash" | "too close"), _) => truth.lock().unwrap().mishaps.push(line),
                (None, Some(id)) => drop(newest.insert(id as u8, (read, line))),
                _ => {}
            }
            next = lines.try_recv().ok();
        }
        let sent: Vec<_> = newest
            .into_iter()
            .map(|(id, (read, line))| {
                let mut pose = pose_with_noise(&line, &mut rng);
                pose["age_ms"] = json!(read.elapsed().as_secs_f64() * 1e3);
                let position = |i: usize| line["pos"][i].as_f64().unwrap();
                let place = [position(0), -position(1), -position(2)];
                truth.lock().unwrap().positions.insert(id, place);
                let client = client.clone();
                tokio::spawn(async move {
                    client.post(&format!("/v1/drones/{id}/pose"), pose).await.expect(200);
                })
            })
            .collect();
        for request in sent {
            request.await.unwrap();
        }
    }
}

async fn wait_for_feed(client: &Client, what: &str) {
    let start = Instant::now();
    loop {
        let drones = client.get("/v1/drones").await.expect(200).json();
        let states = drones["items"].as_array().unwrap();
        if states.len() == usize::from(COUNT)
            && states.iter().all(|drone| drone["state"]["feed"] == "ready")
        {
            return;
        }
        assert!(start.elapsed() < Duration::from_secs(60), "{what}: never ready {drones:#}");
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
}

/// Gives a command to every drone and waits until all are done.
async fn command_all(
    client: &Client,
    command: impl Fn(u8) -> Value,
    what: &str,
) -> Result<(), String> {
    let mut paths = Vec::new();
    for id in 1..=COUNT {
        let path = format!("/v1/drones/{id}/commands");
        let answer = client.post(&path, command(id)).await;
        if answer.status != 202 {
            return Err(format!("{what}: {answer:?}"));
        }
        paths.push(format!("{path}/{}", answer.json()["id"]));
    }
    let start = Instant::now();
    for path in paths {
        loop {
            let status = client.get(&path).await.expect(200).json();
            match status["state"].as_str().unwrap() {
                "done" => break,
                "accepted" | "sent" | "executing" => {}
                _ => {
                    let events = format!("/v1/drones/{}/events", status["drone"]);
                    let events = client.get(&events).await.expect(200).json();
                    let last = events["items"].as_array().unwrap().iter().rev().take(12);
                    return Err(format!("{what}: {status:#} {:#?}", last.collect::<Vec<_>>()));
                }
            }
            assert!(start.elapsed() < Duration::from_secs(90), "{what}: {status:#}");
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    }
    Ok(())
}

/// A machine that is busy with other things stands still now and then, and drones in real time fly
/// on without poses meanwhile: such a flight says nothing of the service.
const STANDSTILL: Duration = Duration::from_millis(150);
const MAX_ATTEMPTS: usize = 3;

/// Flies until a flight is good, or fails on a machine that kept pace.
async fn fly(trial: Trial, python: &Path, script: &Path) {
    for attempt in 1.. {
        let (worst, silence) = fly_once(trial, python, script).await;
        println!("{trial:?}: worst true error at a target {worst:?} m, longest pause {silence:?}");
        if worst.as_ref().is_ok_and(|worst| *worst <= trial.limit()) {
            return;
        }
        assert!(silence > STANDSTILL && attempt < MAX_ATTEMPTS, "{trial:?}: {worst:?}");
        println!("{trial:?}: the machine stood still; flown again");
    }
}

/// Discovered, fed, taken off, five targets each, landed; the worst true error at a target, and
/// the longest pause of the simulator.
async fn fly_once(trial: Trial, python: &Path, script: &Path) -> (Result<f64, String>, Duration) {
    let what = format!("{trial:?}");
    let server = Server::start_with(|config| {
        let listen = SocketAddr::from(([127, 0, 0, 1], 0));
        config.mavlink = Some(MavlinkSettings {
            key: trial.signed.then(|| MavlinkSettings::parse_key(KEY).unwrap()),
            accept_unsigned: !trial.signed,
            ..MavlinkSettings::new(listen)
        });
    })
    .await;
    let client = &server.client;
    let address = server.running.mavlink_addr().unwrap().to_string();
    let mut command = Command::new(python);
    // A quarter of a second without a pose lands these drones: at 20 poses a second, of which a fifth is
    // lost, that is every other flight.
    let rate = if trial.bad_link { "33" } else { "20" };
    command.arg(script).args(["--server", &address, "--count", "3", "--report-hz", rate]);
    command.args(["--flavor", trial.flavor, "--duration", "240"]);
    if trial.signed {
        command.args(["--signing-key", KEY]);
    }
    if trial.bad_link {
        command.args(["--loss", "0.2", "--delay", "0.15"]);
    }
    let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
    let stdout = BufReader::new(child.stdout.take().unwrap());
    let _simulated = Simulated(child);
    let (sender, lines) = tokio::sync::mpsc::unbounded_channel();
    std::thread::spawn(move || {
        for line in stdout.lines().map_while(Result::ok) {
            let line = serde_json::from_str(&line).unwrap();
            if sender.send((Instant::now(), line)).is_err() {
                return;
            }
        }
    });
    let truth = Arc::new(Mutex::new(Truth::default()));
    let feeding = tokio::spawn(localize(lines, client.clone(), Arc::clone(&truth)));

    let flown = async {
        wait_for_feed(client, &what).await;
        command_all(client, |_| json!({"type": "takeoff", "height": 1.5}), &what).await?;
        let mut worst = 0.0_f64;
        let places =
            [[1.0, 0.3, 1.5], [1.5, -0.4, 1.2], [0.8, -0.8, 1.8], [0.2, 0.2, 1.0], [0.0, 0.0, 1.4]];
        for (turn, [x, y, z]) in places.into_iter().enumerate() {
            // They stand one and a half meters apart, to the right.
            let place = |id: u8| [x, y - 1.5 * f64::from(id - 1), z];
            let yaw = 0.5 * turn as f64 - 1.0;
            let go = |id: u8| json!({"type": "goto", "position": place(id), "yaw": yaw});
            command_all(client, go, &what).await?;
            tokio::time::sleep(Duration::from_millis(1500)).await;
            let truth = truth.lock().unwrap();
            for (&id, position) in &truth.positions {
                let goal = place(id);
                let error = (0..3).map(|i| (position[i] - goal[i]).powi(2)).sum::<f64>().sqrt();
                worst = worst.max(error);
            }
        }
        command_all(client, |_| json!({"type": "land"}), &what).await?;
        Ok(worst)
    };
    let worst: Result<f64, String> = flown.await;
    feeding.abort();
    let truth = truth.lock().unwrap();
    assert!(truth.mishaps.is_empty(), "{what}: {:?}", truth.mishaps);
    let is_down = truth.positions.values().all(|position| position[2].abs() < 0.05);
    assert!(worst.is_err() || is_down, "{what}");
    (worst, truth.longest_silence)
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn drones_of_others_fly_to_their_targets() {
    let Some((python, script)) = simulator() else { return };
    let long = std::env::var_os("VOLERY_LONG").is_some();
    let mut trials = Vec::new();
    for flavor in ["ardupilot", "px4"] {
        for signed in [false, true] {
            for bad_link in [false, true] {
                // In short: a good link; a bad one is flown in simulated time as well, where no
                // busy machine comes between.
                let short = (flavor == "px4") == signed && !bad_link;
                if long || short {
                    trials.push(Trial { flavor, signed, bad_link });
                }
            }
        }
    }
    // Two at a time: every drone of these simulators takes a part of a core.
    for pair in trials.chunks(2) {
        let flights: Vec<_> = pair
            .iter()
            .map(|&trial| {
                let (python, script) = (python.clone(), script.clone());
                tokio::spawn(async move { fly(trial, &python, &script).await })
            })
            .collect();
        for flight in flights {
            flight.await.unwrap();
        }
    }
}
