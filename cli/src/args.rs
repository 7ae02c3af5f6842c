//! The command line.

use std::{net::SocketAddr, path::PathBuf};

use clap::{Args, Parser, Subcommand};
use uuid::Uuid;
use volery_scene::KnownDistance;
use volery_server::CameraHost;

mod demo;
mod reconstruct;
mod simulate;
mod values;

pub(crate) use demo::{CompareArgs, DemoArgs};
pub(crate) use reconstruct::{EffortArgs, FlightArgs, ModelArgs, ReconstructArgs};
pub(crate) use simulate::{RoomArg, SimulateArgs};
pub(crate) use values::{MethodArg, RegistrationArg};
use values::{known_distance, position, speed, udp_address};

/// Photos to metric maps, and photos to poses in them.
#[derive(Debug, Parser)]
#[command(name = "volery", version, propagate_version = true)]
#[command(
    after_help = "Exit codes: 0 done, 1 failed or interrupted, 2 wrong usage, 3 done but not wholly \
    (a suspect map, photos left out, files that could not be read)."
)]
pub(crate) struct Cli {
    /// One JSON document on standard output instead of text; progress stays on standard error.
    #[arg(long, global = true)]
    pub(crate) json: bool,
    /// What to do.
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Turn photos into a map, without a server.
    Reconstruct(ReconstructArgs),
    /// List the numbers that a preset sets and --option changes.
    Options,
    /// Find the poses of photos in a map.
    Localize(LocalizeArgs),
    /// Run the ground station.
    Serve(ServeArgs),
    /// Upload photos to a server.
    Upload(UploadArgs),
    /// Jobs of a server.
    Jobs {
        #[command(flatten)]
        server: ServerArgs,
        /// What to do; lists all jobs when absent.
        #[command(subcommand)]
        command: Option<JobsCommand>,
    },
    /// Maps of a server.
    Maps {
        #[command(flatten)]
        server: ServerArgs,
        /// What to do; lists all maps when absent.
        #[command(subcommand)]
        command: Option<MapsCommand>,
    },
    /// Download a file of a map: colmap.zip, dense.ply, mesh.ply, map.glb, transforms.json, ...
    Export {
        #[command(flatten)]
        server: ServerArgs,
        /// Of the map.
        map: Uuid,
        /// Name of the export.
        name: String,
        /// The active version when absent.
        #[arg(long)]
        version: Option<u32>,
        /// File to write; by default the name of the export.
        #[arg(short, long)]
        out: Option<PathBuf>,
    },
    /// Fly simulated MAVLink drones against a server.
    Simulate(SimulateArgs),
    /// Send what drones said in a recorded flight to a server once more, to look at it again. The
    /// server must take unsigned drones (`serve --insecure-mavlink`).
    Replay(ReplayArgs),
    /// Check this machine, and a server or drones if they are named.
    Doctor(DoctorArgs),
    /// Scan a synthetic hall, map it and fly drones in it, to be watched; writes a report.
    Demo(DemoArgs),
    /// Compare a camera with radio and ultrasound on one flight; writes a report with plots.
    ComparePositioning(CompareArgs),
    /// Do the job in a work folder; the server runs this.
    #[command(hide = true)]
    RunJob {
        /// Work folder with `job.json`.
        folder: PathBuf,
    },
    /// Decode images for the server.
    #[command(hide = true)]
    RunDecoder,
    /// Localize images for the server.
    #[command(hide = true)]
    RunLocalizer,
}

/// Names the server where `--server` does not.
const SERVER_VARIABLE: &str = "VOLERY_SERVER";

/// The server where nothing names one.
const DEFAULT_SERVER: &str = "http://127.0.0.1:8420";

/// Which server, and who asks.
#[derive(Debug, Args)]
pub(crate) struct ServerArgs {
    /// Address of the server.
    #[arg(long, env = SERVER_VARIABLE, default_value = DEFAULT_SERVER, global = true)]
    pub(crate) server: String,
    /// Token; the environment keeps it out of the list of processes.
    #[arg(long, env = "VOLERY_TOKEN", hide_env_values = true, global = true)]
    pub(crate) token: Option<String>,
}

#[derive(Debug, Args)]
pub(crate) struct ReplayArgs {
    /// Telemetry log (`.tlog`): GET /v1/recordings/{id}, or of another ground station.
    pub(crate) file: PathBuf,
    /// UDP address at which the server hears drones.
    #[arg(long, default_value = "udp:127.0.0.1:14550", value_parser = udp_address)]
    pub(crate) mavlink: SocketAddr,
    /// How many times faster than it was.
    #[arg(long, default_value_t = 1.0, value_parser = speed)]
    pub(crate) speed: f64,
}

