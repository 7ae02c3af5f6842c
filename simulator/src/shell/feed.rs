//! Cameras that look while the drones fly.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use nalgebra::Isometry3;
use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};
use rustix::process::setpriority_process;
use tokio::sync::{mpsc, watch};
use tokio::task::JoinHandle;

use super::frames::{StreamTarget, stream_frames};
use super::mjpeg::serve_mjpeg;
use super::{Line, SimulationError};
use crate::camera::jpeg;
use crate::fault::FaultKind;
use crate::{CameraFault, Eye, Fault, World};

/// Of the threads that draw.
const NICENESS: i32 = 5;

/// What drones look with and where the pictures go.
#[derive(Debug, Clone)]
pub struct Feed {
    /// The same for all drones.
    pub eye: Eye,
    /// Time between two pictures of a drone; a slow machine takes fewer.
    pub interval: Duration,
    /// Where they go.
    pub sink: FrameSink,
}

/// Where pictures go.
#[derive(Debug, Clone)]
pub enum FrameSink {
    /// Into a localization stream of the server.
    Stream(StreamTarget),
    /// To whom asks for them by HTTP, as small cameras serve them: drone by drone on the next port,
    /// on any free ones for port 0.
    Mjpeg(SocketAddr),
}

/// An encoded picture.
#[derive(Debug, Clone)]
pub(super) struct Picture {
    pub(super) jpeg: Arc<Vec<u8>>,
    /// Nanoseconds since the Unix epoch.
    pub(super) captured_ns: u64,
    /// Time of the simulation then.
    pub(super) taken: Duration,
    pub(super) world_from_camera: Isometry3<f64>,
}

pub(super) type Pictures = watch::Receiver<Option<Picture>>;

/// The cameras of a run.
pub(super) struct Cameras {
    eye: Arc<Eye>,
    interval: Duration,
    /// Draws the pictures.
    studio: ThreadPool,
    /// Pictures that may be drawn at the same time.
    max_drawn: usize,
    views: Vec<View>,
    addresses: Vec<(u8, SocketAddr)>,
    tasks: Vec<JoinHandle<()>>,
    lines: mpsc::UnboundedReceiver<Line>,
}

struct View {
    system_id: u8,
    faults: Vec<Fault>,
    next: Duration,
    num_taken: u64,
    frozen: Option<Isometry3<f64>>,
    is_drawn: Arc<AtomicBool>,
    pictures: Arc<watch::Sender<Option<Picture>>>,
}

impl Cameras {
    pub(super) async fn start(
        feed: Feed,
        world: &World,
        faults: &[Fault],
        start: Instant,
    ) -> Result<Self, SimulationError> {
        let (mut views, mut addresses, mut tasks) = (Vec::new(), Vec::new(), Vec::new());
        let (says, lines) = mpsc::unbounded_channel();
        for (index, drone) in world.drones.iter().enumerate() {
            let system_id = drone.options().system_id;
            let (sender, pictures) = watch::channel(None);
            match &feed.sink {
                FrameSink::Stream(target) => {
                    let task =
                        stream_frames(target.clone(), system_id, pictures, says.clone(), start);
                    tasks.push(tokio::spawn(task));
                }
                FrameSink::Mjpeg(first) => {
                    let mut address = *first;
                    if first.port() != 0 {
                        address.set_port(first.port().saturating_add(index as u16));
                    }
                    let (address, task) = serve_mjpeg(address, pictures).await?;
                    addresses.push((system_id, address));
                    tasks.push(tokio::spawn(task));
                }
            }
            let own = |f: &&Fault| matches!(f.kind, FaultKind::Camera(_)) && f.is_of(system_id);
            views.push(View {
                system_id,
                faults: faults.iter().filter(own).cloned().collect(),
                // The drones take turns.
                next: feed.interval.mul_f64(index as f64 / world.drones.len() as f64),
                num_taken: 0,
                frozen: None,
                is_drawn: Arc::default(),
                pictures: Arc::new(sender),
            });
        }
        let eye = Arc::new(feed.eye);
        let studio = studio().map_err(SimulationError::Threads)?;
        let max_drawn = studio.current_num_threads().div_ceil(2);
        let interval = feed.interval;
        Ok(Self { eye, interval, studio, max_drawn, views, addresses, tasks, lines })
    }

