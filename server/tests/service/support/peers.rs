//! Vehicles that others wrote, on the link of a service that is told where they truly are.

use std::{
    collections::BTreeMap,
    io::{BufRead, BufReader},
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    sync::{Arc, Mutex, MutexGuard},
    time::{Duration, Instant},
};

use serde_json::{Value, json};
use tokio::{sync::mpsc, task::JoinHandle};
use volery_geometry::Rng;

use super::Client;

/// Noise of the poses, meters and radians.
const NOISE: (f64, f64) = (0.02, 0.005);
/// Meters between them; they stand in a row to the right.
const SPACING: f64 = 1.5;

/// A machine that is busy with other things stands still now and then, and drones in real time fly
/// on without poses meanwhile: such a flight says nothing of the service.
const STANDSTILL: Duration = Duration::from_millis(150);
const MAX_ATTEMPTS: usize = 3;

/// The simulator on pymavlink, or `None`, said aloud.
pub(crate) fn drone_sim() -> Option<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent()?;
    let script = root.parent()?.join("shared/tools/drone_sim/drone_sim.py");
    if !script.is_file() {
        eprintln!("SKIPPED: ../shared/tools/drone_sim is absent");
        return None;
    }
    Some(script)
}

/// A process that says its vehicles' true states, one JSON line each; it ends with the test.
pub(crate) struct Peers {
    child: Child,
    truth: Arc<Mutex<Truth>>,
    feed: JoinHandle<()>,
}

/// What the process says.
#[derive(Debug, Default)]
pub(crate) struct Truth {
    /// In the map, by system id.
    pub(crate) positions: BTreeMap<u8, [f64; 3]>,
    /// What went wrong.
    pub(crate) mishaps: Vec<Value>,
    /// Longest time without a word, where one is due every 50 ms.
    pub(crate) longest_silence: Duration,
}

impl Peers {
    /// Starts the process and tells the service where its vehicles are.
    pub(crate) fn start(command: &mut Command, client: &Client) -> Self {
        let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
        let stdout = BufReader::new(child.stdout.take().unwrap());
        let (sender, lines) = mpsc::unbounded_channel();
        std::thread::spawn(move || {
            for line in stdout.lines().map_while(Result::ok) {
                // Libraries say things, too.
                let Ok(line) = serde_json::from_str(&line) else { continue };
                if sender.send((Instant::now(), line)).is_err() {
                    return;
                }
            }
        });
        let truth = Arc::new(Mutex::new(Truth::default()));
        let feed = tokio::spawn(localize(lines, client.clone(), Arc::clone(&truth)));
        Self { child, truth, feed }
    }

    pub(crate) fn truth(&self) -> MutexGuard<'_, Truth> {
        self.truth.lock().unwrap()
    }
}

impl Drop for Peers {
    fn drop(&mut self) {
        self.feed.abort();
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
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

/// Reads what the process says, and tells the service where its vehicles are: the newest state of
/// each, with its true age.
async fn localize(
    mut lines: mpsc::UnboundedReceiver<(Instant, Value)>,
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

async fn wait_for_feed(client: &Client, count: u8, what: &str) {
    let start = Instant::now();
    loop {
        let drones = client.get("/v1/drones").await.expect(200).json();
        let states = drones["items"].as_array().unwrap();
        if states.len() == usize::from(count)
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
    count: u8,
    command: impl Fn(u8) -> Value,
    what: &str,
) -> Result<(), String> {
    let mut paths = Vec::new();
    for id in 1..=count {
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
                    let last = events["items"].as_array().unwrap().iter().rev().take(20);
                    let told = last.map(|event| {
                        let [kind, value, detail] =
                            ["kind", "value", "detail"].map(|key| &event[key]);
                        format!("{} {kind} {value} {detail}", event["t_ns"])
                    });
                    return Err(format!("{what}: {status} {:#?}", told.collect::<Vec<_>>()));
                }
            }
            assert!(start.elapsed() < Duration::from_secs(90), "{what}: {status:#}");
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    }
    Ok(())
}

/// Flies until the worst true error at a target is within `limit`, meters, or fails on a machine that
/// kept pace. `fly` answers that error and the longest pause of the vehicles' process.
pub(crate) async fn until_undisturbed<F>(what: &str, limit: f64, fly: impl Fn() -> F)
where
    F: Future<Output = (Result<f64, String>, Duration)>,
{
    for attempt in 1.. {
        let (worst, silence) = fly().await;
        println!("{what}: worst true error at a target {worst:?} m, longest pause {silence:?}");
        if worst.as_ref().is_ok_and(|&worst| worst <= limit) {
            return;
        }
        assert!(silence > STANDSTILL && attempt < MAX_ATTEMPTS, "{what}: {worst:?}");
        println!("{what}: the machine stood still; flown again");
    }
}

/// Fed, taken off, to five targets each, landed. Returns the worst true distance at a target, meters.
///
/// # Errors
///
/// What was not done, with what the vehicle told last.
pub(crate) async fn tour(
    client: &Client,
    peers: &Peers,
    count: u8,
    what: &str,
) -> Result<f64, String> {
    wait_for_feed(client, count, what).await;
    command_all(client, count, |_| json!({"type": "takeoff", "height": 1.5}), what).await?;
    let mut worst = 0.0_f64;
    let places =
        [[1.0, 0.3, 1.5], [1.5, -0.4, 1.2], [0.8, -0.8, 1.8], [0.2, 0.2, 1.0], [0.0, 0.0, 1.4]];
    for (turn, [x, y, z]) in places.into_iter().enumerate() {
        let place = |id: u8| [x, y - SPACING * f64::from(id - 1), z];
        let yaw = 0.5 * turn as f64 - 1.0;
        let go = |id: u8| json!({"type": "goto", "position": place(id), "yaw": yaw});
        command_all(client, count, go, what).await?;
        tokio::time::sleep(Duration::from_millis(1500)).await;
        for (&id, position) in &peers.truth().positions {
            let goal = place(id);
            let error = (0..3).map(|i| (position[i] - goal[i]).powi(2)).sum::<f64>().sqrt();
            worst = worst.max(error);
        }
    }
    command_all(client, count, |_| json!({"type": "land"}), what).await?;
    let is_down = peers.truth().positions.values().all(|position| position[2].abs() < 0.05);
    assert!(is_down, "{what}");
    Ok(worst)
}
