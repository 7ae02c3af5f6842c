//! What is not done, and why: commands of users, frames of strangers.

/// Why a command was not taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum CommandRefusal {
    /// No such vehicle was heard.
    #[error("there is no such vehicle")]
    UnknownVehicle,
    /// The link does not stand.
    #[error("the vehicle is not linked")]
    NotLinked,
    /// Its estimator does not follow our poses.
    #[error("the vehicle's estimator does not follow the poses that it is sent")]
    NotReady,
    /// It does not stand on the ground.
    #[error("the vehicle flies")]
    Flying,
    /// It does not fly.
    #[error("the vehicle does not fly")]
    NotFlying,
    /// Someone else, or its failsafe, flies it.
    #[error("the vehicle is not in the mode that follows our setpoints")]
    NotInControl,
    /// Its number or its address is not its own.
    #[error("another vehicle uses the same system id or address")]
    Conflict,
    /// A number that cannot be flown.
    #[error("a number of the command is not finite or out of range")]
    BadNumber,
}

impl CommandRefusal {
    /// Stable, for programs.
    pub fn code(self) -> &'static str {
        match self {
            Self::UnknownVehicle => "unknown_vehicle",
            Self::NotLinked => "not_linked",
            Self::NotReady => "not_ready",
            Self::Flying => "flying",
            Self::NotFlying => "not_flying",
            Self::NotInControl => "not_in_control",
            Self::Conflict => "address_conflict",
            Self::BadNumber => "bad_number",
        }
    }
}

/// Frames that were not accepted, by reason.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Refused {
    /// MAVLink 1, which cannot be signed.
    pub version_1: u64,
    /// No frames, or cut ones.
    pub garbage: u64,
    /// Wrong checksums.
    pub checksum: u64,
    /// Messages or values that the dialect does not know.
    pub unknown_message: u64,
    /// Not signed where a signature is needed.
    pub unsigned: u64,
    /// Signed with another key.
    pub wrong_signature: u64,
    /// Played again, or too old.
    pub replayed: u64,
    /// From another address than the vehicle's.
    pub foreign_address: u64,
    /// From nobody that was introduced by a heartbeat.
    pub stranger: u64,
}

impl Refused {
    /// All of them.
    pub fn total(&self) -> u64 {
        self.version_1
            + self.garbage
            + self.checksum
            + self.unknown_message
            + self.unsigned
            + self.wrong_signature
            + self.replayed
            + self.foreign_address
            + self.stranger
    }
}