#[derive(Debug, Args)]
pub(crate) struct ServeArgs {
    /// Folder of the database, the photos and the maps.
    #[arg(long, default_value = "volery-data")]
    pub(crate) data: PathBuf,
    /// Where to listen.
    #[arg(long, default_value = "127.0.0.1:8420")]
    pub(crate) listen: SocketAddr,
    /// Requests from this machine need no token; only with a loopback address.
    #[arg(long)]
    pub(crate) loopback_without_token: bool,
    /// UDP address that drones send to, as udp:HOST:PORT; without it there are no drones.
    #[arg(long, value_parser = udp_address)]
    pub(crate) mavlink: Option<SocketAddr>,
    /// File with the MAVLink signing key of all drones that have none of their own, 64 hex digits.
    #[arg(long, requires = "mavlink")]
    pub(crate) mavlink_key: Option<PathBuf>,
    /// Take drones that do not sign: whoever reaches the address can then be one.
    #[arg(long, requires = "mavlink")]
    pub(crate) insecure_mavlink: bool,
    /// Oldest pose that is passed on to a drone, milliseconds.
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u64).range(20..=250))]
    pub(crate) max_pose_age_ms: u64,
    /// Host that drones' cameras may be pulled from: a name, an address or a network such as
    /// 192.168.4.0/24, with or without :PORT; may be repeated. Without it no camera is pulled.
    #[arg(long, value_name = "HOST")]
    pub(crate) camera_host: Vec<CameraHost>,
}

#[derive(Debug, Args)]
pub(crate) struct UploadArgs {
    #[command(flatten)]
    pub(crate) server: ServerArgs,
    /// Folders of photos, photos, or zip archives.
    #[arg(required = true)]
    pub(crate) photos: Vec<PathBuf>,
    /// Image set to add to; a new one when absent.
    #[arg(long)]
    pub(crate) imageset: Option<Uuid>,
    /// Name of a new image set.
    #[arg(long, default_value = "photos")]
    pub(crate) name: String,
    /// Calibration of the photos.
    #[arg(long, conflicts_with = "imageset")]
    pub(crate) camera: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) flight: FlightArgs,
    #[command(flatten)]
    pub(crate) given: ModelArgs,
    /// Submit a reconstruction of the set and wait for it.
    #[arg(long)]
    pub(crate) reconstruct: bool,
}

#[derive(Debug, Subcommand)]
pub(crate) enum JobsCommand {
    /// Submit a reconstruction.
    Submit {
        /// Whose photos to use.
        #[arg(required = true)]
        imagesets: Vec<Uuid>,
        /// The map that gets a new version; a new map when absent.
        #[arg(long)]
        map: Option<Uuid>,
        /// Name of a new map.
        #[arg(long)]
        name: Option<String>,
        #[command(flatten)]
        effort: EffortArgs,
        /// Seed of all random choices.
        #[arg(long, default_value_t = 0)]
        seed: u64,
        /// Measured distance between the cameras of two photos; may be repeated.
        #[arg(long, value_name = "A,B,METERS", value_parser = known_distance)]
        known_distance: Vec<KnownDistance>,
        /// Wait for its end.
        #[arg(long)]
        wait: bool,
    },
    /// Show a job.
    Show {
        /// Of the job.
        id: Uuid,
    },
    /// Follow a job to its end.
    Watch {
        /// Of the job.
        id: Uuid,
    },
    /// Ask a job to stop.
    Cancel {
        /// Of the job.
        id: Uuid,
    },
    /// Run an ended job again. What it has finished is not done again.
    Retry {
        /// Of the job.
        id: Uuid,
        /// Do this stage and all after it anew, as `mapping`.
        #[arg(long, value_name = "STAGE")]
        from_stage: Option<String>,
    },
    /// Print the log of a job.
    Log {
        /// Of the job.
        id: Uuid,
    },
}

