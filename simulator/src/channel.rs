//! A bad connection: datagrams are lost, late, in another order and twice.

use std::collections::BTreeMap;
use std::ops::Range;
use std::time::Duration;

use volery_geometry::Rng;

/// Part of the delay by which single datagrams differ from it.
const JITTER: f64 = 0.25;

/// What is wrong with a connection.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LinkFaults {
    /// Probability that a datagram is lost.
    pub loss: f64,
    /// Mean time on the way.
    pub delay: Duration,
    /// Probability that a datagram comes twice.
    pub duplication: f64,
    /// When nothing passes.
    pub cuts: Vec<Range<Duration>>,
}

/// One direction of a connection.
#[derive(Debug, Clone)]
pub struct Channel {
    faults: LinkFaults,
    rng: Rng,
    num_sent: u64,
    waiting: BTreeMap<(Duration, u64), Vec<u8>>,
}

impl Channel {
    /// Equal seeds lose the same datagrams.
    pub fn new(faults: LinkFaults, seed: u64) -> Self {
        Self { faults, rng: Rng::new(seed), num_sent: 0, waiting: BTreeMap::new() }
    }

    /// Nothing passes from now on until the end of `cut`.
    pub fn cut(&mut self, cut: Range<Duration>) {
        self.faults.cuts.push(cut);
    }

    /// A datagram sets out.
    pub fn send(&mut self, datagram: Vec<u8>, now: Duration) {
        if self.rng.chance(self.faults.loss) || self.faults.cuts.iter().any(|c| c.contains(&now)) {
            return;
        }
        let num_copies = if self.rng.chance(self.faults.duplication) { 2 } else { 1 };
        for _ in 0..num_copies {
            let stretch = self.rng.range(1.0 - JITTER, 1.0 + JITTER);
            let due = now + self.faults.delay.mul_f64(stretch);
            self.num_sent += 1;
            self.waiting.insert((due, self.num_sent), datagram.clone());
        }
    }

    /// What has arrived by now, in the order of arrival.
    pub fn receive(&mut self, now: Duration) -> Vec<Vec<u8>> {
        let later = self.waiting.split_off(&(now + Duration::from_nanos(1), 0));
        std::mem::replace(&mut self.waiting, later).into_values().collect()
    }

    /// When the next datagram arrives.
    pub fn next_arrival(&self) -> Option<Duration> {
        self.waiting.keys().next().map(|(due, _)| *due)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    #[test]
    fn loss_delay_and_duplication_are_as_asked() {
        let faults = LinkFaults { loss: 0.2, delay: 100 * MS, duplication: 0.1, cuts: vec![] };
        let mut channel = Channel::new(faults, 1);
        let mut arrived = 0;
        for step in 0..20_000_u32 {
            let now = MS * step;
            channel.send(step.to_le_bytes().to_vec(), now);
            for datagram in channel.receive(now) {
                let sent = u32::from_le_bytes(datagram.try_into().unwrap());
                let late = step - sent;
                assert!((75..=126).contains(&late), "{late} ms");
                arrived += 1;
            }
        }
        // 0.8 · 1.1 of 19 900, four standard deviations.
        assert!((f64::from(arrived) - 17_512.0).abs() < 300.0, "{arrived}");
    }

    #[test]
    fn nothing_passes_a_cut_and_a_good_channel_keeps_all() {
        let mut channel = Channel::new(LinkFaults::default(), 1);
        channel.cut(10 * MS..20 * MS);
        let mut arrived = Vec::new();
        for step in 0..30_u8 {
            channel.send(vec![step], MS * u32::from(step));
            arrived.extend(channel.receive(MS * u32::from(step)).concat());
        }
        assert_eq!(arrived, (0..10).chain(20..30).collect::<Vec<_>>());
    }
}
