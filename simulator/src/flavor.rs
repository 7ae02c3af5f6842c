//! The two families of autopilots and the numbers of their modes.

use mavlink::dialects::ardupilotmega::MavAutopilot;

/// Whose habits a drone has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Flavor {
    /// ArduCopter 4.7.
    ArduPilot,
    /// PX4 1.15, multicopter.
    Px4,
}

/// Who steers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// A pilot by hand; where every drone starts.
    Manual,
    /// The ground station: GUIDED of ArduPilot, OFFBOARD of PX4.
    Guided,
    /// ArduPilot's LOITER: a pilot moves the place that is held.
    Loiter,
    /// ArduPilot's BRAKE: stops and stays.
    Brake,
    /// PX4's AUTO.LOITER: stays.
    Hold,
    /// PX4's AUTO.TAKEOFF.
    TakeOff,
    /// Comes down where it is and disarms.
    Land,
}

impl Flavor {
    /// As heartbeats name it.
    pub fn autopilot(self) -> MavAutopilot {
        match self {
            Self::ArduPilot => MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
            Self::Px4 => MavAutopilot::MAV_AUTOPILOT_PX4,
        }
    }

    /// `custom_mode` of a mode, `None` for those it does not have.
    pub fn number(self, mode: Mode) -> Option<u32> {
        let px4 = |main: u32, sub: u32| Some(main << 16 | sub << 24);
        match (self, mode) {
            (Self::ArduPilot, Mode::Manual) => Some(0),
            (Self::ArduPilot, Mode::Guided) => Some(4),
            (Self::ArduPilot, Mode::Loiter) => Some(5),
            (Self::ArduPilot, Mode::Land) => Some(9),
            (Self::ArduPilot, Mode::Brake) => Some(17),
            (Self::ArduPilot, Mode::Hold | Mode::TakeOff) => None,
            (Self::Px4, Mode::Manual) => px4(7, 0),
            (Self::Px4, Mode::Guided) => px4(6, 0),
            (Self::Px4, Mode::TakeOff) => px4(4, 2),
            (Self::Px4, Mode::Hold) => px4(4, 3),
            (Self::Px4, Mode::Land) => px4(4, 6),
            (Self::Px4, Mode::Loiter | Mode::Brake) => None,
        }
    }

    /// The mode of a `custom_mode`.
    pub fn mode(self, number: u32) -> Option<Mode> {
        use Mode::{Brake, Guided, Hold, Land, Loiter, Manual, TakeOff};
        [Manual, Guided, Loiter, Brake, Hold, TakeOff, Land]
            .into_iter()
            .find(|&mode| self.number(mode) == Some(number))
    }
}
