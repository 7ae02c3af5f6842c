//! What happens to drones.

use serde::Serialize;

use crate::Mode;

/// Something that happened, as a line of the log has it.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum Event {
    /// A command came and was answered.
    Command {
        /// MAV_CMD.
        command: u32,
        /// MAV_RESULT.
        result: u32,
    },
    /// The mode changed.
    Mode {
        /// New one.
        mode: Mode,
        /// `command` or the failsafe.
        why: &'static str,
    },
    /// Motors run.
    Armed,
    /// Motors stand.
    Disarmed {
        /// What for.
        why: &'static str,
    },
    /// The autopilot acts by itself.
    Failsafe {
        /// What for.
        why: &'static str,
    },
    /// A text to the ground station.
    Text {
        /// 0 (emergency) to 7.
        severity: u8,
        /// It.
        text: String,
    },
    /// The feet are on the floor after a flight.
    Landed,
    /// The floor came too fast.
    Crash {
        /// m/s.
        speed: f64,
    },
    /// A wall, a thing or the ceiling was touched.
    Contact,
    /// Another drone is nearer than allowed.
    TooClose {
        /// Its system id.
        other: u8,
        /// Meters.
        distance: f64,
    },
    /// The firmware stopped at a number that is not finite.
    Halted,
}
