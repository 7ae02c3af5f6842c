//! Faults as people ask for them: `loss=0.2`, `2:freeze@20-25`.

use std::ops::Range;
use std::str::FromStr;
use std::time::Duration;

use nalgebra::Vector3;

use crate::{CameraFault, DroneOptions, LinkFaults};

/// A fault of one drone or of all.
#[derive(Debug, Clone, PartialEq)]
pub struct Fault {
    /// System id; all where absent.
    pub drone: Option<u8>,
    /// What goes wrong.
    pub kind: FaultKind,
    /// When, on the clock of the simulation.
    pub when: Range<Duration>,
}

/// What can go wrong.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FaultKind {
    /// Probability that a datagram is lost.
    Loss(f64),
    /// Seconds on the way.
    Delay(f64),
    /// Probability that a datagram comes twice.
    Duplication(f64),
    /// Nothing passes the link.
    Cut,
    /// Error of the gyroscope, degrees per second.
    Yaw(f64),
    /// Error of the accelerometer, m/s².
    Drift(f64),
    /// The battery has so many percent from then on.
    Battery(f64),
    /// The camera's.
    Camera(CameraFault),
}

/// What faults may be called.
pub const FAULTS: &str = "loss=P, delay=SECONDS, duplication=P, yaw=DEG_PER_S, drift=M_PER_S2, \
                          battery=PERCENT[@FROM], cut@FROM[-TO], freeze@FROM[-TO], \
                          blackout@FROM[-TO]; one drone's with its number before: 2:loss=0.2";

/// A fault that is not one of [`FAULTS`].
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0:?} is not a fault; there are {FAULTS}")]
pub struct UnknownFault(String);

impl FromStr for Fault {
    type Err = UnknownFault;

    fn from_str(text: &str) -> Result<Self, UnknownFault> {
        parse(text).ok_or_else(|| UnknownFault(text.to_owned()))
    }
}

fn parse(text: &str) -> Option<Fault> {
    let (drone, rest) = match text.split_once(':') {
        Some((drone, rest)) => (Some(drone.parse().ok()?), rest),
        None => (None, text),
    };
    let (what, when) = match rest.split_once('@') {
        Some((what, when)) => (what, Some(span(when)?)),
        None => (rest, None),
    };
    let (name, value) = match what.split_once('=') {
        Some((name, value)) => {
            (name, Some(value.parse::<f64>().ok().filter(|v| v.is_finite() && v.abs() < 1e3)?))
        }
        None => (what, None),
    };
    let part = |value: f64| (0.0..=1.0).contains(&value).then_some(value);
    let kind = match (name, value) {
        ("loss", Some(p)) => FaultKind::Loss(part(p)?),
        ("duplication", Some(p)) => FaultKind::Duplication(part(p)?),
        ("delay", Some(seconds)) if seconds >= 0.0 => FaultKind::Delay(seconds),
        ("yaw", Some(rate)) => FaultKind::Yaw(rate),
        ("drift", Some(acceleration)) => FaultKind::Drift(acceleration),
        ("battery", Some(percent)) => FaultKind::Battery(100.0 * part(percent / 100.0)?),
        ("cut", None) => FaultKind::Cut,
        ("freeze", None) => FaultKind::Camera(CameraFault::Freeze),
        ("blackout", None) => FaultKind::Camera(CameraFault::Blackout),
        _ => return None,
    };
    let lasts = matches!(kind, FaultKind::Cut | FaultKind::Camera(_) | FaultKind::Battery(_));
    if when.is_some() && !lasts {
        return None;
    }
    Some(Fault { drone, kind, when: when.unwrap_or(Duration::ZERO..Duration::MAX) })
}

fn span(text: &str) -> Option<Range<Duration>> {
    let seconds = |s: &str| Duration::try_from_secs_f64(s.parse().ok()?).ok();
    match text.split_once('-') {
        Some((from, to)) => Some(seconds(from)?..seconds(to)?),
        None => Some(seconds(text)?..Duration::MAX),
    }
}

impl Fault {
    /// Whether it is one of drone `system_id`.
    pub fn is_of(&self, system_id: u8) -> bool {
        self.drone.is_none_or(|drone| drone == system_id)
    }

    /// Builds the fault into a drone and its link, as far as it is theirs.
    pub fn build_into(&self, drone: &mut DroneOptions, link: &mut LinkFaults) {
        if !self.is_of(drone.system_id) {
            return;
        }
        match self.kind {
            FaultKind::Loss(p) => link.loss = p,
            FaultKind::Duplication(p) => link.duplication = p,
            FaultKind::Delay(seconds) => link.delay = Duration::from_secs_f64(seconds),
            FaultKind::Cut => link.cuts.push(self.when.clone()),
            FaultKind::Yaw(rate) => drone.inertial.yaw_drift = rate.to_radians(),
            FaultKind::Drift(acceleration) => drone.inertial.drift = Vector3::x() * acceleration,
            FaultKind::Battery(_) | FaultKind::Camera(_) => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_read_as_they_are_named() {
        let fault: Fault = "2:freeze@20-25.5".parse().unwrap();
        assert_eq!((fault.drone, fault.kind), (Some(2), FaultKind::Camera(CameraFault::Freeze)));
        assert_eq!(fault.when, Duration::from_secs(20)..Duration::from_millis(25_500));
        assert_eq!("loss=0.2".parse::<Fault>().unwrap().kind, FaultKind::Loss(0.2));
        assert_eq!("battery=30@5".parse::<Fault>().unwrap().kind, FaultKind::Battery(30.0));
        for bad in ["loss", "loss=2", "loss=0.1@3", "delay=nan", "x:cut", "cut@5-", "", "freeze=1"]
        {
            assert!(bad.parse::<Fault>().is_err(), "{bad}");
        }
    }
}
