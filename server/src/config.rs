//! Every setting of the service.

use std::{
    net::{Ipv4Addr, SocketAddr},
    path::PathBuf,
    time::Duration,
};

use volery_api::Limits;

use crate::sources::CameraHost;

/// Settings of [`crate::start`].
#[derive(Debug, Clone)]
pub struct Config {
    /// Folder of the database, the blobs and the work folders; created when missing.
    pub data: PathBuf,
    /// Address to listen on; port 0 takes a free one.
    pub listen: SocketAddr,
    /// Whether requests from this machine may come without a token; they act as admin.
    pub loopback_without_token: bool,
    /// Program whose `run-job`, `run-decoder` and `run-localizer` do the work.
    pub worker_program: PathBuf,
    /// Arguments before those words.
    pub worker_args: Vec<String>,
    /// How the children are held.
    pub workers: WorkerLimits,
    /// How jobs are run.
    pub jobs: JobSettings,
    /// What is refused.
    pub limits: Limits,
    /// Longest time for one answer, uploads and sockets apart.
    pub request_timeout: Duration,
    /// The drones' link; none when absent.
    pub mavlink: Option<MavlinkSettings>,
    /// Where drones' cameras may be pulled from; nowhere when empty.
    pub camera_hosts: Vec<CameraHost>,
}

/// The drones' link.
#[derive(Debug, Clone)]
pub struct MavlinkSettings {
    /// UDP address that drones send to.
    pub listen: SocketAddr,
    /// Signing key of drones that have none of their own.
    pub key: Option<[u8; 32]>,
    /// Whether drones without a key may take part.
    pub accept_unsigned: bool,
    /// Oldest pose that is passed on to a drone.
    pub max_pose_age: Duration,
}

impl MavlinkSettings {
    /// Signed drones only.
    pub fn new(listen: SocketAddr) -> Self {
        Self { listen, key: None, accept_unsigned: false, max_pose_age: Duration::from_millis(100) }
    }

    /// A key from 64 hex digits.
    pub fn parse_key(text: &str) -> Option<[u8; 32]> {
        crate::fleet::parse_key(text).map(|key| key.0)
    }
}

/// How the children are held.
#[derive(Debug, Clone)]
pub struct WorkerLimits {
    /// Decoders at once.
    pub decoders: usize,
    /// Localizers at once.
    pub localizers: usize,
    /// Child processes that follow streams from frame to frame.
    pub trackers: usize,
    /// Questions that may wait for a localizer; more are turned away.
    pub waiting: usize,
    /// Address space of a decoder, bytes.
    pub decoder_bytes: u64,
    /// Address space of a localizer, bytes.
    pub localizer_bytes: u64,
    /// Address space of a job, bytes.
    pub job_bytes: u64,
    /// Longest check of one image.
    pub decode_timeout: Duration,
    /// Longest localization of one image, loading of the map included.
    pub localize_timeout: Duration,
    /// Longest alignment or export.
    pub map_timeout: Duration,
}

/// How jobs are run.
#[derive(Debug, Clone)]
pub struct JobSettings {
    /// Jobs at once.
    pub parallel: usize,
    /// Time without a heartbeat after which a job is taken over.
    pub lease: Duration,
    /// Time between heartbeats.
    pub heartbeat: Duration,
    /// Runs of a job whose worker dies.
    pub max_attempts: u32,
    /// Waits before the second, third, ... run.
    pub backoff: Vec<Duration>,
    /// Time a child has to stop after it was asked to.
    pub cancel_grace: Duration,
    /// Longest run of one job.
    pub timeout: Duration,
    /// Whether the work folder of a job stays when it has succeeded and its map is kept.
    pub keep_work_folders: bool,
}

impl Config {
    /// Defaults over a data folder.
    pub fn new(data: impl Into<PathBuf>, worker_program: impl Into<PathBuf>) -> Self {
        Self {
            data: data.into(),
            listen: SocketAddr::from((Ipv4Addr::LOCALHOST, 8420)),
            loopback_without_token: false,
            worker_program: worker_program.into(),
            worker_args: Vec::new(),
            workers: WorkerLimits::default(),
            jobs: JobSettings::default(),
            limits: default_limits(),
            request_timeout: Duration::from_secs(60),
            mavlink: None,
            camera_hosts: Vec::new(),
        }
    }
}

impl Default for WorkerLimits {
    fn default() -> Self {
        Self {
            decoders: 2,
            localizers: 2,
            trackers: 2,
            waiting: 64,
            decoder_bytes: 2 << 30,
            localizer_bytes: 8 << 30,
            job_bytes: 32 << 30,
            decode_timeout: Duration::from_secs(10),
            localize_timeout: Duration::from_secs(30),
            map_timeout: Duration::from_secs(120),
        }
    }
}

impl Default for JobSettings {
    fn default() -> Self {
        Self {
            parallel: 1,
            lease: Duration::from_secs(30),
            heartbeat: Duration::from_secs(5),
            max_attempts: 3,
            backoff: [5, 30, 180].map(Duration::from_secs).to_vec(),
            cancel_grace: Duration::from_secs(10),
            timeout: Duration::from_secs(24 * 3600),
            keep_work_folders: false,
        }
    }
}

fn default_limits() -> Limits {
    Limits {
        json_bytes: 8 << 20,
        image_bytes: 32 << 20,
        upload_bytes: 1 << 30,
        archive_bytes: 4 << 30,
        archive_unpacked_bytes: 8 << 30,
        archive_entries: 5000,
        archive_ratio: 100,
        imageset_images: 20_000,
        queued_jobs: 100,
        connections: 1024,
        connections_per_address: 64,
        header_timeout_s: 10,
        body_idle_timeout_s: 30,
        body_min_bytes_per_s: 1024,
        disk_reserve_bytes: 512 << 20,
    }
}
