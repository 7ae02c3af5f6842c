//! Writes what drones and the service say to each other to `.tlog` files.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs::File,
    io::{BufWriter, Write},
    path::{Path, PathBuf},
    sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel},
    thread::JoinHandle,
    time::Duration,
};

use uuid::Uuid;
use volery_api::Recording;
use volery_flight::{VehicleId, tlog::write_records};

use super::service::Drones;
use crate::clock;

/// Folder in the data folder.
const FOLDER: &str = "recordings";
const EXTENSION: &str = "tlog";
/// Datagrams that may wait for a slow disk; those beyond are not recorded.
const MAX_WAITING: usize = 4096;
/// A recording ends at this size: more than a day of one drone.
const MAX_BYTES: u64 = 1 << 30;
/// Between writes to the disk.
const FLUSH_TIME: Duration = Duration::from_secs(1);

/// Why there is no recording.
#[derive(Debug, thiserror::Error)]
pub(crate) enum RecordingError {
    /// A drone has one at a time.
    #[error("recording {0} of the drone is running")]
    Running(Uuid),
    /// It is not there to be recorded.
    #[error("the drone was not heard")]
    NotHeard,
    /// There is none of this id.
    #[error("there is no such recording")]
    Unknown,
    /// The disk.
    #[error(transparent)]
    Io(#[from] std::io::Error),
}

/// Recordings that are running, and the folder of all.
#[derive(Debug)]
pub(super) struct Recorder {
    folder: PathBuf,
    running: BTreeMap<u8, Running>,
}

/// The folder, and which of its recordings go on, at some time: what looks at the disk holds up no
/// drone.
#[derive(Debug)]
struct Shelf {
    folder: PathBuf,
    running: BTreeSet<Uuid>,
}

/// A recording that goes on until this is dropped; then its file is written by the thread.
#[derive(Debug)]
pub(super) struct Running {
    id: Uuid,
    datagrams: SyncSender<(Duration, Vec<u8>)>,
    thread: JoinHandle<()>,
}

impl Running {
    /// Whether its file takes more.
    fn goes_on(&self) -> bool {
        !self.thread.is_finished()
    }

    /// Ends it. What was recorded is in the file then.
    pub(super) fn finish(self) {
        drop(self.datagrams);
        // A panic has been reported.
        let _ = self.thread.join();
    }
}

impl Recorder {
    pub(super) fn new(data: &Path) -> Self {
        Self { folder: data.join(FOLDER), running: BTreeMap::new() }
    }

    /// Whether nothing is recorded.
    pub(super) fn is_idle(&self) -> bool {
        self.running.is_empty()
    }

    /// A datagram from or to a drone.
    pub(super) fn record(&self, drone: u8, datagram: &[u8]) {
        if let Some(running) = self.running.get(&drone) {
            // The drone's link waits for no disk.
            let _ = running.datagrams.try_send((clock::since_epoch(), datagram.to_vec()));
        }
    }

    pub(super) fn start(&mut self, drone: u8) -> Result<Recording, RecordingError> {
        if let Some(running) = self.running.get(&drone).filter(|running| running.goes_on()) {
            return Err(RecordingError::Running(running.id));
        }
        std::fs::create_dir_all(&self.folder)?;
        let id = Uuid::now_v7();
        let file = File::create_new(self.shelf().path(id, drone))?;
        let (datagrams, waiting) = sync_channel(MAX_WAITING);
        let thread = std::thread::Builder::new().name("recording".to_owned()).spawn(move || {
            if let Err(error) = write(file, &waiting) {
                tracing::warn!(%error, recording = %id, "recording {id} ended");
            }
        })?;
        self.running.insert(drone, Running { id, datagrams, thread });
        Ok(self.shelf().describe(id, drone, 0))
    }

    /// Takes one that is running out; whoever takes it finishes it.
    pub(super) fn stop(&mut self, id: Uuid) -> Option<Running> {
        let drone = self.running.iter().find(|(_, running)| running.id == id).map(|(&d, _)| d)?;
        self.running.remove(&drone)
    }

    /// The same of all.
    pub(super) fn stop_all(&mut self) -> impl Iterator<Item = Running> {
        std::mem::take(&mut self.running).into_values()
    }

