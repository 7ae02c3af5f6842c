//! The parameters that flight by camera depends on, without GPS, compass and remote control.

use std::fmt;

use crate::Autopilot;

/// What a parameter may be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Wanted {
    /// One of these.
    OneOf(&'static [f64]),
    /// From the first to the second.
    Between(f64, f64),
}

impl Wanted {
    /// Whether a value is as wanted.
    pub fn holds(&self, value: f64) -> bool {
        // Parameters are f32 on the wire.
        let close = |wanted: f64| (value - wanted).abs() <= 1e-6 * wanted.abs().max(1.0);
        match *self {
            Self::OneOf(values) => values.iter().any(|wanted| close(*wanted)),
            Self::Between(low, high) => (low..=high).contains(&value) || close(low) || close(high),
        }
    }
}

impl fmt::Display for Wanted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OneOf(values) => {
                let words: Vec<_> = values.iter().map(ToString::to_string).collect();
                f.write_str(&words.join(" or "))
            }
            Self::Between(low, high) => write!(f, "{low} to {high}"),
        }
    }
}

/// One parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rule {
    /// Its names, the one of the newest firmware first.
    pub names: &'static [&'static str],
    /// What it may be.
    pub wanted: Wanted,
    /// What goes wrong otherwise.
    pub why: &'static str,
    /// Whether one can fly without.
    pub is_advice: bool,
}

const fn needed(names: &'static [&'static str], wanted: Wanted, why: &'static str) -> Rule {
    Rule { names, wanted, why, is_advice: false }
}

const fn advised(names: &'static [&'static str], wanted: Wanted, why: &'static str) -> Rule {
    Rule { names, wanted, why, is_advice: true }
}

use Wanted::{Between, OneOf};

const NO_GPS: &str = "there is no GPS indoors, and waiting for it forbids arming";
const NO_COMPASS: &str = "steel turns the compass, and the yaw with it";
const BY_VISION: &str = "the place and the yaw come from the camera";
const NO_SPEED: &str = "poses carry no speed: zeros would be believed";
const NOISE: &str = "poses are good to centimeters; otherwise they are hardly followed, or every \
                     one is";
const SLOW: &str = "indoors; at higher speed pictures blur and estimators lag";
const LATENCY: &str = "must hold the time from picture to pose; measure it, 250 ms at most";
const GCS_LOST: &str = "without the ground station it has to land by itself";

/// ArduCopter; speeds are cm/s.
const ARDUPILOT: &[Rule] = &[
    needed(&["GPS1_TYPE", "GPS_TYPE"], OneOf(&[0.0]), NO_GPS),
    needed(&["VISO_TYPE"], OneOf(&[1.0]), BY_VISION),
    needed(&["VISO_DELAY_MS"], Between(0.0, 250.0), LATENCY),
    needed(&["VISO_POS_M_NSE"], Between(0.05, 0.2), NOISE),
    needed(&["VISO_YAW_M_NSE"], Between(0.05, 0.2), NOISE),
    needed(&["AHRS_EKF_TYPE"], OneOf(&[3.0]), BY_VISION),
    needed(&["EK3_ENABLE"], OneOf(&[1.0]), BY_VISION),
    needed(&["EK3_SRC1_POSXY"], OneOf(&[6.0]), BY_VISION),
    needed(&["EK3_SRC1_VELXY"], OneOf(&[0.0]), NO_SPEED),
    needed(&["EK3_SRC1_POSZ"], OneOf(&[6.0]), BY_VISION),
    needed(&["EK3_SRC1_VELZ"], OneOf(&[0.0]), NO_SPEED),
    needed(&["EK3_SRC1_YAW"], OneOf(&[6.0]), BY_VISION),
    needed(&["COMPASS_ENABLE"], OneOf(&[0.0]), NO_COMPASS),
    needed(&["FS_THR_ENABLE"], OneOf(&[0.0]), "there is no remote control whose loss could count"),
    needed(&["FS_GCS_ENABLE"], OneOf(&[5.0]), GCS_LOST),
    needed(&["FS_GCS_TIMEOUT"], Between(2.0, 3.0), GCS_LOST),
    needed(&["FS_EKF_ACTION"], OneOf(&[1.0]), "without poses it has to land by itself"),
    needed(&["DISARM_DELAY"], Between(5.0, 30.0), "the time from arming to take-off"),
    needed(&["WPNAV_SPEED"], Between(20.0, 100.0), SLOW),
    needed(&["WPNAV_SPEED_UP"], Between(10.0, 100.0), SLOW),
    needed(&["WPNAV_SPEED_DN"], Between(10.0, 75.0), SLOW),
    needed(&["LAND_SPEED"], Between(30.0, 50.0), SLOW),
    advised(
        &["WP_YAW_BEHAVIOR"],
        OneOf(&[0.0]),
        "otherwise it turns along its path, and the camera away from the map",
    ),
    advised(&["MAV_GCS_SYSID", "SYSID_MYGCS"], OneOf(&[255.0]), GCS_LOST),
    advised(&["GUID_TIMEOUT"], Between(0.5, 1.0), "speed targets shall not outlive their sender"),
    advised(&["FENCE_ENABLE"], OneOf(&[1.0]), "the last resort under a ceiling"),
    advised(&["FENCE_TYPE"], OneOf(&[1.0]), "the last resort under a ceiling"),
    advised(&["FENCE_ALT_MAX"], Between(1.0, 20.0), "half a meter under the ceiling"),
];

