//! A camera's clock beside ours.

use std::time::Duration;

/// Time over which the fastest frame is looked for, at least; twice that at most. Clocks that are
/// 100 millionths apart drift by 6 ms meanwhile.
const WINDOW: Duration = Duration::from_secs(30);

/// Tells how late frames come: the fastest one of the last minute is taken to have come at once.
#[derive(Debug, Default)]
pub(super) struct CameraClock {
    /// Begin of the window, and its least difference between arrival and capture, nanoseconds of
    /// either clock.
    window: Option<(Duration, i128)>,
    /// Least difference of the window before.
    before: Option<i128>,
}

impl CameraClock {
    /// How long after it was taken a frame arrived.
    ///
    /// * `t_capture_ns`: by the camera's clock.
    /// * `arrived`: by ours, since any fixed time; rising.
    pub(super) fn lateness(&mut self, t_capture_ns: u64, arrived: Duration) -> Duration {
        let difference = arrived.as_nanos() as i128 - i128::from(t_capture_ns);
        let (begin, least) = match self.window {
            Some((begin, least)) if arrived < begin + WINDOW => (begin, least.min(difference)),
            Some((begin, least)) => {
                // After a longer silence nothing of before is known to hold.
                self.before = (arrived < begin + WINDOW * 2).then_some(least);
                (arrived, difference)
            }
            None => (arrived, difference),
        };
        self.window = Some((begin, least));
        let fastest = self.before.map_or(least, |before| before.min(least));
        Duration::from_nanos(u64::try_from(difference - fastest).unwrap_or(u64::MAX))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: Duration = Duration::from_millis(100);

    fn ms(milliseconds: u64) -> Duration {
        Duration::from_millis(milliseconds)
    }

    #[test]
    fn a_frame_is_as_late_as_it_is_slower_than_the_fastest() {
        let mut clock = CameraClock::default();
        let delays = [30, 20, 90, 20];
        let late = delays.map(|delay| {
            let sent = ms(5000) + STEP;
            clock.lateness(sent.as_nanos() as u64, sent + ms(delay))
        });
        assert_eq!(late, [ms(0), ms(0), ms(70), ms(0)]);
    }

    /// Dies if the fastest frame of all times is the measure: after an hour every frame would be
    /// 360 ms late.
    #[test]
    fn a_clock_that_is_slow_does_not_make_frames_late() {
        let mut clock = CameraClock::default();
        let rate = 1.0 - 1e-4;
        for step in 0..36_000 {
            let now = STEP * step;
            let t_capture_ns = (now.as_nanos() as f64 * rate) as u64;
            let late = clock.lateness(t_capture_ns, now);
            assert!(late <= WINDOW.mul_f64(2.0 * 1e-4) + ms(1), "{late:?} at {now:?}");
        }
    }

    /// A frame that is late is late also at the begin of a window.
    #[test]
    fn the_window_before_counts() {
        let mut clock = CameraClock::default();
        let mut late_of = |step: u32, delay: Duration| {
            clock.lateness((STEP * step).as_nanos() as u64, STEP * step + delay)
        };
        for step in 0..3000 {
            let delay = if step % 299 == 0 { ms(80) } else { ms(10) };
            let late = late_of(step, delay);
            let expected = if step == 0 { ms(0) } else { delay - ms(10) };
            assert_eq!(late, expected, "frame {step}");
        }
    }
}
