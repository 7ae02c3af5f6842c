//! Whether a vehicle is heard, and what it is asked to send.

use std::{collections::HashMap, time::Duration};

use mavlink::{Message, dialects::ardupilotmega::MavMessage};

use crate::{VehicleId, message, message::CommandLong, telemetry};

/// Silence of heartbeats after which a vehicle is stale, and then lost.
pub(crate) const STALE_AFTER: Duration = Duration::from_secs(3);
/// See [`STALE_AFTER`].
pub(crate) const LOST_AFTER: Duration = Duration::from_secs(5);
/// Between heartbeats of ours: a vehicle that waits two seconds for one must not land because a bad
/// link has lost some.
const BEAT: Duration = Duration::from_millis(250);
/// Between time questions of ours.
const SECOND: Duration = Duration::from_secs(1);
/// Over which rates are measured.
const RATE_WINDOW: Duration = Duration::from_secs(2);
/// Between requests of one kind, so that they come one by one.
const REQUEST_SPACING: Duration = Duration::from_millis(50);
/// A clock that goes back by more than this has started anew.
const REBOOT_STEP: Duration = Duration::from_secs(1);
/// A longer way of a message is an error of its stamp.
const MAX_DELAY: Duration = Duration::from_millis(500);
/// Part of the rate asked for that is enough: more than half, which is all that comes of a message that
/// is sent at half the rate without being asked.
const ENOUGH: f64 = 0.7;
/// By how many messages one can be overtaken; with a number further back a sender has started anew.
const MAX_OVERTAKEN: u8 = 64;
/// Requests of a message that never comes, before they become rare.
const EAGER_REQUESTS: u32 = 5;

/// Messages that are asked for, with their interval in milliseconds.
const STREAMS: [(u32, u64); 9] = [
    (32, 50),    // LOCAL_POSITION_NED
    (30, 50),    // ATTITUDE
    (245, 500),  // EXTENDED_SYS_STATE
    (193, 500),  // EKF_STATUS_REPORT, ArduPilot
    (230, 500),  // ESTIMATOR_STATUS, PX4
    (0, 250),    // HEARTBEAT
    (1, 1000),   // SYS_STATUS
    (147, 2000), // BATTERY_STATUS
    (85, 500),   // POSITION_TARGET_LOCAL_NED
];
/// Without these nothing can be done with a vehicle.
const NEEDED: [u32; 2] = [30, 245];
const AUTOPILOT_VERSION: u32 = 148;
const GPS_GLOBAL_ORIGIN: u32 = 49;

/// How a vehicle is heard.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LinkState {
    /// Heard; its telemetry is being set up.
    Seen,
    /// Its telemetry comes.
    Linked,
    /// No heartbeat for a while: no commands.
    Stale,
    /// No heartbeat for long: everything is set up again when it comes back.
    Lost,
}

impl LinkState {
    /// Its name on the wire of the API.
    pub fn name(self) -> &'static str {
        match self {
            Self::Seen => "seen",
            Self::Linked => "linked",
            Self::Stale => "stale",
            Self::Lost => "lost",
        }
    }
}

#[derive(Debug, Clone, Copy, Default)]
struct Stream {
    /// Received since the start of the window.
    count: u32,
    window_start: Duration,
    requests: u32,
    heard: bool,
}

/// The link to one vehicle.
#[derive(Debug, Clone)]
pub struct Link {
    last_heartbeat: Duration,
    streams: HashMap<u32, Stream>,
    next_request: Duration,
    next_second: Duration,
    next_beat: Duration,
    has_version: bool,
    has_origin: bool,
    uptime: Option<Duration>,
    /// The time question on its way.
    asked: Option<i64>,
    round_trip: Option<Duration>,
    /// Their clock minus ours, nanoseconds, by the quickest answer so far.
    clock_offset_ns: Option<i64>,
    /// Messages heard and missed, by their sequence numbers.
    received: u64,
    missed: u64,
    sequence: Option<u8>,
}

impl Link {
    /// At the first heartbeat.
    pub fn new(now: Duration) -> Self {
        Self {
            last_heartbeat: now,
            streams: HashMap::new(),
            next_request: now,
            next_second: now,
            next_beat: now,
            has_version: false,
            has_origin: false,
            uptime: None,
            asked: None,
            round_trip: None,
            clock_offset_ns: None,
            received: 0,
            missed: 0,
            sequence: None,
        }
    }

    /// How the vehicle is heard at `now`.
    pub fn state(&self, now: Duration) -> LinkState {
        let silence = now.saturating_sub(self.last_heartbeat);
        let heard = |id| self.streams.get(&id).is_some_and(|stream| stream.heard);
        if silence >= LOST_AFTER {
            LinkState::Lost
        } else if silence >= STALE_AFTER {
            LinkState::Stale
        } else if NEEDED.into_iter().all(heard) {
            LinkState::Linked
        } else {
            LinkState::Seen
        }
    }

    /// Since the last heartbeat.
    pub fn silence(&self, now: Duration) -> Duration {
        now.saturating_sub(self.last_heartbeat)
    }

    /// Whether the estimator has said where on the earth its frame lies.
    pub fn has_origin(&self) -> bool {
        self.has_origin
    }

    /// Of the quickest time question.
    pub fn round_trip(&self) -> Option<Duration> {
        self.round_trip
    }

    /// Their clock minus ours, nanoseconds.
    pub fn clock_offset_ns(&self) -> Option<i64> {
        self.clock_offset_ns
    }