/// PX4, multicopter.
const PX4: &[Rule] = &[
    needed(&["EKF2_EV_CTRL"], OneOf(&[11.0, 15.0]), BY_VISION),
    needed(&["EKF2_HGT_REF"], OneOf(&[3.0]), BY_VISION),
    needed(&["EKF2_EV_DELAY"], Between(0.0, 250.0), LATENCY),
    needed(&["EKF2_EV_NOISE_MD"], OneOf(&[0.0]), "poses tell how good they are"),
    needed(&["EKF2_EVP_NOISE"], Between(0.05, 0.1), NOISE),
    needed(&["EKF2_EVP_GATE"], Between(3.0, 5.0), "a wider gate lets wrong poses in"),
    needed(&["EKF2_EV_QMIN"], OneOf(&[0.0]), "poses by VISION_POSITION_ESTIMATE have no quality"),
    needed(&["EKF2_GPS_CTRL"], OneOf(&[0.0]), NO_GPS),
    needed(&["EKF2_MAG_TYPE"], OneOf(&[5.0]), NO_COMPASS),
    needed(&["SYS_HAS_GPS"], OneOf(&[0.0]), NO_GPS),
    needed(&["SYS_HAS_MAG"], OneOf(&[0.0]), NO_COMPASS),
    needed(&["COM_RC_IN_MODE"], OneOf(&[4.0]), "there is no remote control to wait for"),
    needed(&["COM_OF_LOSS_T"], Between(0.5, 1.0), "without setpoints it has to act by itself"),
    needed(&["COM_OBL_RC_ACT"], OneOf(&[4.0]), "without setpoints it has to land"),
    needed(&["NAV_DLL_ACT"], OneOf(&[3.0]), GCS_LOST),
    needed(&["COM_DL_LOSS_T"], Between(5.0, 10.0), GCS_LOST),
    needed(&["COM_FAIL_ACT_T"], Between(0.0, 5.0), "how long it waits before it acts"),
    needed(&["COM_POS_FS_EPH"], Between(0.5, 5.0), "when it counts as lost"),
    needed(&["COM_DISARM_PRFLT"], Between(5.0, 30.0), "the time from arming to take-off"),
];

/// The parameters of an autopilot that have to be looked at.
pub fn rules(autopilot: Autopilot) -> &'static [Rule] {
    match autopilot {
        Autopilot::ArduPilot => ARDUPILOT,
        Autopilot::Px4 => PX4,
    }
}