    /// Where pictures are served.
    pub(super) fn addresses(&self) -> impl Iterator<Item = Line> {
        self.addresses.iter().map(|(system_id, address)| Line::Camera {
            system_id: *system_id,
            camera_url: format!("http://{address}/stream"),
        })
    }

    /// What the server said since the last call.
    pub(super) fn lines(&mut self) -> Vec<Line> {
        std::iter::from_fn(|| self.lines.try_recv().ok()).collect()
    }

    /// Takes the pictures that are due, the longest due first. A camera that is still at work is not
    /// disturbed, and no more of them work than leave room for those who look at the pictures: one
    /// that waits for its turn takes its picture later, one that is drawn beside many sends it late.
    pub(super) fn look(&mut self, world: &World, now: Duration) {
        let is_busy = |view: &View| view.is_drawn.load(Ordering::Acquire);
        let num_busy = self.views.iter().filter(|view| is_busy(view)).count();
        let room = self.max_drawn.saturating_sub(num_busy);
        let mut due: Vec<_> = self
            .views
            .iter_mut()
            .zip(&world.drones)
            .filter(|(view, _)| view.next <= now && !is_busy(view))
            .collect();
        due.sort_by_key(|(view, _)| view.next);
        for (view, drone) in due.into_iter().take(room) {
            view.next = (view.next + self.interval).max(now);
            view.num_taken += 1;
            let fault = view.faults.iter().find_map(|fault| match fault.kind {
                FaultKind::Camera(kind) if fault.when.contains(&now) => Some(kind),
                _ => None,
            });
            let truth = drone.world_from_body();
            let seen = match fault {
                Some(CameraFault::Blackout) => None,
                Some(CameraFault::Freeze) => Some(*view.frozen.get_or_insert(truth)),
                None => {
                    view.frozen = None;
                    Some(truth)
                }
            };
            take(&self.studio, &self.eye, view, &truth, seen, world.now());
        }
    }
}

impl Drop for Cameras {
    fn drop(&mut self) {
        self.tasks.iter().for_each(JoinHandle::abort);
    }
}

/// All of the machine, but less urgent than everything else: real cameras do not take the time of
/// those who look at the pictures.
fn studio() -> Result<ThreadPool, ThreadPoolBuildError> {
    ThreadPoolBuilder::new()
        .thread_name(|_| "camera".to_owned())
        .start_handler(|_| {
            // Where it may not be less urgent, it is as urgent.
            let _ = setpriority_process(None, NICENESS);
        })
        .build()
}

/// The studio draws the picture; nothing else waits for it.
fn take(
    studio: &ThreadPool,
    eye: &Arc<Eye>,
    view: &View,
    world_from_body: &Isometry3<f64>,
    seen: Option<Isometry3<f64>>,
    taken: Duration,
) {
    // A frozen picture keeps its noise.
    let number = if view.frozen.is_some() { 0 } else { view.num_taken };
    let seed = u64::from(view.system_id) << 32 | number;
    let captured_ns =
        SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_nanos() as u64;
    let world_from_camera = world_from_body * eye.mount().cam_from_body().inverse();
    let (eye, pictures) = (Arc::clone(eye), Arc::clone(&view.pictures));
    let is_drawn = Arc::clone(&view.is_drawn);
    is_drawn.store(true, Ordering::Release);
    studio.spawn(move || {
        let photo = seen.map_or_else(|| eye.darkness(), |pose| eye.photo(&pose, seed));
        // The size was given as a camera's and fits.
        if let Ok(bytes) = jpeg(photo) {
            let jpeg = Arc::new(bytes);
            let picture = Picture { jpeg, captured_ns, taken, world_from_camera };
            pictures.send_replace(Some(picture));
        }
        is_drawn.store(false, Ordering::Release);
    });
}