    /// When something was so that they stamped with their `uptime` and that came `now`: by their clock
    /// if it is known and makes sense, else now.
    pub(crate) fn time_of(&self, uptime: Duration, now: Duration) -> Duration {
        let ours = self.clock_offset_ns.and_then(|offset| {
            u64::try_from(nanoseconds(uptime).checked_sub(offset)?).ok().map(Duration::from_nanos)
        });
        ours.map(|ours| ours.min(now)).filter(|ours| *ours + MAX_DELAY >= now).unwrap_or(now)
    }

    /// Part of their messages that did not arrive.
    pub fn loss(&self) -> f64 {
        self.missed as f64 / (self.received + self.missed).max(1) as f64
    }

    /// Takes a message. Returns an answer to send, and whether the vehicle has started anew.
    pub fn take(
        &mut self,
        id: VehicleId,
        sequence: u8,
        message: &MavMessage,
        now: Duration,
    ) -> (Option<MavMessage>, bool) {
        self.count(sequence);
        let rebooted = self.notice_reboot(message, now);
        let stream = self.streams.entry(message.message_id()).or_default();
        stream.count += 1;
        stream.heard = true;
        let mut answer = None;
        match message {
            MavMessage::HEARTBEAT(_) => self.last_heartbeat = now,
            MavMessage::AUTOPILOT_VERSION(_) => self.has_version = true,
            MavMessage::GPS_GLOBAL_ORIGIN(_) => self.has_origin = true,
            MavMessage::TIMESYNC(sync) if sync.tc1 == 0 => {
                answer = Some(message::time_sync(id, nanoseconds(now), sync.ts1));
            }
            MavMessage::TIMESYNC(sync) if self.asked == Some(sync.ts1) => {
                self.asked = None;
                let round_trip = nanoseconds(now).saturating_sub(sync.ts1).max(0);
                let quick = Duration::from_nanos(round_trip as u64);
                if self.round_trip.is_none_or(|best| quick <= best) {
                    self.round_trip = Some(quick);
                    let middle = sync.ts1.saturating_add(round_trip / 2);
                    self.clock_offset_ns = Some(sync.tc1.saturating_sub(middle));
                }
            }
            _ => {}
        }
        (answer, rebooted)
    }

    /// What to send at `now`.
    pub fn poll(&mut self, id: VehicleId, wants_origin: bool, now: Duration) -> Vec<MavMessage> {
        let mut out = Vec::new();
        if now >= self.next_beat {
            self.next_beat = now + BEAT;
            out.push(message::heartbeat());
        }
        if now >= self.next_second {
            self.next_second = now + SECOND;
            self.asked = Some(nanoseconds(now));
            out.push(message::time_sync(id, 0, nanoseconds(now)));
            if !self.has_version {
                out.push(CommandLong::request_message(AUTOPILOT_VERSION).message(id, 0));
            }
            if wants_origin && !self.has_origin {
                out.push(message::set_origin(id));
                out.push(CommandLong::request_message(GPS_GLOBAL_ORIGIN).message(id, 0));
            }
        }
        if now >= self.next_request
            && let Some((stream, interval)) = self.slow_stream(now)
        {
            self.next_request = now + REQUEST_SPACING;
            out.push(CommandLong::set_interval(stream, interval).message(id, 0));
        }
        out
    }

    /// A message that comes at too low a rate and was not asked for lately.
    fn slow_stream(&mut self, now: Duration) -> Option<(u32, Duration)> {
        STREAMS.into_iter().find_map(|(id, interval_ms)| {
            let stream = self.streams.entry(id).or_default();
            let interval = Duration::from_millis(interval_ms);
            let window = RATE_WINDOW.max(interval * 3);
            let asked_before = stream.requests > 0;
            let patience = if stream.requests > EAGER_REQUESTS && !stream.heard {
                window * 10
            } else {
                window
            };
            if asked_before && now < stream.window_start + patience {
                return None;
            }
            let expected = window.div_duration_f64(interval);
            let slow = !asked_before || f64::from(stream.count) < expected * ENOUGH;
            stream.count = 0;
            stream.window_start = now;
            stream.requests += u32::from(slow);
            slow.then_some((id, interval))
        })
    }

    fn count(&mut self, sequence: u8) {
        self.received += 1;
        let step = self.sequence.map_or(1, |latest| sequence.wrapping_sub(latest));
        if step > u8::MAX - MAX_OVERTAKEN {
            // It has been counted as missed.
            self.missed = self.missed.saturating_sub(1);
            return;
        }
        if step < 128 {
            self.missed += u64::from(step.saturating_sub(1));
        }
        self.sequence = Some(sequence);
    }

    /// A vehicle whose clock goes back, or that was lost, has forgotten what it was asked.
    fn notice_reboot(&mut self, message: &MavMessage, now: Duration) -> bool {
        let uptime = telemetry::uptime(message);
        let went_back = matches!((uptime, self.uptime),
            (Some(now), Some(before)) if now + REBOOT_STEP < before);
        if uptime.is_some() {
            self.uptime = uptime;
        }
        if went_back {
            let kept = Self { uptime, sequence: self.sequence, ..Self::new(now) };
            *self = Self { last_heartbeat: self.last_heartbeat, ..kept };
        } else if self.silence(now) >= LOST_AFTER {
            self.streams.clear();
        }
        went_back
    }
}

fn nanoseconds(time: Duration) -> i64 {
    i64::try_from(time.as_nanos()).unwrap_or(i64::MAX)
}

#[cfg(test)]
mod tests;
