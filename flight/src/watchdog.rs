//! What to do with a vehicle whose pose, camera, link, pilot or battery fails.

use std::time::Duration;

/// What is known of a vehicle. Ages count from the time of capture or reception to now; `None`
/// where there never was one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Health {
    /// Age of the newest pose that was sent to the vehicle, from its frame's capture.
    pub pose_age: Option<Duration>,
    /// The source of its poses says that it is elsewhere, and that is not proven yet.
    pub relocating: bool,
    /// Age of the newest telemetry.
    pub link_age: Option<Duration>,
    /// How long the commanding client's lease has been over; zero while it holds.
    pub lease_over: Duration,
    /// Charge left, 0 to 1, where the vehicle tells it.
    pub battery: Option<f64>,
}

impl Default for Health {
    /// Nothing is wrong.
    fn default() -> Self {
        Self {
            pose_age: Some(Duration::ZERO),
            relocating: false,
            link_age: Some(Duration::ZERO),
            lease_over: Duration::ZERO,
            battery: None,
        }
    }
}

/// Why a vehicle does not go on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Reason {
    /// No fresh pose that can be true: what jumps, repeats itself or is late does not leave.
    PoseStale,
    /// It may be elsewhere.
    Relocating,
    /// The vehicle is silent.
    LinkLost,
    /// Nobody commands.
    LeaseOver,
    /// The battery is low.
    BatteryLow,
    /// Another vehicle comes too near.
    TooClose,
    /// Somebody else flies it.
    NotInControl,
}

impl Reason {
    /// Stable name for programs.
    pub fn code(self) -> &'static str {
        match self {
            Self::PoseStale => "pose_stale",
            Self::Relocating => "relocating",
            Self::LinkLost => "link_lost",
            Self::LeaseOver => "lease_over",
            Self::BatteryLow => "battery_low",
            Self::TooClose => "too_close",
            Self::NotInControl => "not_in_control",
        }
    }
}

/// What a vehicle shall do, milder first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Verdict {
    /// Fly on.
    Continue,
    /// Stay where it is.
    Hold(Reason),
    /// Land where it is.
    Land(Reason),
}

impl Verdict {
    /// 0 for go on, 1 for hold, 2 for land.
    pub fn severity(self) -> u8 {
        match self {
            Self::Continue => 0,
            Self::Hold(_) => 1,
            Self::Land(_) => 2,
        }
    }
}

/// From when on a vehicle holds, and from when on it lands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WatchdogLimits {
    /// Poses older than this hold and land. An autopilot's own failsafe takes 7 s or more, and a
    /// vehicle without poses drifts by 0.7 m in that time.
    pub pose_age: Patience,
    /// Silence of the vehicle.
    pub link: Patience,
    /// Absence of the pilot.
    pub lease: Patience,
    /// Charge below which the vehicle lands.
    pub battery_land: f64,
}

/// How long something may last.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Patience {
    /// The vehicle holds from here on.
    pub hold: Duration,
    /// The vehicle lands from here on.
    pub land: Duration,
}

impl Patience {
    const fn millis(hold: u64, land: u64) -> Self {
        Self { hold: Duration::from_millis(hold), land: Duration::from_millis(land) }
    }

    fn judge(&self, lasting: Option<Duration>, reason: Reason) -> Verdict {
        match lasting {
            Some(time) if time < self.hold && time < self.land => Verdict::Continue,
            Some(time) if time < self.land => Verdict::Hold(reason),
            _ => Verdict::Land(reason),
        }
    }
}

impl Default for WatchdogLimits {
    /// Poses: hold at 0.5 s, land at 1.5 s. Link: hold at 1 s, land at 5 s. Pilot: hold at once, land
    /// at 30 s. Battery: land at 20 %.
    fn default() -> Self {
        Self {
            pose_age: Patience::millis(500, 1_500),
            link: Patience::millis(1_000, 5_000),
            lease: Patience::millis(1, 30_000),
            battery_land: 0.20,
        }
    }
}

/// The gravest of all that the state of a vehicle asks for.
///
/// Monotone: a vehicle in a worse state is never treated more mildly. What never came counts as
/// infinitely old, and a number that is not one as beyond its limit.
pub fn judge(health: &Health, limits: &WatchdogLimits) -> Verdict {
    let relocating =
        if health.relocating { Verdict::Hold(Reason::Relocating) } else { Verdict::Continue };
    let battery = match health.battery {
        Some(charge) if charge.is_nan() || charge < limits.battery_land => {
            Verdict::Land(Reason::BatteryLow)
        }
        _ => Verdict::Continue,
    };
    let verdicts = [
        limits.pose_age.judge(health.pose_age, Reason::PoseStale),
        relocating,
        limits.link.judge(health.link_age, Reason::LinkLost),
        limits.lease.judge(Some(health.lease_over), Reason::LeaseOver),
        battery,
    ];
    // The first of the gravest, so that the reason is stable.
    let gravest = |best: Verdict, next: Verdict| {
        if next.severity() > best.severity() { next } else { best }
    };
    verdicts.into_iter().fold(Verdict::Continue, gravest)
}

#[cfg(test)]
mod tests;
