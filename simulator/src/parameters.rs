//! Parameters of an autopilot, as far as indoor flight by camera reads them.

use mavlink::dialects::ardupilotmega::MavParamType;

use crate::Flavor;

/// Names and values; the order is the index of the parameter protocol.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameters {
    flavor: Flavor,
    values: Vec<(&'static str, Kind, f64)>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Int,
    Real,
}
use Kind::{Int, Real};

/// Set up for flight by camera. Speeds of ArduPilot are cm/s.
const ARDUPILOT: &[(&str, Kind, f64)] = &[
    ("GPS1_TYPE", Int, 0.0),
    ("VISO_TYPE", Int, 1.0),
    ("VISO_DELAY_MS", Int, 50.0),
    ("VISO_POS_M_NSE", Real, 0.1),
    ("VISO_YAW_M_NSE", Real, 0.1),
    ("VISO_QUAL_MIN", Int, 0.0),
    ("AHRS_EKF_TYPE", Int, 3.0),
    ("EK3_ENABLE", Int, 1.0),
    ("EK3_SRC1_POSXY", Int, 6.0),
    ("EK3_SRC1_VELXY", Int, 0.0),
    ("EK3_SRC1_POSZ", Int, 6.0),
    ("EK3_SRC1_VELZ", Int, 0.0),
    ("EK3_SRC1_YAW", Int, 6.0),
    ("COMPASS_ENABLE", Int, 0.0),
    ("FS_THR_ENABLE", Int, 0.0),
    ("FS_GCS_ENABLE", Int, 5.0),
    ("FS_GCS_TIMEOUT", Real, 2.0),
    ("FS_EKF_ACTION", Int, 1.0),
    ("DISARM_DELAY", Int, 10.0),
    ("WPNAV_SPEED", Real, 100.0),
    ("WPNAV_SPEED_UP", Real, 100.0),
    ("WPNAV_SPEED_DN", Real, 75.0),
    ("LAND_SPEED", Int, 40.0),
    ("WP_YAW_BEHAVIOR", Int, 0.0),
    ("MAV_GCS_SYSID", Int, 255.0),
    ("GUID_TIMEOUT", Real, 3.0),
    ("FENCE_ENABLE", Int, 0.0),
    ("FENCE_TYPE", Int, 1.0),
    ("FENCE_ALT_MAX", Real, 3.0),
];

/// Set up for flight by camera.
const PX4: &[(&str, Kind, f64)] = &[
    ("EKF2_EV_CTRL", Int, 11.0),
    ("EKF2_HGT_REF", Int, 3.0),
    ("EKF2_EV_DELAY", Real, 50.0),
    ("EKF2_EV_NOISE_MD", Int, 0.0),
    ("EKF2_EVP_NOISE", Real, 0.1),
    ("EKF2_EVA_NOISE", Real, 0.1),
    ("EKF2_EVP_GATE", Real, 5.0),
    ("EKF2_EV_QMIN", Int, 0.0),
    ("EKF2_GPS_CTRL", Int, 0.0),
    ("EKF2_MAG_TYPE", Int, 5.0),
    ("EKF2_NOAID_TOUT", Int, 5_000_000.0),
    ("SYS_HAS_GPS", Int, 0.0),
    ("SYS_HAS_MAG", Int, 0.0),
    ("COM_RC_IN_MODE", Int, 4.0),
    ("COM_OF_LOSS_T", Real, 1.0),
    ("COM_OBL_RC_ACT", Int, 4.0),
    ("NAV_DLL_ACT", Int, 3.0),
    ("COM_DL_LOSS_T", Int, 5.0),
    ("COM_FAIL_ACT_T", Real, 0.0),
    ("COM_POS_FS_EPH", Real, 5.0),
    ("COM_DISARM_PRFLT", Real, 10.0),
    ("COM_DISARM_LAND", Real, 2.0),
    ("MPC_XY_VEL_MAX", Real, 1.0),
    ("MPC_Z_VEL_MAX_UP", Real, 1.0),
    ("MPC_Z_VEL_MAX_DN", Real, 0.75),
    ("MPC_LAND_SPEED", Real, 0.4),
    ("MIS_TAKEOFF_ALT", Real, 1.5),
];

impl Parameters {
    /// Those that let a drone fly by camera, for vehicle `system_id`.
    pub fn new(flavor: Flavor, system_id: u8) -> Self {
        let (table, id) = match flavor {
            Flavor::ArduPilot => (ARDUPILOT, "MAV_SYSID"),
            Flavor::Px4 => (PX4, "MAV_SYS_ID"),
        };
        let mut values = table.to_vec();
        values.push((id, Int, f64::from(system_id)));
        Self { flavor, values }
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.values.len()
    }

    /// Never.
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// Value by name; 0 where there is none.
    pub fn get(&self, name: &str) -> f64 {
        self.index(name).map_or(0.0, |index| self.values[index].2)
    }

    /// Whether the value was taken: the name must be known and the number finite.
    pub fn set(&mut self, name: &str, value: f64) -> bool {
        match self.index(name) {
            Some(index) if value.is_finite() => {
                self.values[index].2 =
                    if self.values[index].1 == Int { value.round() } else { value };
                true
            }
            _ => false,
        }
    }

    /// Place in the list.
    pub fn index(&self, name: &str) -> Option<usize> {
        self.values.iter().position(|(known, ..)| *known == name)
    }

    /// Name, type and value as PARAM_VALUE carries them: ArduPilot casts integers, PX4 sends their
    /// bits.
    pub fn wire(&self, index: usize) -> Option<(&'static str, MavParamType, f32)> {
        let &(name, kind, value) = self.values.get(index)?;
        let (kind, value) = match (kind, self.flavor) {
            (Real, _) => (MavParamType::MAV_PARAM_TYPE_REAL32, value as f32),
            (Int, Flavor::ArduPilot) => (MavParamType::MAV_PARAM_TYPE_INT32, value as f32),
            (Int, Flavor::Px4) => {
                (MavParamType::MAV_PARAM_TYPE_INT32, f32::from_bits((value as i32).cast_unsigned()))
            }
        };
        Some((name, kind, value))
    }

    /// The number that PARAM_SET carries for a name.
    pub fn from_wire(&self, name: &str, value: f32) -> f64 {
        let is_int = self.index(name).is_some_and(|index| self.values[index].1 == Int);
        if is_int && self.flavor == Flavor::Px4 {
            f64::from(value.to_bits().cast_signed())
        } else {
            f64::from(value)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_come_back_from_the_wire() {
        for flavor in [Flavor::ArduPilot, Flavor::Px4] {
            let mut parameters = Parameters::new(flavor, 7);
            for index in 0..parameters.len() {
                let (name, _, value) = parameters.wire(index).unwrap();
                assert!(name.len() <= 16, "{name}");
                let back = parameters.from_wire(name, value);
                assert!((back - parameters.get(name)).abs() < 1e-6, "{name}: {back}");
            }
            assert!(!parameters.set("NO_SUCH", 1.0) && !parameters.set("LAND_SPEED", f64::NAN));
        }
    }
}
