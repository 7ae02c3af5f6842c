//! A drone with all that moves it: its autopilot on a socket, and a pilot over the API.

use std::io::Result;
use std::net::SocketAddr;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use mavlink::dialects::ardupilotmega::{COMMAND_LONG_DATA, MavCmd, MavMessage};
use tokio::net::UdpSocket;
use tokio::time::{MissedTickBehavior, interval};
use volery_geometry::Rng;
use volery_simulator::{Drone, DroneOptions, Flavor, Link, Signing, TICK};

use super::http::Connection;

/// Poses per second.
const POSE_RATE: f64 = 30.0;
/// Noise of poses, meters.
const NOISE: f64 = 0.01;
/// Distance of the drones from each other, meters, and where they hover.
const SPACING: f64 = 3.0;
const HEIGHT: f64 = 1.5;
/// Messages that come at 50 Hz each, 100 in all: ATTITUDE and LOCAL_POSITION_NED.
const FAST: [u32; 2] = [30, 32];
/// Ids of what is looked for on the wire: SET_POSITION_TARGET_LOCAL_NED; VISION_POSITION_ESTIMATE.
const SETPOINT: u32 = 84;
const POSE: u32 = 102;

/// What one drone has seen.
#[derive(Debug, Default)]
pub(crate) struct Seen {
    /// From a pose's request to the datagram for the autopilot.
    pub(crate) relays: Vec<Duration>,
    /// Times of setpoints.
    pub(crate) setpoints: Vec<Instant>,
    /// Poses that were answered with a refusal.
    pub(crate) num_refused: u64,
    asked_at: Option<Instant>,
}

/// Shared by the tasks of one drone and whoever reads the figures.
pub(crate) struct Body {
    drone: Mutex<Drone>,
    seen: Mutex<Seen>,
    num_sent: AtomicU64,
    start: Instant,
}

impl Body {
    /// Switches drone `id` on; its tasks end with the runtime.
    pub(crate) async fn start(
        id: u8,
        signing: Signing,
        mavlink: SocketAddr,
        start: Instant,
    ) -> Result<Arc<Self>> {
        let place = [f64::from(id % 8), f64::from(id / 8), 0.0].map(|k| SPACING * k);
        let flavor = if id.is_multiple_of(2) { Flavor::ArduPilot } else { Flavor::Px4 };
        let options = DroneOptions {
            signing: Some(signing),
            endurance: Duration::from_secs(24 * 3600),
            ..DroneOptions::new(id, flavor, place.into())
        };
        let drone = Mutex::new(Drone::new(options));
        let num_sent = AtomicU64::new(0);
        let body = Arc::new(Self { drone, seen: Mutex::default(), num_sent, start });
        let socket = UdpSocket::bind("127.0.0.1:0").await?;
        socket.connect(mavlink).await?;
        tokio::spawn(Arc::clone(&body).speak(socket));
        Ok(body)
    }

    pub(crate) fn id(&self) -> u8 {
        self.drone().options().system_id
    }

    /// Messages it has sent since the start.
    pub(crate) fn num_sent(&self) -> u64 {
        self.num_sent.load(Ordering::Relaxed)
    }

    /// What was seen since the last call.
    pub(crate) fn take(&self) -> Seen {
        std::mem::take(&mut self.seen())
    }

    fn seen(&self) -> MutexGuard<'_, Seen> {
        self.seen.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn drone(&self) -> MutexGuard<'_, Drone> {
        self.drone.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The autopilot on its socket.
    async fn speak(self: Arc<Self>, socket: UdpSocket) {
        let mut clock = interval(TICK);
        clock.set_missed_tick_behavior(MissedTickBehavior::Skip);
        let mut buffer = [0; 2048];
        loop {
            tokio::select! {
                biased;
                received = socket.recv(&mut buffer) => {
                    // Nobody listens yet, or no more.
                    let Ok(length) = received else { continue };
                    let now = Instant::now();
                    self.look(&buffer[..length], now);
                    self.drone().receive(&buffer[..length], now - self.start);
                }
                _ = clock.tick() => {
                    let datagrams = {
                        let mut drone = self.drone();
                        drone.step(self.start.elapsed());
                        drone.poll()
                    };
                    self.num_sent.fetch_add(datagrams.len() as u64, Ordering::Relaxed);
                    for datagram in datagrams {
                        // A full buffer loses it, as the air does.
                        let _ = socket.try_send(&datagram);
                    }
                }
            }
        }
    }