    fn shelf(&self) -> Shelf {
        let running = self.running.values().filter(|running| running.goes_on());
        Shelf { folder: self.folder.clone(), running: running.map(|running| running.id).collect() }
    }
}

impl Shelf {
    /// All, the oldest first.
    fn list(&self) -> std::io::Result<Vec<Recording>> {
        let mut all = Vec::new();
        let files = match std::fs::read_dir(&self.folder) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(all),
            files => files?,
        };
        for file in files {
            let file = file?;
            if let Some((id, drone)) = named(&file.path()) {
                all.push(self.describe(id, drone, file.metadata()?.len()));
            }
        }
        all.sort_by_key(|recording| recording.id);
        Ok(all)
    }

    fn path(&self, id: Uuid, drone: u8) -> PathBuf {
        self.folder.join(format!("{id}_{drone}")).with_extension(EXTENSION)
    }

    fn describe(&self, id: Uuid, drone: u8, size: u64) -> Recording {
        let (seconds, nanos) = id.get_timestamp().map_or((0, 0), |time| time.to_unix());
        let running = self.running.contains(&id);
        let t_ns = seconds * 1_000_000_000 + u64::from(nanos);
        Recording { id, drone, t_ns, running, size }
    }
}

/// What a file is of.
fn named(path: &Path) -> Option<(Uuid, u8)> {
    let is_log = path.extension().is_some_and(|extension| extension == EXTENSION);
    let (id, drone) = path.file_stem().filter(|_| is_log)?.to_str()?.split_once('_')?;
    Some((Uuid::parse_str(id).ok()?, drone.parse().ok()?))
}

/// Until nobody sends any more, or the file is full.
fn write(file: File, waiting: &Receiver<(Duration, Vec<u8>)>) -> std::io::Result<()> {
    let mut file = BufWriter::new(file);
    let (mut size, mut log) = (0, Vec::new());
    while size < MAX_BYTES {
        match waiting.recv_timeout(FLUSH_TIME) {
            Ok((time, datagram)) => {
                log.clear();
                write_records(&datagram, time, &mut log);
                file.write_all(&log)?;
                size += log.len() as u64;
            }
            Err(RecvTimeoutError::Timeout) => file.flush()?,
            Err(RecvTimeoutError::Disconnected) => break,
        }
    }
    file.flush()
}

impl Drones {
    /// Records a drone that is heard, from now on.
    pub(crate) fn start_recording(&self, drone: u8) -> Result<Recording, RecordingError> {
        self.shared.relay(|state, _| {
            state.fleet.vehicle(VehicleId(drone)).ok_or(RecordingError::NotHeard)?;
            state.recorder.start(drone)
        })
    }

    /// Ends a recording, if it is running. Waits for the disk.
    pub(crate) fn stop_recording(&self, id: Uuid) -> Result<Recording, RecordingError> {
        let running = self.shared.relay(|state, _| state.recorder.stop(id));
        if let Some(running) = running {
            running.finish();
        }
        self.recording(id).map(|(recording, _)| recording)
    }

    /// All recordings, the oldest first. Waits for the disk.
    pub(crate) fn recordings(&self) -> Result<Vec<Recording>, RecordingError> {
        Ok(self.shelf().list()?)
    }

    /// One of them, and its file. Waits for the disk.
    pub(crate) fn recording(&self, id: Uuid) -> Result<(Recording, PathBuf), RecordingError> {
        let shelf = self.shelf();
        let found = shelf.list()?.into_iter().find(|recording| recording.id == id);
        let recording = found.ok_or(RecordingError::Unknown)?;
        let path = shelf.path(id, recording.drone);
        Ok((recording, path))
    }

    fn shelf(&self) -> Shelf {
        self.shared.read(|state, _| state.recorder.shelf())
    }

    /// Ends a recording and takes its file away.
    pub(crate) fn delete_recording(&self, id: Uuid) -> Result<(), RecordingError> {
        self.stop_recording(id)?;
        let (_, path) = self.recording(id)?;
        Ok(std::fs::remove_file(path)?)
    }
}
