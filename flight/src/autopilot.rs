//! What differs between autopilots.

use mavlink::dialects::ardupilotmega::MavAutopilot;

/// Software that flies a vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Autopilot {
    /// ArduCopter.
    ArduPilot,
    /// PX4, multicopter.
    Px4,
}

/// What a vehicle is doing, as far as we command it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// Flies to setpoints: GUIDED, OFFBOARD.
    Guided,
    /// Lands where it is.
    Land,
    /// Any other, by its number.
    Other(u32),
}

const ARDUPILOT_GUIDED: u32 = 4;
const ARDUPILOT_LAND: u32 = 9;
/// PX4 packs main mode << 16 | sub mode << 24.
const PX4_OFFBOARD: u32 = 6 << 16;
const PX4_LAND: u32 = 4 << 16 | 6 << 24;

impl Autopilot {
    /// From a heartbeat; `None` for one we cannot fly.
    pub fn from_heartbeat(autopilot: MavAutopilot) -> Option<Self> {
        match autopilot {
            MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA => Some(Self::ArduPilot),
            MavAutopilot::MAV_AUTOPILOT_PX4 => Some(Self::Px4),
            _ => None,
        }
    }

    /// Its name on the wire of the API.
    pub fn name(self) -> &'static str {
        match self {
            Self::ArduPilot => "ardupilot",
            Self::Px4 => "px4",
        }
    }

    /// The mode of a heartbeat's `custom_mode`.
    pub fn mode(self, custom_mode: u32) -> Mode {
        if custom_mode == self.custom_mode(Mode::Guided) {
            Mode::Guided
        } else if custom_mode == self.custom_mode(Mode::Land) {
            Mode::Land
        } else {
            Mode::Other(custom_mode)
        }
    }

    /// The number of a mode.
    pub fn custom_mode(self, mode: Mode) -> u32 {
        match (self, mode) {
            (Self::ArduPilot, Mode::Guided) => ARDUPILOT_GUIDED,
            (Self::ArduPilot, Mode::Land) => ARDUPILOT_LAND,
            (Self::Px4, Mode::Guided) => PX4_OFFBOARD,
            (Self::Px4, Mode::Land) => PX4_LAND,
            (_, Mode::Other(custom_mode)) => custom_mode,
        }
    }

    /// Parameters 1 to 3 of DO_SET_MODE: "custom mode enabled", then the mode's number whole
    /// (ArduPilot) or as main and sub mode (PX4).
    pub fn mode_params(self, mode: Mode) -> [f32; 3] {
        let custom_mode = self.custom_mode(mode);
        match self {
            Self::ArduPilot => [1.0, custom_mode as f32, 0.0],
            Self::Px4 => {
                let [_, _, main, sub] = custom_mode.to_le_bytes();
                [1.0, f32::from(main), f32::from(sub)]
            }
        }
    }

    /// Whether its estimator needs an origin on the earth before it takes poses.
    pub fn needs_origin(self) -> bool {
        self == Self::ArduPilot
    }

    /// Whether it leaves its mode when setpoints stop, and needs them before it enters.
    pub fn needs_stream(self) -> bool {
        self == Self::Px4
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers of the two projects' documentation.
    #[test]
    fn modes_have_the_numbers_of_the_projects() {
        assert_eq!(Autopilot::ArduPilot.mode_params(Mode::Guided), [1.0, 4.0, 0.0]);
        assert_eq!(Autopilot::ArduPilot.mode_params(Mode::Land), [1.0, 9.0, 0.0]);
        assert_eq!(Autopilot::Px4.mode_params(Mode::Guided), [1.0, 6.0, 0.0]);
        assert_eq!(Autopilot::Px4.mode_params(Mode::Land), [1.0, 4.0, 6.0]);
        assert_eq!(Autopilot::Px4.mode(0x0604_0000), Mode::Land);
        assert_eq!(Autopilot::ArduPilot.mode(17), Mode::Other(17));
    }
}