    /// Looks at the frames of a datagram.
    fn look(&self, mut datagram: &[u8], now: Instant) {
        let mut seen = self.seen();
        while let &[_, payload, flags, _, _, _, _, id0, id1, id2, ..] = datagram {
            match u32::from_le_bytes([id0, id1, id2, 0]) {
                SETPOINT => seen.setpoints.push(now),
                POSE => {
                    let asked = seen.asked_at.take();
                    seen.relays.extend(asked.map(|asked| now - asked));
                }
                _ => {}
            }
            let length = 12 + usize::from(payload) + if flags & 1 == 1 { 13 } else { 0 };
            datagram = datagram.get(length..).unwrap_or_default();
        }
    }

    /// Tells the server where the drone is.
    pub(crate) async fn feed(self: Arc<Self>, mut server: Connection) -> Result<()> {
        let mut clock = interval(Duration::from_secs_f64(1.0 / POSE_RATE));
        clock.set_missed_tick_behavior(MissedTickBehavior::Skip);
        let id = self.id();
        let mut rng = Rng::new(u64::from(id));
        let path = format!("/v1/drones/{id}/pose");
        loop {
            clock.tick().await;
            let pose = {
                let drone = self.drone();
                let p = drone.body().position + rng.normal3() * NOISE;
                let (sin, cos) = (drone.body().yaw / 2.0).sin_cos();
                format!(
                    "{{\"position\":[{},{},{}],\"orientation\":[{cos},0,0,{sin}],\"age_ms\":0,\
                     \"position_sd\":0.02,\"angle_sd\":0.02}}",
                    p.x, p.y, p.z
                )
            };
            self.seen().asked_at = Some(Instant::now());
            let (status, answer) = server.ask("POST", &path, &pose).await?;
            let is_sent = status == 200 && answer.starts_with(b"{\"sent\":true");
            self.seen().num_refused += u64::from(!is_sent);
        }
    }

    /// Takes off and stays in the air, at the end with the fast telemetry.
    pub(crate) async fn lift(&self, server: &mut Connection, signing: Signing) -> Result<()> {
        let id = self.id();
        let path = format!("/v1/drones/{id}");
        until(server, &path, "\"feed\":\"ready\"").await?;
        let place = self.drone().options().start;
        let takeoff = format!("{{\"type\":\"takeoff\",\"height\":{HEIGHT}}}");
        let goto = format!("{{\"type\":\"goto\",\"position\":[{},{},{HEIGHT}]}}", place.x, place.y);
        for command in [takeoff, goto] {
            let commands = format!("{path}/commands");
            let (status, answer) = server.ask("POST", &commands, &command).await?;
            let answer = String::from_utf8_lossy(&answer).into_owned();
            let number = answer.split("\"id\":").nth(1).and_then(|rest| rest.split(',').next());
            let Some(number) = number.filter(|_| status == 202) else {
                return Err(std::io::Error::other(answer));
            };
            until(server, &format!("{commands}/{number}"), "\"state\":\"done\"").await?;
        }
        let mut tuner = Link::new(255, 191, Some(signing));
        for id in FAST {
            let request = MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
                command: MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
                param1: id as f32,
                param2: TICK.as_micros() as f32,
                ..COMMAND_LONG_DATA::DEFAULT
            });
            let now = self.start.elapsed();
            self.drone().receive(&tuner.encode(&request, now), now);
        }
        Ok(())
    }
}

/// Asks until the answer contains `wanted`.
async fn until(server: &mut Connection, path: &str, wanted: &str) -> Result<()> {
    /// Longest wait.
    const PATIENCE: Duration = Duration::from_secs(60);
    let start = Instant::now();
    loop {
        let (_, answer) = server.ask("GET", path, "").await?;
        let answer = String::from_utf8_lossy(&answer).into_owned();
        if answer.contains(wanted) {
            return Ok(());
        }
        if start.elapsed() > PATIENCE {
            return Err(std::io::Error::other(format!("{path}: {answer}")));
        }
        tokio::time::sleep(Duration::from_millis(200)).await;
    }
}