#[derive(Debug, Subcommand)]
pub(crate) enum MapsCommand {
    /// Show a map.
    Show {
        /// Of the map.
        id: Uuid,
    },
    /// List the versions of a map.
    Versions {
        /// Of the map.
        id: Uuid,
    },
    /// Make a version the one that answers.
    Activate {
        /// Of the map.
        id: Uuid,
        /// An existing version.
        version: u32,
    },
    /// Forget a map with all its versions.
    Delete {
        /// Of the map.
        id: Uuid,
    },
    /// Join maps that share a part, in the frame of the first.
    Register {
        /// Of the maps; two at least.
        #[arg(required = true, num_args = 2..)]
        ids: Vec<Uuid>,
        /// How they are brought together: by points that look the same, by the shape of their
        /// surfaces, or by the second where the first finds nothing.
        #[arg(long, value_enum, default_value_t = RegistrationArg::Auto)]
        method: RegistrationArg,
        /// All maps have one unit: none is grown or shrunk.
        #[arg(long)]
        same_scale: bool,
        #[command(flatten)]
        effort: EffortArgs,
        /// Map that gets the result as a new version; a new map when absent.
        #[arg(long)]
        map: Option<Uuid>,
        /// Name of a new map.
        #[arg(long)]
        name: Option<String>,
        /// Watch the job to its end.
        #[arg(long)]
        wait: bool,
    },
    /// Let photos join a map.
    Extend {
        /// Of the map.
        id: Uuid,
        /// Of the image sets with the photos.
        #[arg(required = true)]
        imagesets: Vec<Uuid>,
        #[command(flatten)]
        effort: EffortArgs,
        /// Watch the job to its end.
        #[arg(long)]
        wait: bool,
    },
}

#[derive(Debug, Args)]
pub(crate) struct DoctorArgs {
    /// Address of a server to check too.
    #[arg(long, env = SERVER_VARIABLE)]
    pub(crate) server: Option<String>,
    /// Token.
    #[arg(long, env = "VOLERY_TOKEN", hide_env_values = true)]
    pub(crate) token: Option<String>,
    /// UDP address that drones send to, as udp:HOST:PORT, with no server listening: checks their
    /// parameters.
    #[arg(long, value_parser = udp_address)]
    pub(crate) mavlink: Option<SocketAddr>,
    /// File with the MAVLink signing key of the drones, 64 hex digits.
    #[arg(long, requires = "mavlink")]
    pub(crate) mavlink_key: Option<PathBuf>,
    /// Folder whose disk is checked.
    #[arg(long, default_value = ".")]
    pub(crate) data: PathBuf,
}

#[derive(Debug, Args)]
pub(crate) struct LocalizeArgs {
    /// Map folder (unless --map is given), then photos or folders of photos.
    #[arg(required = true)]
    pub(crate) paths: Vec<PathBuf>,
    /// Ask this server instead of a map folder.
    #[arg(long, requires = "map")]
    pub(crate) server: Option<String>,
    /// Token for the server.
    #[arg(long, env = "VOLERY_TOKEN", hide_env_values = true)]
    pub(crate) token: Option<String>,
    /// Map on the server; without `--server` on that of VOLERY_SERVER, else of this machine.
    #[arg(long)]
    pub(crate) map: Option<Uuid>,
    /// Version of the map; the active one when absent.
    #[arg(long, requires = "map")]
    pub(crate) version: Option<u32>,
    /// Calibration of the photos. Without it the map's own camera of this size, else EXIF.
    #[arg(long)]
    pub(crate) camera: Option<PathBuf>,
    /// Telemetry of the photos: the yaw narrows the search if the map was made with telemetry.
    #[arg(long)]
    pub(crate) telemetry: Option<PathBuf>,
    /// How photos are placed: by features, by comparing them with views of the map's mesh, or by the
    /// second where the first finds nothing.
    #[arg(long, value_enum, default_value_t = MethodArg::Auto)]
    pub(crate) method: MethodArg,
    /// A place near which the photos were taken, in the map; with `--telemetry` the comparison with
    /// views starts there.
    #[arg(long, value_name = "X,Y,Z", value_parser = position, allow_hyphen_values = true)]
    pub(crate) near: Option<[f64; 3]>,
    /// How near: the standard deviation of `--near`.
    #[arg(long, default_value_t = 0.3, requires = "near")]
    pub(crate) near_sigma: f64,
    /// Poses of the photos answered `ok`: `image,qw,qx,qy,qz,tx,ty,tz`, camera to map.
    #[arg(short, long)]
    pub(crate) out: Option<PathBuf>,
    /// Seed of all random choices.
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
}

impl LocalizeArgs {
    /// The map to ask for, and its server; `None` for a map folder.
    pub(crate) fn remote(&self) -> Option<(String, Uuid)> {
        let server =
            || std::env::var(SERVER_VARIABLE).unwrap_or_else(|_| DEFAULT_SERVER.to_owned());
        Some((self.server.clone().unwrap_or_else(server), self.map?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        use clap::CommandFactory;
        Cli::command().debug_assert();
    }
}
