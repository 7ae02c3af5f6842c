//! Arguments of `volery simulate`.

use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;

use clap::{Args, ValueEnum};
use uuid::Uuid;
use volery_simulator::{FAULTS, Fault, Flavor};

use super::ServerArgs;
use super::values::{position, positive};

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum FlavorArg {
    Ardupilot,
    Px4,
    /// Every other drone the one and the other.
    Mixed,
}

impl FlavorArg {
    /// Family of the drone at `index`.
    pub(crate) fn of(self, index: u8) -> Flavor {
        match self {
            Self::Ardupilot => Flavor::ArduPilot,
            Self::Px4 => Flavor::Px4,
            Self::Mixed if index.is_multiple_of(2) => Flavor::ArduPilot,
            Self::Mixed => Flavor::Px4,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum RoomArg {
    /// The hall of the demo.
    Hall,
    /// A floor without walls; nothing to be seen.
    Open,
}

/// Drones tell their true states and what happens to them as JSON lines on standard output.
#[derive(Debug, Args)]
#[command(after_help = format!("Faults: {FAULTS}"))]
pub(crate) struct SimulateArgs {
    /// How many.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=200))]
    pub(crate) drones: u8,
    /// System id of the first one; the others count on.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=254))]
    pub(crate) system_id: u8,
    /// Where they send MAVLink to.
    #[arg(long, default_value = "127.0.0.1:14550")]
    pub(crate) mavlink: SocketAddr,
    /// Their own address.
    #[arg(long, default_value = "127.0.0.1")]
    pub(crate) bind: IpAddr,
    /// Family of their autopilots.
    #[arg(long, value_enum, default_value = "ardupilot")]
    pub(crate) flavor: FlavorArg,
    /// Where the first one stands, meters of the room.
    #[arg(long, value_parser = position, default_value = "-2,0,0", allow_hyphen_values = true)]
    pub(crate) start: [f64; 3],
    /// From one to the next.
    #[arg(long, value_parser = position, default_value = "1.5,0,0", allow_hyphen_values = true)]
    pub(crate) spacing: [f64; 3],
    /// Room that they fly in.
    #[arg(long, value_enum, default_value = "hall")]
    pub(crate) room: RoomArg,
    /// Textured mesh of a map to fly in instead of a room; its lowest point becomes the floor.
    #[arg(long, conflicts_with = "room")]
    pub(crate) glb: Option<PathBuf>,
    /// Of the room and of all noise.
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// Key of MAVLink signing, 64 hexadecimal digits; unsigned messages are then refused.
    #[arg(long, value_parser = signing_key, env = "VOLERY_MAVLINK_KEY", hide_env_values = true)]
    pub(crate) key: Option<[u8; 32]>,
    /// Parameter of the autopilots that differs from those for flight by camera: NAME=VALUE.
    #[arg(long, value_parser = parameter)]
    pub(crate) parameter: Vec<(String, f64)>,
    /// What goes wrong.
    #[arg(long)]
    pub(crate) fault: Vec<Fault>,
    /// Map of the server that their pictures are streamed to be localized in.
    #[arg(long)]
    pub(crate) map: Option<Uuid>,
    #[command(flatten)]
    pub(crate) server: ServerArgs,
    /// Serve their pictures as motion JPEG, the first one's here, the others' on the next ports.
    #[arg(long, conflicts_with = "map")]
    pub(crate) mjpeg: Option<SocketAddr>,
    /// Calibration of their cameras as JSON; by default 640x480 with a focal length of 457.
    #[arg(long)]
    pub(crate) camera: Option<PathBuf>,
    /// Pictures per second and drone, at most.
    #[arg(long, default_value_t = 5.0, value_parser = positive)]
    pub(crate) frames: f64,
    /// Distance under which flying pairs are reported, meters.
    #[arg(long, default_value_t = 0.8, value_parser = positive)]
    pub(crate) separation: f64,
    /// State lines per second and drone.
    #[arg(long, default_value_t = 5.0, value_parser = positive)]
    pub(crate) report: f64,
    /// Seconds; without end when absent.
    #[arg(long, value_parser = positive)]
    pub(crate) duration: Option<f64>,
}

fn parameter(text: &str) -> Result<(String, f64), String> {
    text.split_once('=')
        .and_then(|(name, value)| Some((name.to_owned(), value.parse().ok()?)))
        .ok_or_else(|| "NAME=NUMBER is expected".to_owned())
}

fn signing_key(text: &str) -> Result<[u8; 32], String> {
    let mut key = [0; 32];
    if text.len() != 64 || !text.is_ascii() {
        return Err("64 hexadecimal digits are expected".to_owned());
    }
    for (byte, digits) in key.iter_mut().zip(text.as_bytes().chunks(2)) {
        let digits = str::from_utf8(digits).map_err(|e| e.to_string())?;
        *byte = u8::from_str_radix(digits, 16).map_err(|e| e.to_string())?;
    }
    Ok(key)
}
