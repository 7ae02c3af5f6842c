//! What happens to vehicles.

use core::net::SocketAddr;
use std::time::Duration;

use crate::{
    VehicleId,
    feed::{FeedState, PoseRefusal},
    link::LinkState,
    task::{CommandId, CommandState},
    telemetry::Landed,
    watchdog::Reason,
};

/// Something that happened to a vehicle.
#[derive(Debug, Clone, PartialEq)]
pub struct Event {
    /// To which.
    pub vehicle: VehicleId,
    /// What.
    pub happening: Happening,
}

/// What may happen to a vehicle.
#[derive(Debug, Clone, PartialEq)]
pub enum Happening {
    /// It is heard better or worse.
    Link(LinkState),
    /// Its estimator follows our poses, or no longer.
    Feed(FeedState),
    /// Its motors went on or off.
    Armed(bool),
    /// Its mode changed, to this number.
    Mode(u32),
    /// It left the ground or came back.
    Landed(Landed),
    /// It started anew.
    Rebooted,
    /// It answers from another address.
    Moved(SocketAddr),
    /// It says something.
    Text {
        /// 0 emergency to 7 debug.
        severity: u8,
        /// For people.
        text: String,
    },
    /// A command of ours went on.
    Command {
        /// Which.
        id: CommandId,
        /// How far.
        state: CommandState,
    },
    /// Somebody should look.
    Alert(Alert),
}

/// What somebody should look at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Alert {
    /// The watchdog stops the vehicle.
    Holds(Reason),
    /// The watchdog lands the vehicle.
    Lands(Reason),
    /// Poses are not believed; the first of a run.
    PoseRefused(PoseRefusal),
    /// It is this many meters from where it was believed to be, as the source of its poses announced.
    Relocated(f64),
    /// Frames with its signature are more than a minute behind: its clock is wrong, or they are
    /// played again. They are not taken.
    SigningClock(Duration),
    /// Its failsafe or a pilot took over.
    ControlTaken,
    /// Somebody else sends with its number.
    Impostor(SocketAddr),
    /// Another vehicle has the same address: poses would go to both.
    SharedAddress,
}

impl Alert {
    /// Its name on the wire of the API.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Holds(reason) | Self::Lands(reason) => reason.code(),
            Self::PoseRefused(_) => "pose_refused",
            Self::Relocated(_) => "relocated",
            Self::SigningClock(_) => "signing_clock",
            Self::ControlTaken => "control_taken",
            Self::Impostor(_) => "impostor",
            Self::SharedAddress => "shared_address",
        }
    }
}
